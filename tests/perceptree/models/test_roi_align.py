"""Both implementations of RoIAlign against torchvision's operator on each level."""

import pytest
import torch
from torch import Tensor
from torchvision.ops import roi_align
from torchvision.ops.poolers import LevelMapper

from perceptree.models.roi_align import RegionPooler

HEIGHT, WIDTH = 384, 640
CHANNELS = 5
FORMS = ["operator", "gather"]


def pyramid(levels: tuple[int, ...]) -> dict[int, Tensor]:
    random = torch.Generator().manual_seed(1)
    return {
        n: torch.randn(2, CHANNELS, HEIGHT >> n, WIDTH >> n, generator=random).requires_grad_()
        for n in levels
    }


def regions() -> tuple[Tensor, Tensor]:
    """Boxes of all sizes, along each border, over the whole image, and without area."""
    random = torch.Generator().manual_seed(2)
    size = torch.tensor([WIDTH, HEIGHT]) * 0.02 * 50 ** torch.rand(40, 2, generator=random)
    corner = torch.rand(40, 2, generator=random) * (torch.tensor([WIDTH, HEIGHT]) - size)
    special = torch.tensor(
        [
            [0.0, 50.0, 60.0, 300.0],
            [500.0, 0.0, 560.0, 90.0],
            [600.0, 100.0, WIDTH, 180.0],
            [30.0, 350.0, 90.0, HEIGHT],
            [0.0, 0.0, WIDTH, HEIGHT],
            [0.0, 0.0, 3.0, 5.0],
            [WIDTH - 4.0, HEIGHT - 2.0, WIDTH, HEIGHT],
            [100.0, 100.0, 100.0, 100.0],
            [0.0, 0.0, 0.0, 0.0],
            [WIDTH, HEIGHT, WIDTH, HEIGHT],
            [200.0, 50.0, 200.0, 250.0],
        ]
    )
    boxes = torch.cat((torch.cat((corner, corner + size), dim=1), special))
    return boxes, torch.arange(len(boxes)) % 2


def reference(
    maps: dict[int, Tensor], boxes: Tensor, images: Tensor, cells: int, samples: int
) -> Tensor:
    levels = sorted(maps)
    chosen = LevelMapper(levels[0], levels[-1])([boxes]) + levels[0]
    rows = []
    for box, image, level in zip(boxes, images, chosen.tolist(), strict=True):
        region = torch.cat((image[None].float(), box))[None]
        rows.append(roi_align(maps[level], region, cells, 2.0**-level, samples, aligned=True)[0])
    return torch.stack(rows)


def gradients(pooled: Tensor, maps: dict[int, Tensor]) -> list[Tensor]:
    weight = torch.randn(pooled.shape, generator=torch.Generator().manual_seed(3))
    return list(torch.autograd.grad((pooled * weight).sum(), list(maps.values())))


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("samples", [2, 0])
@pytest.mark.parametrize("levels", [(4,), (3, 4, 5), (2, 3, 4, 5)])
@pytest.mark.parametrize("cells", [7, 14])
def test_pooling_and_its_gradient_are_torchvisions(
    form: str, samples: int, levels: tuple[int, ...], cells: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(torch.compiler, "is_exporting", lambda: form == "operator")
    maps = pyramid(levels)
    boxes, images = regions()
    ours = RegionPooler(maps, levels, samples)(boxes, images, cells)
    theirs = reference(maps, boxes, images, cells, samples)
    assert ours.shape == (len(boxes), CHANNELS, cells, cells)
    torch.testing.assert_close(ours, theirs, atol=1e-4, rtol=1e-4)
    for mine, expected in zip(gradients(ours, maps), gradients(theirs, maps), strict=True):
        assert expected.abs().sum() > 0
        torch.testing.assert_close(mine, expected, atol=5e-4, rtol=1e-4)


@pytest.mark.parametrize("form", FORMS)
def test_no_regions_pool_to_nothing(form: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.compiler, "is_exporting", lambda: form == "operator")
    for samples in (0, 2):
        pooler = RegionPooler(pyramid((3, 4)), (3, 4), samples)
        none = pooler(torch.zeros(0, 4), torch.zeros(0, dtype=torch.int64), 7)
        assert none.shape == (0, CHANNELS, 7, 7)


@pytest.mark.parametrize("form", FORMS)
def test_maps_in_half_precision_and_any_layout_pool_as_float32(
    form: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(torch.compiler, "is_exporting", lambda: form == "operator")
    maps = {n: x.detach().bfloat16() for n, x in pyramid((3, 4)).items()}
    layouts = {n: x.contiguous(memory_format=torch.channels_last) for n, x in maps.items()}
    boxes, images = regions()
    pooled = RegionPooler(layouts, (3, 4), 2)(boxes, images, 7)
    expected = reference({n: x.float() for n, x in maps.items()}, boxes, images, 7, 2)
    assert pooled.dtype == torch.float32
    torch.testing.assert_close(pooled, expected, atol=1e-4, rtol=1e-4)
