"""``perceptree data show``: pages of frames with their labels."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from perceptree.data import read_dataset
from perceptree.data.show import choose_frames, labelled_pages
from perceptree.drawing import BOX, OUTLINE

Content = dict[str, Any]
Edit = Callable[[Path, str, Callable[[Content], None]], None]
Call = Callable[..., tuple[int, str, str]]


def test_frames_are_drawn_by_seed_from_the_splits_in_turn(posts: Path) -> None:
    datasets = [read_dataset(posts, split) for split in ("train", "val", "test")]
    first, again, other = (choose_frames(datasets, 5, seed) for seed in (1, 1, 2))
    assert [split for split, _ in first] == ["train", "train", "val", "val", "test"]
    names = [[frame.image_path.name for _, frame in chosen] for chosen in (first, again, other)]
    assert names[0] == names[1] != names[2]
    everything = choose_frames(datasets, 50, 1)
    assert len({frame.image_path for _, frame in everything}) == 11


def test_pages_show_boxes_and_outlines_of_every_frame(posts: Path, edit_split: Edit) -> None:
    def widen(content: Content) -> None:  # else the posts' boxes hide their outlines
        for annotation in content["annotations"]:
            x, y, width, height = annotation["bbox"]
            annotation["bbox"] = [x - 4, y - 4, width + 8, height + 8]

    edit_split(posts, "train", widen)
    chosen = choose_frames([read_dataset(posts, "train")], 5, 3)
    pages = list(labelled_pages(chosen, 4))
    assert [page.shape[1] for page in pages] == [2 * 486 + 6, 486 + 6]
    page = pages[0][24:]
    for number in range(4):
        top, left = 6 + number // 2 * (page.shape[0] // 2), 6 + number % 2 * 486
        cell = page[top : top + 250, left : left + 480]
        assert (cell == BOX).all(-1).sum() > 200
        assert (cell == OUTLINE).all(-1).sum() > 200


def test_the_command_writes_the_requested_number_of_pages(
    posts: Path, tmp_path: Path, call: Call
) -> None:
    out = tmp_path / "new/pages"
    code, printed, _ = call(
        "data", "show", posts, "--out", out, "--pages", 2, "--per-page", 3, "--split", "train"
    )
    assert code == 0
    assert printed.split() == [str(out / "page_001.jpg"), str(out / "page_002.jpg")]
    assert sorted(path.name for path in out.iterdir()) == ["page_001.jpg", "page_002.jpg"]
    page = cv2.imread(str(out / "page_002.jpg"))
    assert page is not None
    assert page.shape[1] == 2 * 486 + 6
    assert np.ptp(page) > 150


def test_a_dataset_of_boxes_only_is_shown_with_its_notes(
    posts: Path, tmp_path: Path, edit_split: Edit, call: Call
) -> None:
    def change(content: Content) -> None:
        for annotation in content["annotations"]:
            del annotation["segmentation"], annotation["keypoints"]

    edit_split(posts, "val", change)
    code, _, err = call("data", "show", posts, "--split", "val", "--out", tmp_path / "pages")
    assert code == 0
    assert "val: the set has no masks" in err
    assert (tmp_path / "pages/page_001.jpg").is_file()


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("--per-page", 0), "--per-page is 0: expected at least 1"),
        (("--split", "dev"), "--split is 'dev': expected one of train, val, test"),
        (("--fold", 2), "in fold 2"),
    ],
)
def test_invalid_options_are_one_line(
    posts: Path, call: Call, arguments: tuple[object, ...], expected: str
) -> None:
    code, _, err = call("data", "show", posts, *arguments)
    assert code == 2
    assert expected in err
    assert err.count("\n") == 1
    assert not Path("pages").exists()
