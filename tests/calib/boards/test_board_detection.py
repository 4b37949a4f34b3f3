"""Board detection: accuracy, and images without a board."""

from collections.abc import Callable

import cv2
import fake_boards as fake
import numpy as np
import pytest

from basetree.errors import InputError
from calib.boards import (
    Board,
    BoardDetections,
    CharucoBoard,
    Checkerboard,
    CircleGrid,
    Picture,
    find_boards,
    parse_board,
)


@pytest.mark.parametrize(
    ("board", "model", "rms_px"),
    [
        ("checkerboard", "radtan", 0.04),
        ("checkerboard", "fisheye", 0.05),
        ("charuco", "radtan", 0.07),
        ("charuco", "fisheye", 0.08),
        # The detected point of a circle is the centre of its ellipse.
        ("circles", "radtan", 0.06),
        ("circles", "fisheye", 0.14),
        ("asymmetric", "radtan", 0.06),
    ],
)
def test_points_are_detected_where_they_project(
    seen: Callable[[str, str], BoardDetections],
    board: str,
    model: str,
    rms_px: float,
) -> None:
    camera = fake.TRUTH[model]
    poses = fake.poses(camera, 14, seed=2)
    views = seen(board, model).views
    misses = []
    for view in views:
        pose = poses[int(view.name.removeprefix("picture"))]
        # A board without markers may be found upside down.
        orders = (view.object_m, view.object_m[::-1])
        turned = [fake.projected(camera, pose, order) - view.image_px for order in orders]
        misses.append(min(turned, key=lambda miss: float(np.abs(miss).sum())))
    assert len(views) >= 10
    miss_px = np.concatenate(misses)
    assert np.abs(miss_px.mean(0)).max() < rms_px / 2
    assert np.sqrt((miss_px**2).mean()) < rms_px
    assert np.abs(miss_px).max() < 1


def test_large_images_are_equally_accurate(
    pictures: Callable[[str, str], list[Picture]],
) -> None:
    grey = pictures("checkerboard", "radtan")[5].grey
    large = cv2.resize(grey, None, fx=4, fy=4, interpolation=cv2.INTER_CUBIC)
    found, found_large = fake.CHECKERBOARD.detect(grey), fake.CHECKERBOARD.detect(large)
    assert found is not None
    assert found_large is not None
    np.testing.assert_allclose(found_large[0] / 4, found[0], atol=0.06)


def test_part_of_a_charuco_board_is_enough(
    pictures: Callable[[str, str], list[Picture]],
) -> None:
    grey = pictures("charuco", "radtan")[5].grey.copy()
    whole = fake.BOARDS["charuco"].detect(grey)
    assert whole is not None
    image_px, object_m = whole
    grey[:, : int(np.median(image_px[:, 0]))] = 120
    part = fake.BOARDS["charuco"].detect(grey)
    assert part is not None
    assert 8 <= len(part[0]) < len(image_px)
    row = {tuple(corner): i for i, corner in enumerate(object_m)}
    same = [row[tuple(corner)] for corner in part[1]]
    np.testing.assert_allclose(part[0], image_px[same], atol=0.1)


def test_an_image_without_a_board_gives_none() -> None:
    noise = np.random.default_rng(0).integers(0, 256, (480, 640), np.uint8)
    for board in fake.BOARDS.values():
        assert board.detect(noise) is None
        assert board.detect(np.full((480, 640), 128, np.uint8)) is None


@pytest.mark.parametrize(
    ("text", "board"),
    [
        ("checkerboard:9x6:0.025", Checkerboard(9, 6, 0.025)),
        ("Charuco:8x6:0.03:0.022:4X4_50", CharucoBoard(8, 6, 0.03, 0.022, "4x4_50")),
        ("circles:7x5:0.02", CircleGrid(7, 5, 0.02)),
        ("circles:4x11:0.02:asymmetric", CircleGrid(4, 11, 0.02, asymmetric=True)),
    ],
)
def test_board_descriptions_are_parsed(text: str, board: Board) -> None:
    assert parse_board(text) == board


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("chess:9x6:0.025", "board is 'chess:9x6:0.025': expected one such as checkerboard:9x6"),
        ("checkerboard:9x6", "expected one such as"),
        ("checkerboard:9:0.025", "expected one such as"),
        ("circles:4x11:0.02:symmetric", "expected one such as"),
        ("checkerboard:9x2:0.025", "rows is 2: expected 3 to 100 inner corners"),
        ("checkerboard:9x6:25", "square_m is 25: expected metres, more than 0 and up to 2"),
        ("circles:9x6:nan", "spacing_m is nan: expected metres"),
        ("charuco:8x6:0.03:0.03:4x4_50", "marker_m is 0.03: expected less than square_m, 0.03"),
        ("charuco:8x6:0.03:0.02:9x9", "dictionary is '9x9': expected one of 4x4_100"),
        ("charuco:12x9:0.03:0.02:4x4_50", "4x4_50 has 50 markers: expected 54 for 12x9 squares"),
    ],
)
def test_invalid_board_descriptions_are_named(text: str, message: str) -> None:
    with pytest.raises(InputError) as caught:
        parse_board(text)
    assert message in str(caught.value)
    assert text in str(caught.value)
    assert "\n" not in str(caught.value)


def test_repeated_and_empty_images_are_listed(
    pictures: Callable[[str, str], list[Picture]],
) -> None:
    first, second = pictures("checkerboard", "radtan")[5:7]
    empty = Picture("empty", np.full((480, 640), 128, np.uint8))
    again = Picture("again", first.grey)
    seen = find_boards([first, empty, again, second], Checkerboard(9, 6, 0.025))
    assert [view.name for view in seen.views] == [first.name, second.name]
    assert (seen.width, seen.height, seen.pictures) == (640, 480, 4)
    assert (seen.without_board, seen.repeated) == (("empty",), ("again",))


def test_similar_video_frames_are_skipped(
    pictures: Callable[[str, str], list[Picture]],
) -> None:
    first, second = (picture.grey for picture in pictures("checkerboard", "radtan")[5:7])
    scenes = [(first, 0.0), (second, 0.1), (first, 0.3), (first, 0.6), (second, 1.0)]
    video = [Picture(f"at{time_s}", grey, time_s) for grey, time_s in scenes]
    seen = find_boards(video, Checkerboard(9, 6, 0.025))
    assert [view.name for view in seen.views] == ["at0.0", "at1.0"]
    assert (seen.pictures, seen.repeated) == (2, ())


def test_images_of_two_sizes_are_rejected(
    pictures: Callable[[str, str], list[Picture]],
) -> None:
    first = pictures("checkerboard", "radtan")[5]
    small = Picture("small", first.grey[:240, :320])
    with pytest.raises(InputError, match="small is 320x240 px: expected 640x480 px, as picture5"):
        find_boards([first, small], Checkerboard(9, 6, 0.025))


def test_no_images_give_no_views() -> None:
    seen = find_boards([], Checkerboard(9, 6, 0.025))
    assert (seen.views, seen.width, seen.height, seen.pictures) == ((), 0, 0, 0)
