"""Time an ONNX file in onnxruntime's default settings, from the input array to the outputs."""

from __future__ import annotations

import numpy as np
import onnxruntime

from benchmarks.peers.workers.stopwatch import Run, measure, options, read_inputs, report


def main() -> None:
    """Time the file on the frames."""
    parser = options()
    parser.add_argument("--lowest-score", type=float, help="given to the network, if it takes one")
    arguments = parser.parse_args()
    more = {}
    if arguments.lowest_score is not None:
        more["score_threshold"] = np.array([arguments.lowest_score], np.float32)

    def load() -> Run:
        settings = onnxruntime.SessionOptions()
        settings.intra_op_num_threads = arguments.threads
        settings.inter_op_num_threads = 1
        settings.log_severity_level = 3
        session = onnxruntime.InferenceSession(
            arguments.network, settings, providers=["CPUExecutionProvider"]
        )
        name = session.get_inputs()[0].name
        return lambda image: session.run(None, {name: image, **more})

    inputs = read_inputs(arguments.frames, arguments.layout)
    record = measure(load, inputs, arguments.seconds)
    report(record | {"runtime": f"onnxruntime {onnxruntime.__version__}"})


if __name__ == "__main__":
    main()
