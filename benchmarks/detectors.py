"""Size, cost, speed and accuracy of each model preset after a short training.

python -m benchmarks.detectors DATA --test TEST --runs RUNS --result FILE.json

DATA is a dataset of `perceptree synth`. Every light preset is trained on it from random weights
with the same number of steps, into RUNS/NAME; an existing checkpoint is reused. By default depth
models are trained, as they need fewer steps than colour models. The test split of TEST, another
dataset such as one of `--preset test`, gives the accuracy. Each network is exported to ONNX at
its preset's input size, in float32 and INT8, and timed from the prepared frame to the output
arrays. The files alternate, so that ratios are valid on a machine with other load.
The paper's presets are timed with random weights and not trained, which would take days on a CPU.
"""

from __future__ import annotations

import argparse
import logging
import statistics
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime
import torch
from numpy.typing import NDArray

from benchmarks.tools.program import finish, machine, program
from benchmarks.tools.scores import evaluated
from benchmarks.tools.timing import in_turn
from edgetree.export.build import trace
from edgetree.export.quantise import quantise
from perceptree.data import FrameStore, read_split
from perceptree.models import EDGE_PRESETS, PAPER_PRESETS, TreeRCNN, load_checkpoint, make_spec
from perceptree.models.cost import multiply_adds, parameters
from perceptree.training import TrainSettings, train

CALIBRATION_FRAMES = 8
PAPER_SIDE_PX = 800


def checkpoint_of(preset: str, size: tuple[int, int], arguments: argparse.Namespace) -> Path:
    """The preset's checkpoint; trained if it does not exist."""
    folder: Path = arguments.runs / preset
    best = folder / "best.safetensors"
    if not best.exists():
        steps = arguments.steps
        settings = TrainSettings(steps=steps, warmup_steps=max(1, steps // 5), schedule="cosine")
        train(make_spec(preset, arguments.modality, *size), settings, arguments.data, folder)
    return best


def accuracy(model: TreeRCNN, test: Path) -> dict[str, Any]:
    """Average precision in percent."""
    metrics = evaluated(model, test)
    names = ("box_ap", "box_ap50", "mask_ap", "keypoint_ap")
    return {name: round(getattr(metrics, name), 1) for name in names}


def at_size(model: TreeRCNN, height: int, width: int) -> TreeRCNN:
    """Make the same network for another input size."""
    resized = TreeRCNN(replace(model.spec, height=height, width=width))
    resized.load_state_dict(model.state_dict())
    return resized.eval()


def cost(model: TreeRCNN) -> dict[str, Any]:
    """Number of parameters, and multiply-adds (10^9) at the timed input size and at 800x800."""
    square = at_size(model, PAPER_SIDE_PX, PAPER_SIDE_PX)
    return {
        "backbone": model.spec.backbone,
        "timed_input": f"{model.spec.width}x{model.spec.height}",
        "parameters_m": round(parameters(model) / 1e6, 2),
        "multiply_adds_g": round(multiply_adds(model) / 1e9, 2),
        "multiply_adds_800x800_g": round(multiply_adds(square) / 1e9, 2),
    }


def sessions(
    model: TreeRCNN, frames: NDArray[np.uint8]
) -> Iterator[tuple[str, onnxruntime.InferenceSession]]:
    """ONNX Runtime sessions of the model in both precisions, with two threads."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 2
    options.log_severity_level = 3
    int8 = quantise(trace(model, batch=1, quantised=True), frames)
    for precision, proto in (("float32", trace(model, batch=1)), ("int8", int8)):
        data = proto.SerializeToString()
        yield precision, onnxruntime.InferenceSession(data, options, ["CPUExecutionProvider"])


def times_ms(
    files: dict[tuple[str, str], tuple[onnxruntime.InferenceSession, NDArray[np.uint8]]],
    rounds: int,
) -> dict[tuple[str, str], float]:
    """Median time of each file, ms. Every file runs once per round."""
    calls = {
        key: lambda number, session=session, frames=frames: session.run(
            None, {"image": frames[number % len(frames)][None]}
        )
        for key, (session, frames) in files.items()
    }
    times = in_turn(calls, rounds)
    return {key: round(statistics.median(values), 1) for key, values in times.items()}


def main() -> None:
    """Train, evaluate and time the presets."""
    parser = program(__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("--test", type=Path, required=True)
    parser.add_argument("--runs", type=Path, required=True)
    parser.add_argument("--presets", default=",".join((*EDGE_PRESETS, *PAPER_PRESETS)))
    parser.add_argument(
        "--modality", default="depth", help="input of the light models: rgb or depth"
    )
    parser.add_argument("--size", default="192x320", help="training input, height x width in px")
    parser.add_argument("--steps", type=int, default=250)
    parser.add_argument("--rounds", type=int, default=15)
    arguments = parser.parse_args()
    logging.disable(logging.WARNING)
    height, width = (int(side) for side in arguments.size.split("x"))
    figures: dict[str, dict[str, Any]] = {}
    files = {}
    for preset in arguments.presets.split(","):
        if preset in EDGE_PRESETS:
            trained, _ = load_checkpoint(checkpoint_of(preset, (height, width), arguments))
            own = make_spec(preset)
            model = at_size(trained, own.height, own.width)
            figures[preset] = cost(model) | accuracy(trained, arguments.test)
        else:
            torch.manual_seed(0)
            model = TreeRCNN(make_spec(preset, "rgb", PAPER_SIDE_PX, PAPER_SIDE_PX)).eval()
            figures[preset] = cost(model)
        store = FrameStore(read_split(arguments.data, "train")[:CALIBRATION_FRAMES], model.spec)
        frames = np.stack([store[index].image for index in range(len(store))])
        for precision, session in sessions(model, frames):
            files[preset, precision] = (session, frames)
    for (preset, precision), median in times_ms(files, arguments.rounds).items():
        figures[preset][f"{precision}_ms"] = median
    result = {
        "machine": machine(),
        "threads": 2,
        "modality": arguments.modality,
        "trained_input": f"{width}x{height}",
        "training_steps": arguments.steps,
        "presets": figures,
    }
    finish(result, arguments.result)


if __name__ == "__main__":
    main()
