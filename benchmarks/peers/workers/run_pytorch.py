"""Time a network in PyTorch, eager or compiled, from the input array to what it finds."""

from __future__ import annotations

import torch

from benchmarks.peers.workers.stopwatch import Run, measure, options, read_inputs, report


def main() -> None:
    """Time the network on the frames."""
    parser = options()
    parser.add_argument("--compile", action="store_true", help="compile the network")
    parser.add_argument("--list", action="store_true", help="it takes images as torchvision's do")
    arguments = parser.parse_args()
    torch.set_num_threads(arguments.threads)

    def load() -> Run:
        model = torch.load(arguments.network, weights_only=False)
        if arguments.list:
            return lambda image: model([torch.from_numpy(image)])
        detect = torch.compile(model.detect) if arguments.compile else model.detect
        return lambda image: detect(torch.from_numpy(image))

    inputs = read_inputs(arguments.frames, arguments.layout)
    with torch.inference_mode():
        record = measure(load, inputs, arguments.seconds)
    report(record | {"runtime": f"PyTorch {torch.__version__.partition('+')[0]}"})


if __name__ == "__main__":
    main()
