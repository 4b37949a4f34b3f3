"""RoIAlign on the packed map of all levels equals torchvision's operator on each level."""

import pytest
import torch
from torch import Tensor
from torchvision.ops import roi_align

from perceptree.models import roi_align as module
from perceptree.models.roi_align import RegionPooler

# (rows, columns) px of the input: the column of small maps is lower or higher than the first.
SIZES = {
    "wide": (256, 640),
    "wide, high column": (160, 640),
    "tall": (640, 256),
    "tall and narrow": (704, 64),
    "square": (512, 512),
    "small": (64, 64),
    "smallest": (32, 32),
}


def pyramid(height: int, width: int, levels: tuple[int, ...]) -> dict[int, Tensor]:
    """Maps with different values for each level, image, channel and position."""
    random = torch.Generator().manual_seed(1)
    return {
        n: 10.0 * n + torch.randn(2, 3, height >> n, width >> n, generator=random) for n in levels
    }


def regions_at_borders(height: int, width: int) -> Tensor:
    """(R, 4) xyxy px: boxes at every combination of borders, wide and narrow ones."""
    spans = ((0.0, 1.0), (0.0, 0.4), (0.6, 1.0), (0.31, 0.7), (0.0, 0.01), (0.99, 1.0))
    boxes = [
        (left * width, top * height, right * width, bottom * height)
        for left, right in spans
        for top, bottom in spans
    ]
    return torch.tensor(boxes)


@pytest.mark.parametrize("samples", [2, 0])
@pytest.mark.parametrize("levels", [(2, 3, 4, 5), (3, 4, 5), (4, 5), (5,)])
@pytest.mark.parametrize("size", SIZES)
def test_each_level_is_pooled_as_if_it_were_alone(
    size: str, levels: tuple[int, ...], samples: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(torch.compiler, "is_exporting", lambda: True)
    maps = pyramid(*SIZES[size], levels)
    boxes = regions_at_borders(*SIZES[size])
    images = torch.arange(len(boxes)) % 2
    pooler = RegionPooler(maps, levels, samples)
    for level in levels:
        chosen = torch.full((len(boxes),), level)
        monkeypatch.setattr(module, "assign_levels", lambda *_, chosen=chosen: chosen)
        regions = torch.cat((images[:, None].float(), boxes), dim=1)
        expected = roi_align(maps[level], regions, 7, 2.0**-level, samples, aligned=True)
        torch.testing.assert_close(pooler(boxes, images, 7), expected, atol=2e-4, rtol=1e-5)
