"""ChArUco boards of both patterns, and AprilGrids."""

from __future__ import annotations

from dataclasses import replace

import cv2
import fake_boards as fake
import numpy as np
import pytest

from basetree.errors import InputError
from calib.boards import (
    AprilGrid,
    Calibration,
    CharucoBoard,
    Picture,
    calibrate_camera,
    find_boards,
    parse_board,
)

SIZE = (640, 480)
NEW = CharucoBoard(8, 6, 0.03, 0.022, "4x4_50")
OLD = replace(NEW, legacy=True)
GRID = AprilGrid(6, 5, 0.03, 0.3)


def pictures_of(board: CharucoBoard | AprilGrid, count: int = 14) -> list[Picture]:
    images = fake.rendered(fake.RADTAN, board, fake.poses(fake.RADTAN, count, seed=2))
    return [Picture(f"p{i}", image) for i, image in enumerate(images)]


def camera_from(printed: CharucoBoard | AprilGrid, given: CharucoBoard | AprilGrid) -> Calibration:
    seen = find_boards(pictures_of(printed), given)
    result = calibrate_camera(seen.views, SIZE)
    assert isinstance(result, Calibration), result
    return result


@pytest.mark.parametrize(("printed", "given"), [(OLD, NEW), (OLD, OLD), (NEW, NEW), (GRID, GRID)])
def test_the_camera_is_recovered(
    printed: CharucoBoard | AprilGrid, given: CharucoBoard | AprilGrid
) -> None:
    result = camera_from(printed, given)
    assert result.passed, result.reasons
    for name in ("fx", "fy", "cx", "cy"):
        assert abs(getattr(result.camera, name) - getattr(fake.RADTAN, name)) < 1.5, name
    assert result.rms_px < 0.2


@pytest.mark.parametrize("rows", [5, 6])
def test_both_patterns_give_the_same_points(rows: int) -> None:
    new = replace(NEW, rows=rows)
    for printed in (new, replace(new, legacy=True)):
        sheet, px_per_m, first_px = fake.printed(printed)
        found = new.detect(cv2.GaussianBlur(sheet, (0, 0), 1.0))
        assert found is not None
        image_px, object_m = found
        assert len(image_px) == 7 * (rows - 1)
        off_px = image_px - (object_m[:, :2] * px_per_m + first_px)
        assert np.abs(off_px).max() < 0.2


def test_a_forced_pattern_is_the_only_one() -> None:
    assert OLD.detect(cv2.GaussianBlur(fake.printed(NEW)[0], (0, 0), 1.0)) is None


def test_markers_without_corners_are_told() -> None:
    wrong = replace(NEW, columns=6, rows=8)
    seen = find_boards(pictures_of(NEW, 7), wrong)
    assert seen.views == ()
    assert len(seen.seen_in_part) == 5
    for text in seen.seen_in_part.values():
        assert "markers of 4x4_50 and 0 corners between them" in text


def test_nothing_is_told_of_pictures_without_markers() -> None:
    seen = find_boards([Picture("p", np.full((480, 640), 90, np.uint8))], NEW)
    assert seen.without_board == ("p",)
    assert seen.seen_in_part == {}


@pytest.mark.parametrize("up", [True, False])
@pytest.mark.parametrize("turns", [0, 1, 2, 3])
@pytest.mark.parametrize("border", [1, 2])
def test_a_grid_is_found_in_every_layout(border: int, turns: int, up: bool) -> None:
    sheet = fake.april_sheet(GRID, border, turns, up)
    found = GRID.detect(cv2.GaussianBlur(sheet, (0, 0), 1.0))
    assert found is not None
    image_px, object_m = found
    assert len(image_px) == 4 * 30
    assert (object_m[:, 2] == 0).all()
    flat_m = object_m[:, :2] - object_m[0, :2]
    expected_px = image_px[0] + flat_m * (80 / 0.03)
    assert np.abs(image_px - expected_px).max() < 0.4


def test_a_part_of_a_grid_is_enough() -> None:
    sheet = cv2.GaussianBlur(fake.april_sheet(GRID), (0, 0), 1.0)
    found = GRID.detect(sheet[: sheet.shape[0] // 2, : sheet.shape[1] // 2].copy())
    assert found is not None
    assert 8 <= len(found[0]) < 60


def test_tags_in_another_grid_are_told() -> None:
    seen = find_boards(pictures_of(GRID, 4), replace(GRID, columns=4, rows=7))
    assert not seen.views
    assert "tags of apriltag_36h11 that fit no such grid" in seen.seen_in_part["p0"]


def test_texts_of_boards() -> None:
    assert parse_board("charuco:8x6:0.03:0.022:4x4_50:legacy") == OLD
    assert parse_board("AprilGrid:6x5:0.03:0.3") == GRID
    sparse = parse_board("aprilgrid:6x5:0.03:0.3:apriltag_25h9")
    assert sparse == replace(GRID, dictionary="apriltag_25h9")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("charuco:8x6:0.03:0.022:4x4_50:old", "expected one such as checkerboard"),
        ("aprilgrid:6x6:0.088", "expected one such as"),
        ("aprilgrid:6x6:0.088:0", "spacing is 0.0: expected more than 0, up to 2"),
        ("aprilgrid:6x6:nan:0.3", "tag_m is nan"),
        ("aprilgrid:6x6:0.08:0.3:tags", "dictionary is 'tags': expected one of"),
        ("aprilgrid:30x30:0.08:0.3", "apriltag_36h11 has 587 markers: expected 900 for 30x30 tags"),
    ],
)
def test_boards_that_cannot_be_are_refused(text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        parse_board(text)
