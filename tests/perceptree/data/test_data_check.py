"""``perceptree data check``: every kind of problem, and a clean dataset."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from pycocotools import mask as coco_mask

from perceptree.data.check import Check, Report, leakage
from perceptree.data.check.findings import KINDS
from perceptree.data.check.leakage import SAME_PICTURE_BITS
from perceptree.data.check.pictures import signature

Content = dict[str, Any]
Edit = Callable[[Path, str, Callable[[Content], None]], None]
Damage = Callable[[Path, Edit], None]
Picture = NDArray[np.uint8]


def _found(directory: Path) -> dict[str, tuple[int, str]]:
    """Return count and first name by kind."""
    return {
        finding.kind: (finding.count, finding.first[0])
        for finding in Check(directory).run().findings
    }


def _set(number: int, *fields: Any) -> Damage:
    """Set fields of an annotation of val, given as name, value, ..."""
    changes = dict(zip(fields[::2], fields[1::2], strict=True))

    def damage(posts: Path, edit: Edit) -> None:
        edit(posts, "val", lambda content: content["annotations"][number].update(changes))

    return damage


def _points(**changes: list[float]) -> Damage:
    """Change keypoints of annotation 1 of val, by their index."""

    def damage(posts: Path, edit: Edit) -> None:
        def change(content: Content) -> None:
            points = content["annotations"][0]["keypoints"]
            for place, point in changes.items():
                k = int(place[1:])
                points[3 * k : 3 * k + 3] = point

        edit(posts, "val", change)

    return damage


def _swap(posts: Path, edit: Edit) -> None:
    def change(content: Content) -> None:
        points = content["annotations"][2]["keypoints"]
        points[3:9] = points[6:9] + points[3:6]

    edit(posts, "val", change)


def _corners(posts: Path, edit: Edit) -> None:
    def change(content: Content) -> None:
        left, top, wide, high = content["annotations"][0]["bbox"]
        content["annotations"][0]["bbox"] = [left, top, left + wide, top + high]

    edit(posts, "val", change)


def _mask(*area: slice) -> Damage:
    mask = np.zeros((72, 128), np.uint8, order="F")
    mask[area] = 1
    runs = coco_mask.encode(mask)
    return _set(0, "segmentation", {"size": [72, 128], "counts": runs["counts"].decode()})


def _unlink(name: str) -> Damage:
    return lambda posts, edit: (posts / name).unlink()


def _cut_off(name: str) -> Damage:
    def damage(posts: Path, edit: Edit) -> None:
        data = (posts / name).read_bytes()
        (posts / name).write_bytes(data[: len(data) * 2 // 3])

    return damage


def _picture(name: str, shape: tuple[int, ...]) -> Damage:
    def damage(posts: Path, edit: Edit) -> None:
        assert cv2.imwrite(str(posts / name), np.zeros(shape, np.uint8))

    return damage


def _load(posts: Path, name: str) -> Picture:
    image = cv2.imread(str(posts / name))
    assert image is not None
    return np.asarray(image, np.uint8)


def _jpeg_cut_off(posts: Path, edit: Edit) -> None:
    image = _load(posts, "images/000006.png")
    data = bytes(cv2.imencode(".jpg", image)[1])
    (posts / "images/000006.png").write_bytes(data[:-200])


_WHOLE, _WHOLE_BOX = [70, 8, 80, 8, 80, 60, 70, 60], [70, 8, 10, 52]
PICTURE, DEPTH = "images/000006.png", "depth8/000006.png"
FAULTS: dict[str, tuple[Damage, str, str]] = {
    "entry": (_set(1, "bbox", [1, 2]), "entry", "val_RGB.json: bbox of annotation 2 is [1, 2]"),
    "nothing": (
        _set(3, "bbox", [], "segmentation", None, "keypoints", []),
        "no_content",
        "val ann",
    ),
    "no_area": (_set(3, "bbox", [4, 8, 0, -5]), "box_empty", "val annotation 4"),
    "part": (
        _set(3, "segmentation", [_WHOLE, [1, 2, 3, 4]], "bbox", _WHOLE_BOX),
        "polygon_short",
        "val annotation 4",
    ),
    "line": (_set(3, "segmentation", [[1, 2, 3, 2, 5, 2]]), "mask_short", "val annotation 4"),
    "missing": (_unlink(PICTURE), "image_missing", PICTURE),
    "cut_off": (_cut_off(PICTURE), "image_broken", PICTURE),
    "jpeg": (_jpeg_cut_off, "image_broken", PICTURE),
    "size": (_picture(PICTURE, (36, 64, 3)), "image_size", PICTURE),
    "depth_missing": (_unlink(DEPTH), "depth_missing", DEPTH),
    "depth_broken": (_cut_off(DEPTH), "depth_broken", DEPTH),
    "depth16_broken": (_cut_off("depth/000006.png"), "depth_broken", "depth/000006.png"),
    "depth_colour": (_picture(DEPTH, (72, 128, 3)), "depth_broken", DEPTH),
    "depth_size": (_picture(DEPTH, (36, 64)), "depth_size", DEPTH),
    "box": (_set(0, "bbox", [10, 8, 200, 52]), "box_outside", "val 000006.png annotation 1"),
    "runs": (
        _set(0, "segmentation", {"size": [72, 128], "counts": [5, 5]}),
        "mask_broken",
        "val 000006.png annotation 1",
    ),
    "empty": (_mask(slice(0), slice(0)), "mask_empty", "val 000006.png annotation 1"),
    "elsewhere": (
        _mask(slice(60, 70), slice(100, 127)),
        "mask_outside_box",
        "val 000006.png annotation 1",
    ),
    "corners": (_corners, "box_of_corners", "val 000006.png annotation 1"),
    "far": (_points(k0=[99999, 20, 2]), "keypoint_outside", "val annotation 1 at 99999, 20"),
    "swapped": (_swap, "left_right_swapped", "val 000007.png annotation 3"),
    "cut": (_points(k0=[40, 20, 2]), "cut_above_middle", "val 000006.png annotation 1"),
    "middle": (_points(k4=[40, 50, 1]), "middle_above_top", "val 000006.png annotation 1"),
}


def test_a_clean_dataset_has_no_findings(posts: Path) -> None:
    report = Check(posts).run()
    assert report.findings == ()
    assert [(split.split, split.frames, split.trees) for split in report.splits] == [
        ("train", 6, 9),
        ("val", 3, 4),
        ("test", 2, 3),
    ]
    assert report.compared_by == "picture"


@pytest.mark.parametrize("fault", FAULTS)
def test_a_problem_is_found_counted_and_named(posts: Path, edit_split: Edit, fault: str) -> None:
    damage, kind, name = FAULTS[fault]
    damage(posts, edit_split)
    found = _found(posts)
    assert found.keys() == {kind}
    count, first = found[kind]
    assert count == 1
    assert name in first


def test_every_kind_of_label_and_file_problem_is_tested() -> None:
    assert {kind for _, kind, _ in FAULTS.values()} == {
        kind for kind in KINDS if not kind.endswith(("_in_splits", "_alone"))
    }


def test_many_problems_are_counted_and_the_first_named(posts: Path) -> None:
    for picture in (posts / "images").glob("*.png"):
        picture.unlink()
    (finding,) = Check(posts).run().findings
    assert finding.count == 11
    assert [Path(name).name for name in finding.first] == [f"00000{n}.png" for n in range(5)]
    assert str(finding).endswith("and 6 more")


def test_left_and_right_of_a_leaning_tree_are_not_reported(posts: Path, edit_split: Edit) -> None:
    # It leans far right: its left edge is the upper one, slightly right of the lower edge.
    leaning = _points(k0=[60, 40, 2], k1=[62, 36, 2], k2=[61, 46, 2], k3=[80, 38, 2], k4=[0, 0, 0])
    leaning(posts, edit_split)
    assert Check(posts).run().findings == ()


def _reuse(change: Callable[[Picture], Picture]) -> Damage:
    """Put a changed copy of a training image into test."""

    def damage(posts: Path, edit: Edit) -> None:
        image = _load(posts, "images/000002.png")
        cv2.imwrite(str(posts / "images/000010.png"), change(image))

    return damage


@pytest.mark.parametrize(
    "change",
    [
        lambda image: image,
        lambda image: cv2.convertScaleAbs(image, alpha=1.2, beta=8),
        lambda image: cv2.imdecode(cv2.imencode(".jpg", image)[1], cv2.IMREAD_COLOR),
    ],
    ids=["copied", "brightened", "packed"],
)
def test_a_nearly_identical_image_in_another_split_is_found(
    posts: Path,
    edit_split: Edit,
    monkeypatch: pytest.MonkeyPatch,
    change: Callable[[Any], Any],
) -> None:
    monkeypatch.setattr(leakage, "_PAIRS_AT_ONCE", 6)  # a picture of test at a time
    _reuse(change)(posts, edit_split)
    assert _found(posts) == {
        "picture_in_splits": (1, "000010.png of test is like 000002.png of train")
    }


def test_signatures_match_for_scaled_images_only() -> None:
    rng = np.random.default_rng(1)
    images = [
        np.asarray(cv2.resize(rng.integers(0, 255, (18, 32, 3), np.uint8), (640, 360)), np.uint8)
        for _ in range(20)
    ]
    bits = np.array([signature(image) for image in images])
    assert bits.shape == (20, 8)
    for image, known in zip(images, bits, strict=True):
        small = cv2.resize(image, (250, 140), interpolation=cv2.INTER_AREA)
        scaled = signature(np.asarray(small, np.uint8))
        differing = np.bitwise_count(bits ^ scaled).sum(1)
        assert np.bitwise_count(known ^ scaled).sum() <= SAME_PICTURE_BITS
        assert (differing <= SAME_PICTURE_BITS).sum() == 1


def test_a_file_in_two_splits_is_found(posts: Path, edit_split: Edit) -> None:
    edit_split(posts, "test", lambda c: c["images"][0].update(file_name="images/000001.png"))
    found = _found(posts)
    assert found["file_in_splits"] == (1, "000001.png in train and test")


def _name_scenes(posts: Path, edit_split: Edit, test_seed: int) -> Report:
    for split, first in (("train", 100), ("val", 200), ("test", test_seed)):

        def change(content: Content, first: int = first) -> None:
            for number, image in enumerate(content["images"]):
                image["scene"] = {"seed": first + number // 2}

        edit_split(posts, split, change)
    return Check(posts).run()


def test_scenes_are_compared_if_every_frame_names_its_scene(posts: Path, edit_split: Edit) -> None:
    # Similar views of different scenes are not leakage.
    shutil.copy(posts / "images/000002.png", posts / "images/000009.png")
    report = _name_scenes(posts, edit_split, 300)
    assert (report.findings, report.compared_by) == ((), "scene")
    (finding,) = _name_scenes(posts, edit_split, 102).findings
    assert (finding.kind, finding.count) == ("scene_in_splits", 1)
    assert finding.first == ("scene 102 in train (000004.png) and test (000009.png)",)


def test_the_command_prints_findings_and_sets_the_exit_code(
    posts: Path, edit_split: Edit, call: Callable[..., tuple[int, str, str]]
) -> None:
    code, out, _ = call("data", "check", posts)
    assert code == 0
    assert (
        f"train {posts / 'train_RGB.json'}: 6 frames, 9 trees, with masks, keypoints, depth" in out
    )
    assert "nothing found" in out
    (posts / "images/000001.png").unlink()
    code, out, _ = call("data", "check", posts)
    assert code == 1
    assert f"1 colour images missing: train {posts / 'images/000001.png'}" in out
    code, out, _ = call("data", "check", posts, "--json")
    assert code == 1
    report = json.loads(out)
    assert report["findings"][0]["kind"] == "image_missing"
    assert [split["frames"] for split in report["splits"]] == [6, 3, 2]
    (posts / "val_RGB.json").write_text("{")
    code, out, err = call("data", "check", posts)
    assert (code, out) == (2, "")
    assert "val_RGB.json: not readable JSON" in err
    assert err.count("\n") == 1
