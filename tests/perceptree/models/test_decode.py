"""Keypoint decoding against torch's bicubic resizing, region by region."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor
from torch.nn import functional

from perceptree.models.decode import decode_keypoints, keypoint_stds, pixel_peaks, subcell_peaks

S = 56
LONGEST_PX = 1280


def heat_maps(count: int, strength: float = 3.0, seed: int = 0) -> Tensor:
    """(N, S, S) logits like the head's: noise at half the resolution, upsampled bilinearly."""
    random = torch.Generator().manual_seed(seed)
    coarse = strength * torch.randn(count, 1, S // 2, S // 2, generator=random)
    return functional.interpolate(coarse, scale_factor=2.0, mode="bilinear")[:, 0]


def box_sides(count: int, seed: int = 1) -> Tensor:
    """(N, 2) box sizes from one pixel to the whole frame, with and without fractions, px."""
    random = torch.Generator().manual_seed(seed)
    sides = 1.0 * 1200 ** torch.rand(count, 2, generator=random)
    special = torch.tensor(
        [[56.0, 56.0], [55.2, 112.0], [112.0, 111.5], [0.4, 300.0], [1280.0, 720.0], [20.0, 9.5]]
    )
    return torch.cat((special, sides))[:count].clamp(max=LONGEST_PX)


def detectron2_peak(heat: Tensor, sides: Tensor) -> tuple[Tensor, float]:
    """The best pixel of one (S, S) map resized to its box, as (x, y) px in it, and its score."""
    width, height = (max(float(side), 1.0) for side in sides)
    columns, rows = int(np.ceil(width)), int(np.ceil(height))
    fine = functional.interpolate(
        heat[None, None], size=(rows, columns), mode="bicubic", align_corners=False
    )[0, 0]
    row, column = divmod(int(fine.argmax()), columns)
    peak = torch.tensor([(column + 0.5) * width / columns, (row + 0.5) * height / rows])
    return peak, float(1.0 / torch.exp(heat - fine.max()).sum())


def test_peaks_on_pixels_are_those_of_detectron2() -> None:
    maps, sides = heat_maps(250), box_sides(250)
    share, peak = pixel_peaks(maps, sides, LONGEST_PX)
    equal, worst_score = [], 0.0
    for heat, side, found, height in zip(maps, sides, share, peak, strict=True):
        peak, score = detectron2_peak(heat, side)
        equal.append(bool(((found * side.clamp(min=1.0) - peak).abs() < 1e-2).all()))
        ours = float(1.0 / torch.exp(heat - height).sum())
        worst_score = max(worst_score, abs(ours - score) / score)
    assert float((sides.amin(dim=1) < S).float().mean()) > 0.5
    assert np.mean(equal) >= 0.99
    assert worst_score < 1e-2


def test_sharp_peaks_on_pixels_are_all_found() -> None:
    random = np.random.default_rng(4)
    grid = torch.arange(S) + 0.5
    maps = []
    for _ in range(200):
        x, y, width = random.uniform(0, S), random.uniform(0, S), random.uniform(0.5, 30.0)
        maps.append(-((grid[None, :] - x) ** 2 + (grid[:, None] - y) ** 2) / width)
    stacked, sides = torch.stack(maps).float(), box_sides(200, seed=5)
    boxes = torch.cat((torch.zeros(200, 2), sides.clamp(min=1.0)), dim=1)
    found = decode_keypoints(stacked[:, None], boxes, "pixels", LONGEST_PX)[:, 0]
    for heat, side, (x, y, score) in zip(stacked, sides, found.tolist(), strict=True):
        peak, expected = detectron2_peak(heat, side)
        # Two pixels that are equal up to float32 rounding may swap.
        pixel = float((side.clamp(min=1.0) / side.clamp(min=1.0).ceil()).max())
        assert abs(x - peak[0]) < 1.01 * pixel
        assert abs(y - peak[1]) < 1.01 * pixel
        assert score == pytest.approx(expected, rel=1e-3)


def equal_peaks(count: int, levels: int, share: float, seed: int) -> Tensor:
    """(N, S, S) whole logits below ``levels``, of which a share is not 0: many peaks are equal."""
    random = torch.Generator().manual_seed(seed)
    logits = torch.randint(0, levels, (count, S, S), generator=random).float()
    return logits * (torch.rand(count, S, S, generator=random) < share)


def assert_highest(maps: Tensor, sides: Tensor, share: Tensor, peak: Tensor) -> None:
    """Check peaks against all pixels of the resized maps."""
    for heat, side, (x, y), height in zip(maps, sides, share.tolist(), peak, strict=True):
        columns, rows = side.clamp(min=1.0).ceil().int().tolist()
        fine = functional.interpolate(heat[None, None], size=(rows, columns), mode="bicubic")[0, 0]
        # Rounding differs, by up to some 1e-6 of the logits.
        tolerance = 1e-5 * max(1.0, float(heat.abs().max()))
        assert float(height) == pytest.approx(float(fine.max()), abs=tolerance)
        assert float(fine[int(y * rows), int(x * columns)]) >= float(fine.max()) - tolerance


@given(
    levels=st.integers(1, 6),
    share=st.sampled_from([0.01, 0.1, 1.0]),
    sides=st.tuples(st.floats(0.0, 700.0), st.floats(0.0, 700.0)),
    seed=st.integers(0, 1000),
)
def test_the_highest_of_many_equal_peaks_is_found(
    levels: int, share: float, sides: tuple[float, float], seed: int
) -> None:
    maps, side = equal_peaks(3, levels, share, seed), torch.tensor([sides])
    assert_highest(maps, side.expand(3, 2), *pixel_peaks(maps, side, LONGEST_PX))


def test_an_exported_graph_finds_the_same_peaks(monkeypatch: pytest.MonkeyPatch) -> None:
    noise = torch.randn(100, S, S, generator=torch.Generator().manual_seed(8))
    maps, sides = torch.cat((heat_maps(100, seed=7), noise)), box_sides(200, seed=9)
    monkeypatch.setattr(torch.compiler, "is_exporting", lambda: True)
    assert_highest(maps, sides, *pixel_peaks(maps, sides, LONGEST_PX))


def test_peaks_between_pixels_are_those_of_a_smooth_surface() -> None:
    random = np.random.default_rng(0)
    grid = torch.arange(S) + 0.5
    true, maps = [], []
    for _ in range(300):
        x, y = random.uniform(3, S - 3, 2)
        wide, high = random.uniform(2.0, 6.0, 2)
        across, down = (grid - x) / wide, (grid - y) / high
        maps.append(10 * torch.exp(-(across[None, :] ** 2) - down[:, None] ** 2))
        true.append((x, y))
    share, peak = subcell_peaks(torch.stack(maps).float())
    gap = (share * S - torch.tensor(true)).abs().amax(dim=1)
    # This bicubic kernel, Detectron2's, differs from a parabola by up to 1/8 cell.
    assert float(gap.max()) < 0.14
    assert float(gap.median()) < 0.1
    signed = share * S - torch.tensor(true)
    assert float(signed.mean(dim=0).abs().max()) < 0.02
    assert peak.tolist() == pytest.approx([10.0] * 300, rel=0.02)


def fine_peak(heat: Tensor) -> tuple[float, float, float]:
    """x and y in cells, and the surface there, of the best 1/32 cell near the highest node."""
    fine = functional.interpolate(heat[None, None], scale_factor=32, mode="bicubic")[0, 0]
    best = np.unravel_index(int(heat.argmax()), heat.shape)
    top, left = (max(0, 32 * int(i) - 16) for i in best)
    near = fine[top : top + 64, left : left + 64]
    row, column = divmod(int(near.argmax()), near.shape[1])
    return (left + column + 0.5) / 32, (top + row + 0.5) / 32, float(near.max())


def test_peaks_between_pixels_are_those_of_the_bicubic_surface() -> None:
    maps = heat_maps(60, strength=1.0)
    share, peak = subcell_peaks(maps)
    gap = []
    for heat, found, height in zip(maps, share * S, peak, strict=True):
        x, y, highest = fine_peak(heat)
        assert float(height) == pytest.approx(highest, abs=0.01)
        gap.append(max(abs(float(found[0]) - x), abs(float(found[1]) - y)))
    assert np.quantile(gap, 0.95) < 0.05


@pytest.mark.parametrize("grid", ["subcell", "pixels"])
def test_a_score_is_the_softmax_over_the_cells_taken_at_the_peak(grid: str) -> None:
    maps = heat_maps(20, strength=1.5).reshape(4, 5, S, S)
    boxes = torch.tensor([[10.0, 20.0, 96.5, 240.0]] * 4)
    found = decode_keypoints(maps, boxes, grid, LONGEST_PX)  # type: ignore[arg-type]
    assert found.shape == (4, 5, 3)
    for heat, score in zip(maps.flatten(0, 1), found[..., 2].flatten().tolist(), strict=True):
        _, expected = detectron2_peak(heat, torch.tensor([86.5, 220.0]))
        if grid == "subcell":
            expected = float(1.0 / torch.exp(heat - fine_peak(heat)[2]).sum())
        assert score == pytest.approx(expected, rel=1e-4 if grid == "pixels" else 0.01)


@pytest.mark.parametrize("grid", ["subcell", "pixels"])
def test_keypoints_scale_with_their_box_and_stay_in_order(grid: str) -> None:
    maps = torch.full((2, 5, S, S), -20.0)
    for keypoint in range(5):
        maps[:, keypoint, 10 + keypoint, 40] = 5.0
    boxes = torch.tensor([[100.0, 50.0, 156.0, 162.0], [0.0, 0.0, 5.6, 5.6]])
    found = decode_keypoints(maps, boxes, grid, LONGEST_PX)  # type: ignore[arg-type]
    assert found[0, :, 0].tolist() == pytest.approx([140.5] * 5, abs=1e-3)
    # One cell is two pixels high here: the peak is between them, or on the upper one.
    middle = [50 + 2 * (10.5 + keypoint) for keypoint in range(5)]
    assert found[0, :, 1].tolist() == pytest.approx(middle, abs=1e-3 if grid == "subcell" else 0.51)
    if grid == "subcell":
        assert found[1, :, 0].tolist() == pytest.approx([4.05] * 5, abs=1e-4)
    assert ((found[1, :, :2] >= 0) & (found[1, :, :2] <= 5.6)).all()


@pytest.mark.parametrize("grid", ["subcell", "pixels"])
def test_boxes_without_size_and_wild_maps_give_finite_answers(grid: str) -> None:
    maps = torch.cat((heat_maps(2, 1e3), torch.zeros(1, S, S), torch.full((1, S, S), -1e4)))
    boxes = torch.tensor([[5.0, 6.0, 5.0, 6.0]]).repeat(4, 1)
    found = decode_keypoints(maps[:, None], boxes, grid, LONGEST_PX)  # type: ignore[arg-type]
    assert torch.isfinite(found).all()
    assert (found[..., :2] == torch.tensor([5.0, 6.0])).all()


def test_deviations_are_those_of_the_heat_map_in_pixels() -> None:
    cells = (torch.arange(S) + 0.5) / S
    x, y, std = 0.4, 0.6, (0.05, 0.1)
    shape = -((cells - x) ** 2) / (2 * std[0] ** 2) - ((cells[:, None] - y) ** 2) / (
        2 * std[1] ** 2
    )
    boxes = torch.tensor([[100.0, 50.0, 180.0, 450.0]])
    maps = shape[None, None]
    points = decode_keypoints(maps, boxes, "subcell", LONGEST_PX)
    found = keypoint_stds(maps, points, boxes)[0, 0]
    assert found.tolist() == pytest.approx([0.05 * 80, 0.1 * 400], rel=0.01)


def test_a_second_peak_makes_a_keypoint_doubtful() -> None:
    maps = torch.full((1, 2, S, S), -20.0)
    maps[0, :, 10, 20] = 5.0
    maps[0, 1, 10, 40] = 4.9
    boxes = torch.tensor([[0.0, 0.0, 560.0, 560.0]])
    points = decode_keypoints(maps, boxes, "subcell", LONGEST_PX)
    (one, two), down = keypoint_stds(maps, points, boxes)[0, :, 0], 10 * S
    assert one < 0.01 * down
    share = 1 / (1 + float(torch.exp(torch.tensor(0.1))))
    assert two == pytest.approx(200 * share**0.5, rel=0.02)
