"""Detectron2's own answers on a real frame, with the same weights, held against ours."""

import dataclasses
import importlib.util
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from torch import nn

from calib import paste_mask
from perceptree.models import TreeRCNN, make_spec
from perceptree.models.rpn import ProposalMaps
from perceptree.models.weights.detectron2 import our_name

LEVELS = (2, 3, 4, 5, 6)
PRESETS = {"R50": "r50", "R101": "r101", "X101": "x101-32x8d"}


@dataclasses.dataclass(frozen=True)
class Run:
    """One network's single inference beside what Detectron2 returned."""

    model: TreeRCNN
    maps: list[np.ndarray]
    proposals: np.ndarray
    objectness: np.ndarray
    found: dict[str, np.ndarray]
    """Rows in the order of Detectron2's detections, by their boxes."""
    expected: dict[str, np.ndarray]


# X101 takes about a minute on two cores; test_stored_outputs.py runs it on a small picture.
@pytest.fixture(
    scope="module", params=["R50", "R101", pytest.param("X101", marks=pytest.mark.slow)]
)
def run(request: pytest.FixtureRequest, shared_path: Callable[[str], Path]) -> Run:
    golden = shared_path("golden")
    frame = shared_path("data/real/forest_1280x720.png")
    spec = make_spec(PRESETS[request.param], "rgb", score_threshold=0.05)
    model = TreeRCNN(spec).eval()
    shapes = json.loads((golden / f"{request.param}_shapes.json").read_text("utf-8"))
    filled = fill(golden, shapes, unit_pixel_std=set(spec.std) == {1.0})
    weights = {our_name(k): torch.from_numpy(v) for k, v in filled.items()}
    missing, surplus = model.load_state_dict(weights, strict=False)
    assert surplus == []
    assert all(name.endswith("num_batches_tracked") for name in missing)
    seen: dict[str, Any] = {}
    model.pyramid.register_forward_hook(lambda _m, _i, maps: seen.update(maps=maps))
    model.proposer.register_forward_hook(lambda _m, _i, out: seen.update(proposals=out))
    image = torch.from_numpy(cv2.imread(str(frame), cv2.IMREAD_COLOR))[None]
    with torch.inference_mode():
        found = {name: value[0].numpy() for name, value in model.detect(image)._asdict().items()}
        proposals = model.proposer.propose(ProposalMaps(*seen["proposals"]), 1000, 1000)
    expected = dict(np.load(golden / f"{request.param}.npz"))
    assert found.pop("num_detections") == len(expected["boxes"])
    nearest = distances(expected["boxes"], found["boxes"]).argmin(axis=1)
    return Run(
        model,
        [level[0].numpy() for level in seen["maps"]],
        proposals.boxes[0].numpy(),
        proposals.scores[0].numpy(),
        {name: value[nearest] for name, value in found.items()},
        expected,
    )


def fill(
    golden: Path, shapes: dict[str, list[int]], *, unit_pixel_std: bool
) -> dict[str, np.ndarray]:
    found = importlib.util.spec_from_file_location("fill_weights", golden / "fill_weights.py")
    assert found is not None
    assert found.loader is not None
    module = importlib.util.module_from_spec(found)
    found.loader.exec_module(module)
    weights: dict[str, np.ndarray] = module.fill(shapes, unit_pixel_std=unit_pixel_std)
    return weights


def distances(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """The largest difference of any side, px, of all (N, 4) with all (M, 4) boxes -> (N, M)."""
    return np.abs(first[:, None] - second[None]).max(axis=-1)


def test_pyramid_maps_are_detectron2s(run: Run) -> None:
    assert len(run.maps) == len(LEVELS)
    for level, ours in zip(LEVELS, run.maps, strict=True):
        theirs = run.expected[f"p{level}_sample"]
        assert ours[::16, ::8, ::8].shape == theirs.shape
        error = np.abs(ours[::16, ::8, ::8] - theirs).max() / np.abs(theirs).max()
        assert error < 1e-4, f"level {level}"
        statistics = ours.mean(dtype=np.float64), ours.std(dtype=np.float64)
        assert statistics == pytest.approx(run.expected[f"p{level}_stats"], rel=1e-3, abs=1e-5)


def test_proposals_are_detectron2s_as_a_set(run: Run) -> None:
    # Neighbours' objectness differs by as little as 6e-6, so ranks may swap.
    gap = distances(run.expected["proposals"], run.proposals)
    assert gap.min(axis=1).max() < 0.1
    assert len(set(gap.argmin(axis=1).tolist())) == len(gap)
    ours = run.objectness[gap.argmin(axis=1)]
    assert np.abs(ours - run.expected["objectness"]).max() < 1e-3
    assert np.abs(run.objectness[: len(gap)] - run.expected["objectness"]).max() < 1e-3


def test_boxes_and_scores_are_detectron2s(run: Run) -> None:
    gap = distances(run.expected["boxes"], run.found["boxes"])
    assert gap.diagonal().max() < 0.1
    assert len({tuple(box) for box in run.found["boxes"].tolist()}) == len(gap)
    assert np.abs(run.found["scores"] - run.expected["scores"]).max() < 1e-3


def test_masks_are_detectron2s(run: Run) -> None:
    theirs = np.unpackbits(run.expected["masks"], axis=-1)[..., :1280].astype(bool)
    rows = zip(run.found["masks"], run.found["boxes"], theirs, strict=True)
    for cells, box, expected in rows:
        ours = paste_mask(cells, box, 1280, 720)
        assert (ours & expected).sum() >= 0.99 * (ours | expected).sum() > 0


def test_keypoints_and_their_scores_are_detectron2s(run: Run) -> None:
    ours, theirs = run.found["keypoints"], run.expected["keypoints"]
    # On a near tie of two peaks rounding decides, so a few may lie elsewhere.
    gap = np.linalg.norm(ours[..., :2] - theirs[..., :2], axis=-1)
    assert (gap < 0.5).mean() >= 0.98
    assert np.abs(ours[..., 2] - theirs[..., 2]).max() < 1e-3
    assert np.abs(ours[..., 2] / theirs[..., 2] - 1).max() < 0.01


@pytest.mark.parametrize(
    ("preset", "million"), [("r50", "61.66"), ("r101", "80.60"), ("x101-32x8d", "124.7")]
)
def test_the_networks_hold_as_many_parameters_as_detectron2s(preset: str, million: str) -> None:
    with torch.device("meta"):
        count = without_norms(TreeRCNN(make_spec(preset)))
    assert f"{count / 1e6:.2f}".startswith(million)


def without_norms(model: nn.Module) -> int:
    """Detectron2 freezes batch norms' weights, and does not count them."""
    norms = [m for m in model.modules() if isinstance(m, nn.modules.batchnorm._BatchNorm)]
    count = sum(value.numel() for value in model.parameters())
    return count - sum(value.numel() for norm in norms for value in norm.parameters())
