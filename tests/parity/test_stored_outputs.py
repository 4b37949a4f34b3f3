"""Outputs of a narrow network with the layout of Detectron2's, held against stored ones.

The stored outputs were written by this code while `test_detectron2.py` passed, which needs
Detectron2's own outputs. Weights and picture follow from formulas, so no random numbers are stored.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from perceptree.models import TreeRCNN, make_spec

Arrays = dict[str, NDArray[Any]]

HEIGHT_PX, WIDTH_PX = 96, 160
BEST = 10  # detections that are compared


def picture() -> NDArray[np.uint8]:
    """(H, W, 3) uint8: three bright posts over a ground that grows darker towards the top."""
    rows, columns = np.mgrid[:HEIGHT_PX, :WIDTH_PX]
    ground = 40 + rows + 10 * np.sin(columns / 3) * np.sin(rows / 5)
    image = np.stack([ground, ground * 0.9, ground * 0.7], axis=-1)
    for left, width, value in ((20, 12, 200), (70, 20, 150), (130, 8, 230)):
        image[8:88, left : left + width] = value - 2 * np.arange(width)[:, None]
    return image.round().astype(np.uint8)


def fill(model: TreeRCNN) -> None:
    """Weights that look random, of the size that keeps activations' variance."""
    with torch.no_grad():
        for number, (name, value) in enumerate(model.state_dict().items()):
            if name.endswith("num_batches_tracked"):
                continue
            wave = np.sin(np.arange(value.numel()) * (1.7 + 0.01 * number) + number)
            if name.endswith("running_var") or (value.ndim == 1 and name.endswith("weight")):
                filled = 1 + 0.2 * wave
            elif value.ndim == 1:
                filled = 0.1 * wave
            else:
                filled = wave * np.sqrt(2 / value[0].numel())
            value.copy_(torch.from_numpy(filled.reshape(value.shape)))


def outputs(preset: str) -> Arrays:
    """What the network finds in `picture`, and every fourth value of its pyramid."""
    spec = make_spec(
        preset,
        "rgb",
        HEIGHT_PX,
        WIDTH_PX,
        fpn_width=16,
        box_head_width=24,
        mask_head_widths=(8, 8),
        keypoint_head_widths=(8, 8),
        score_threshold=0.05,
    )
    torch.manual_seed(0)
    model = TreeRCNN(spec).eval()
    fill(model)
    seen: dict[str, Any] = {}
    model.pyramid.register_forward_hook(lambda _m, _i, maps: seen.update(maps=maps))
    with torch.inference_mode():
        found = model.detect(torch.from_numpy(picture())[None])._asdict()
    count = int(found.pop("num_detections")[0])
    arrays = {name: value[0, :count].numpy() for name, value in found.items()}
    levels = {f"level_{n}": level[0, ::4, ::4, ::4].numpy() for n, level in enumerate(seen["maps"])}
    return arrays | levels


@pytest.mark.parametrize("preset", ["r50", "x101-32x8d"])
def test_outputs_are_those_that_were_stored(
    preset: str, golden_path: Callable[[str], Path], tmp_path: Path
) -> None:
    name = f"{preset}_outputs.npz"
    found = outputs(preset)
    np.savez_compressed(tmp_path / name, **found)
    accept = f"to accept the new outputs: cp '{tmp_path / name}' '{golden_path('.')}'"
    assert golden_path(name).is_file(), accept
    expected = dict(np.load(golden_path(name)))
    assert len(expected["boxes"]) > BEST
    for level in (key for key in expected if key.startswith("level_")):
        error = np.abs(found[level] - expected[level]).max() / np.abs(expected[level]).max()
        assert error < 1e-4, f"{level}: {accept}"
    # Rounding may change the order of two scores, and so which the last of all rows are.
    best = {key: expected[key][:BEST] for key in ("boxes", "scores", "masks", "keypoints")}
    gap = np.abs(found["boxes"][:, None] - best["boxes"][None]).max(axis=-1)
    assert gap.min(axis=0).max() < 0.05, accept
    matched = {key: found[key][gap.argmin(axis=0)] for key in best}
    for key, limit in {"scores": 1e-4, "masks": 1e-3}.items():
        assert np.abs(matched[key] - best[key]).max() < limit, f"{key}: {accept}"
    # On a near tie of two peaks rounding decides, so a few keypoints may lie elsewhere.
    away = np.linalg.norm(matched["keypoints"] - best["keypoints"], axis=-1)
    assert (away < 0.05).mean() >= 0.95, accept
