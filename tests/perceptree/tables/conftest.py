"""Synthetic results of runs, to test tables without training."""

from collections.abc import Callable, Sequence
from typing import Any

import pytest

from perceptree.tables import TableSettings
from perceptree.tables.build import record_of
from perceptree.tables.paper import BOTH, KEYPOINT_ONLY, MASK_ONLY
from perceptree.tables.plan import TableModel

Scores = dict[tuple[str, str], dict[str, Sequence[float]]]

ABLATION: Scores = {
    ("depth", MASK_ONLY): {"box_ap": (50.0, 50.2), "mask_ap": (40.0, 40.2)},
    ("depth", BOTH): {
        "box_ap": (47.0, 47.2),
        "mask_ap": (40.1, 40.3),
        "keypoint_ap": (60.0, 60.2),
    },
    ("depth", KEYPOINT_ONLY): {"box_ap": (49.0, 49.2), "keypoint_ap": (55.0, 55.2)},
    ("rgb", BOTH): {"box_ap": (30.0, 30.2), "mask_ap": (20.0, 20.2), "keypoint_ap": (40.0, 40.2)},
}


def made_result(
    settings: TableSettings, model: TableModel, seed: int, scores: dict[str, Sequence[float]]
) -> dict[str, Any]:
    """A result as `make_result` returns it, for the seed's index in ``scores``."""
    names = ("box_ap", "mask_ap", "keypoint_ap", "box_ap50", "mask_ap50")
    metrics = {name: scores[name][seed] if name in scores else None for name in names}
    training = settings.training(model, seed).to_dict()
    return {
        "training": {
            "spec": settings.spec(model).to_dict(),
            "settings": training,
            "init": {"name": "random"},
            "data": {"folder": "forest"},
        },
        "made": {"steps": 900 + seed, "frames": 9000, "precision": "fp32", "device": "2 CPU cores"},
        "test": {"folder": "frozen"},
        "metrics": metrics | {"frames": 400, "trees": 1600},
    }


@pytest.fixture
def made_table() -> Callable[..., dict[str, Any]]:
    """The record of table 3 with synthetic scores by modality, tasks, measure and seed."""

    def make(scores: Scores = ABLATION, seeds: int = 2, **changes: Any) -> dict[str, Any]:
        values: dict[str, Any] = {"table": 3, "minutes": 10.0, "seeds": (0, 1)}
        settings = TableSettings(**values | changes)
        results = {
            row.model: [
                made_result(settings, row.model, seed, scores[row.model.modality, row.model.tasks])
                for seed in range(seeds)
                if (row.model.modality, row.model.tasks) in scores
            ]
            for row in settings.rows()
        }
        return record_of(settings, results)

    return make
