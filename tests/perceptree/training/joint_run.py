"""One process of a training that a test starts by torchrun.

Arguments: DATA OUT DIES_AT, and START for a training that is held near the weights in that file.
"""

import json
import os
import sys
from dataclasses import replace
from pathlib import Path

import torch

from perceptree.data import AugmentSettings
from perceptree.models import SampleSettings, make_spec
from perceptree.training import Engine, Status, TrainSettings, train

STEPS = 8
# Proposals, NMS and overlap thresholds can depend on the last digit. So here all
# anchors are proposed, none is suppressed, and only true boxes overlap enough.
ALL_PROPOSALS = SampleSettings(
    proposals_per_level=1000, proposals=1000, regions=1000, region_positive_iou=0.95
)


def main() -> None:
    """Train, and write the losses of each step to a file."""
    data, out, dies_at = Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3])
    torch.set_num_threads(1)
    spec = make_spec(
        "edge-n",
        "depth",
        64,
        128,
        fpn_width=16,
        box_head_width=16,
        mask_head_widths=(8,),
        keypoint_head_widths=(8,),
        proposal_nms_iou=1.0,
    )
    settings = TrainSettings(
        steps=STEPS,
        batch=4,
        warmup_steps=8,
        optimizer="sgd",
        learning_rate=1e-4,
        ema_decay=0.0,
        evaluate_every_steps=1000,
        augment=AugmentSettings(holes=2),
        sampling=ALL_PROPOSALS,
    )
    start = Path(sys.argv[4]) if len(sys.argv) > 4 else None
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
        if status.step == dies_at and os.environ.get("RANK") == "1":
            raise RuntimeError("this process dies")

    train(spec, settings, data, out, note, start, Engine(precision="fp32", workers=0))
    if os.environ.get("RANK", "0") == "0":
        (out / "told.json").write_text(json.dumps(told))


if __name__ == "__main__":
    main()
