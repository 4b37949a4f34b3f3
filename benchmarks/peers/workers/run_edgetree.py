"""Time `TreeDetector.detect` in its default settings, from a frame in memory to its trees."""

from __future__ import annotations

import onnxruntime

from benchmarks.peers.workers.stopwatch import Run, measure, options, read_inputs, report
from edgetree import TreeDetector


def main() -> None:
    """Time the file on the frames."""
    arguments = options().parse_args()

    def load() -> Run:
        return TreeDetector.load(arguments.network, threads=arguments.threads).detect

    inputs = read_inputs(arguments.frames, arguments.layout)
    record = measure(load, inputs, arguments.seconds)
    report(record | {"runtime": f"edgetree, onnxruntime {onnxruntime.__version__}"})


if __name__ == "__main__":
    main()
