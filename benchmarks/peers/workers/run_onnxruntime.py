"""Time an ONNX file in onnxruntime's default settings, from the input array to the outputs."""

from __future__ import annotations

import onnxruntime

from benchmarks.peers.workers.stopwatch import Run, measure, options, read_inputs, report


def main() -> None:
    """Time the file on the frames."""
    arguments = options().parse_args()

    def load() -> Run:
        settings = onnxruntime.SessionOptions()
        settings.intra_op_num_threads = arguments.threads
        settings.inter_op_num_threads = 1
        settings.log_severity_level = 3
        session = onnxruntime.InferenceSession(
            arguments.network, settings, providers=["CPUExecutionProvider"]
        )
        name = session.get_inputs()[0].name
        return lambda image: session.run(None, {name: image})

    inputs = read_inputs(arguments.frames, arguments.layout)
    record = measure(load, inputs, arguments.seconds)
    report(record | {"runtime": f"onnxruntime {onnxruntime.__version__}"})


if __name__ == "__main__":
    main()
