"""Time an ONNX file or an OpenVINO model in OpenVINO on the CPU.

What is not quantised runs in float32. Without the hint, OpenVINO takes bfloat16 where the processor
has it.
"""

from __future__ import annotations

import openvino
from openvino import properties

from benchmarks.peers.workers.stopwatch import Run, measure, options, read_inputs, report


def main() -> None:
    """Time the file on the frames."""
    arguments = options().parse_args()
    settings = {
        properties.inference_num_threads(): arguments.threads,
        properties.num_streams(): 1,
        properties.hint.performance_mode(): properties.hint.PerformanceMode.LATENCY,
        properties.hint.inference_precision(): openvino.Type.f32,
    }

    def load() -> Run:
        request = openvino.Core().compile_model(arguments.network, "CPU", settings)
        request = request.create_infer_request()
        return lambda image: request.infer([image], share_inputs=True, share_outputs=True)

    inputs = read_inputs(arguments.frames, arguments.layout)
    record = measure(load, inputs, arguments.seconds)
    version = openvino.__version__.partition("-")[0]
    report(record | {"runtime": f"OpenVINO {version}"})


if __name__ == "__main__":
    main()
