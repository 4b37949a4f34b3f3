"""How well checkpoints do on the test frames of datasets."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from perceptree.data import FrameStore, read_split
from perceptree.evaluation import Metrics, evaluate, predict_with
from perceptree.models import TreeRCNN, load_checkpoint

MEASURES = ("box_ap", "mask_ap", "keypoint_ap", "diameter_error_px", "recall", "precision")
NEVER = 10**9
"""Steps between evaluations on val that no training reaches."""


def evaluated(model: TreeRCNN, test: Path) -> Metrics:
    """Evaluate a network on the test split of a dataset."""
    return evaluate(predict_with(model), FrameStore(read_split(test, "test"), model.spec), 4)


def scores(checkpoint: Path, test: Path, names: Iterable[str] = MEASURES) -> dict[str, Any]:
    """Some measures of a checkpoint on the test split of a dataset."""
    metrics = evaluated(load_checkpoint(checkpoint)[0].eval(), test).to_dict()
    return {name: metrics[name] for name in names}
