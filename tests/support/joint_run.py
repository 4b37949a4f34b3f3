"""One process of a training that a test runs alone, or starts by torchrun.

Arguments: DATA OUT, and the options of `run` by name, but `--near` for `start`: torchrun has a
similar one.
"""

import argparse
import json
import os
from dataclasses import replace
from pathlib import Path

import torch
from narrow_networks import narrow_spec

from perceptree.data import AugmentSettings
from perceptree.models import SampleSettings
from perceptree.training import Engine, Status, TrainSettings, train

STEPS = 8
# Proposals, NMS and overlap thresholds can depend on the last digit. So here all
# anchors are proposed, none is suppressed, and only true boxes overlap enough.
ALL_PROPOSALS = SampleSettings(
    proposals_per_level=1000, proposals=1000, regions=1000, region_positive_iou=0.95
)


def run(
    data: Path,
    out: Path,
    dies_at: int = 0,
    start: Path | None = None,
    steps: int = STEPS,
    modality: str = "depth",
    apart: bool = False,
) -> None:
    """Train with one thread, and write the losses of each step to `told.json`.

    Args:
        data: dataset.
        out: folder of the run.
        dies_at: step at which the second process dies; 0 for none.
        start: starting weights that the training is held near.
        steps: steps of the training.
        modality: input of the network.
        apart: whether each process has a folder of its own in `out`, named by its rank, as on
            machines that share none.
    """
    torch.set_num_threads(1)
    rank = os.environ.get("RANK", "0")
    if apart:
        out /= rank
    spec = narrow_spec(modality, proposal_nms_iou=1.0)
    settings = TrainSettings(
        steps=steps,
        batch=4,
        warmup_steps=8,
        optimizer="sgd",
        learning_rate=1e-4,
        ema_decay=0.0,
        evaluate_every_steps=1000,
        augment=AugmentSettings(holes=2, without_colour_share=0.2, without_depth_share=0.5),
        sampling=ALL_PROPOSALS,
    )
    if start is not None:
        settings = replace(settings, frozen_steps=3, keep_features=1.0, keep_weights=100.0)
    told: list[dict[str, float]] = []
    last: dict[str, float] = {}

    def note(status: Status) -> None:
        # The trainer reports running means, which are plain means over so few steps.
        number = len(told) + 1
        told.append(
            {
                name: number * value - (number - 1) * last.get(name, 0.0)
                for name, value in status.losses.items()
            }
        )
        last.update(status.losses)
        if status.step == dies_at and rank == "1":
            raise RuntimeError("this process dies")

    train(spec, settings, data, out, note, start, Engine(precision="fp32", workers=0))
    if rank == "0":
        (out / "told.json").write_text(json.dumps(told))


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("data", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--dies-at", type=int, default=0)
    parser.add_argument("--near", dest="start", type=Path)
    parser.add_argument("--steps", type=int, default=STEPS)
    parser.add_argument("--modality", default="depth")
    parser.add_argument("--apart", action="store_true")
    run(**vars(parser.parse_args()))
