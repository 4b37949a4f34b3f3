"""Labels of other tools and trainers: files as those programs write them, and the way back."""

import base64
import itertools
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from perceptree.data import FrameRecord, read_dataset
from perceptree.data.exchange.reading import read_any
from perceptree.data.exchange.writing import WRITTEN_FORMS
from perceptree.data.exchange.writing import write_dataset as write_anew
from perceptree.errors import DatasetError
from perceptree.keypoints import KEYPOINT_NAMES

Call = Callable[..., tuple[int, str, str]]

WIDTH, HEIGHT = 80, 60
SQUARE = [10, 20, 30, 20, 30, 50, 10, 50]
BOX = [10, 20, 30, 50]
CUT, LEFT, RIGHT, MIDDLE, TOP = (20, 48), (11, 45), (29, 45), (20, 35), (20, 22)
POINTS = dict(zip(KEYPOINT_NAMES, (CUT, LEFT, RIGHT, MIDDLE, TOP), strict=True))


def picture(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(
        str(path), np.random.default_rng(len(path.name)).integers(0, 255, (HEIGHT, WIDTH, 3))
    )
    return path


def only_frame(source: Path) -> FrameRecord:
    ((_, dataset),) = read_any(source)
    (frame,) = dataset.frames
    return frame


def check_tree(frame: FrameRecord, keypoints: bool = True, mask: bool = True) -> None:
    """The frame shows the one tree of all these tests."""
    assert frame.image_path.is_file()
    (tree,) = frame.trees
    np.testing.assert_allclose(tree.box_px, BOX, atol=0.6)
    if mask:
        pixels = np.zeros((HEIGHT, WIDTH), bool)
        pixels[20:50, 10:30] = True
        assert (frame.mask(tree) != pixels).sum() < 60
    if keypoints:
        np.testing.assert_allclose(tree.keypoints[:, :2], list(POINTS.values()), atol=0.01)
        assert tree.keypoints[:, 2].tolist() == [2, 2, 1, 2, 2]


def yolo_points() -> str:
    flags = (2, 2, 1, 2, 2)
    return " ".join(
        f"{x / WIDTH} {y / HEIGHT} {flag}"
        for (x, y), flag in zip(POINTS.values(), flags, strict=True)
    )


def test_yolo_pose_with_a_path_of_another_machine(tmp_path: Path) -> None:
    picture(tmp_path / "train/images/a.jpg")
    (tmp_path / "data.yaml").write_text(
        "train: ../train/images\nval: ../valid/images\nnc: 1\nnames: ['trunk']\n"
        "kpt_shape: [5, 3]\nflip_idx: [0, 2, 1, 3, 4]\n".replace("val: ../valid/images\n", "")
    )
    (tmp_path / "train/labels").mkdir()
    box = f"{20 / WIDTH} {35 / HEIGHT} {20 / WIDTH} {30 / HEIGHT}"
    (tmp_path / "train/labels/a.txt").write_text(f"0 {box} {yolo_points()}\n")
    ((split, dataset),) = read_any(tmp_path)
    assert split == "train"
    check_tree(dataset.frames[0], mask=False)


def test_yolo_polygons_without_settings(tmp_path: Path) -> None:
    picture(tmp_path / "images/a.jpg")
    picture(tmp_path / "images/no_trees.jpg")
    shares = " ".join(str(v / (WIDTH, HEIGHT)[place % 2]) for place, v in enumerate(SQUARE))
    (tmp_path / "labels").mkdir()
    (tmp_path / "labels/a.txt").write_text(f"1 {shares}\n")
    (tmp_path / "classes.txt").write_text("bush\nspruce\n")
    ((split, dataset),) = read_any(tmp_path)
    assert split is None
    assert [len(frame.trees) for frame in dataset.frames] == [1, 0]
    check_tree(dataset.frames[0], keypoints=False)
    assert "1 pictures have no label file: no trees" in dataset.notes


def test_yolo_without_settings_by_a_relative_path(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    picture(tmp_path / "set/images/a.jpg")
    (tmp_path / "set/labels").mkdir()
    (tmp_path / "set/labels/a.txt").write_text("0 0.5 0.5 0.2 0.4\n")
    monkeypatch.chdir(tmp_path)
    assert only_frame(Path("set")).image_path.name == "a.jpg"


def test_yolo_pictures_of_a_list(tmp_path: Path) -> None:
    picture(tmp_path / "images/train/a.jpg")
    (tmp_path / "train.txt").write_text("/home/other/images/train/a.jpg\n")
    (tmp_path / "data.yaml").write_text("path: /home/other\ntrain: train.txt\nnames:\n  0: tree\n")
    (tmp_path / "labels/train").mkdir(parents=True)
    box = f"0 {20 / WIDTH} {35 / HEIGHT} {20 / WIDTH} {30 / HEIGHT}\n"
    (tmp_path / "labels/train/a.txt").write_text(box)
    check_tree(only_frame(tmp_path), keypoints=False, mask=False)


def labelme_shape(label: str, kind: str, points: list[Any], **fields: Any) -> dict[str, Any]:
    shape: dict[str, Any] = {
        "label": label,
        "points": points,
        "group_id": None,
        "description": "",
        "flags": {},
    }
    return shape | {"shape_type": kind, "mask": None} | fields


def labelme_file(path: Path, shapes: list[dict[str, Any]]) -> None:
    picture(path.with_suffix(".jpg"))
    content: dict[str, Any] = {"version": "5.5.0", "flags": {}, "shapes": shapes, "imageData": None}
    content |= {"imagePath": path.with_suffix(".jpg").name}
    path.write_text(json.dumps(content | {"imageHeight": HEIGHT, "imageWidth": WIDTH}))


def labelme_points() -> list[dict[str, Any]]:
    return [
        labelme_shape(name, "point", [list(at)], flags={"hidden": name == "diameter_right"})
        for name, at in POINTS.items()
    ]


@pytest.mark.parametrize("number", ["1", "-1", "0.5"])
def test_yolo_classes_without_a_name_are_refused(tmp_path: Path, call: Call, number: str) -> None:
    folder = tmp_path / "yolo"
    picture(folder / "images/a.jpg")
    (folder / "labels").mkdir()
    (folder / "labels/a.txt").write_text(f"{number} 0.5 0.5 0.2 0.2")
    (folder / "data.yaml").write_text("train: images\nnames: [tree]")
    code, _, errors = call("data", "convert", folder, "--out", tmp_path / "out")
    assert code == 2
    assert (
        f"a.txt: line 1 is of class {number}, expected the number of one of names, 0 to 0" in errors
    )


def test_an_undivided_set_stays_undivided_in_yolo(
    write_dataset: Callable[..., Path], tmp_path: Path
) -> None:
    frames = read_dataset(write_dataset(train=3, val=1, test=1), "train").frames
    write_anew(tmp_path / "out", {None: frames}, "yolo-seg")
    ((split, dataset),) = read_any(tmp_path / "out")
    assert split is None
    assert len(dataset.frames) == 3


def test_labelme_polygon_and_points_without_a_group(tmp_path: Path) -> None:
    corners = np.reshape(SQUARE, (-1, 2)).tolist()
    far = labelme_shape("tree", "rectangle", [[60, 10], [75, 50]])
    stray = labelme_shape("felling_cut", "point", [[45, 5]])
    shapes = [far, labelme_shape("tree", "polygon", corners), *labelme_points(), stray]
    labelme_file(tmp_path / "a.json", shapes)
    ((_, dataset),) = read_any(tmp_path)
    other, tree = dataset.frames[0].trees
    np.testing.assert_allclose(other.box_px, [60, 10, 75, 50])
    assert not other.keypoints.any()
    np.testing.assert_allclose(tree.keypoints[:, :2], list(POINTS.values()))
    assert "left out: 1 point in no tree" in dataset.notes


def test_labelme_mask(tmp_path: Path) -> None:
    png = base64.b64encode(cv2.imencode(".png", np.ones((30, 20), np.uint8))[1].tobytes()).decode()
    shape = labelme_shape("tree", "mask", [[10, 20], [29, 49]], mask=png)
    labelme_file(tmp_path / "a.json", [shape, *labelme_points()])
    check_tree(only_frame(tmp_path))


def test_labelme_parts_of_one_group_are_one_tree(tmp_path: Path) -> None:
    upper = labelme_shape("tree", "rectangle", [[10, 20], [30, 34]], group_id=3)
    lower = labelme_shape("tree", "rectangle", [[10, 36], [30, 50]], group_id=3)
    labelme_file(tmp_path / "a.json", [upper, lower])
    frame = only_frame(tmp_path)
    check_tree(frame, keypoints=False)
    assert frame.mask(frame.trees[0]).sum() == 20 * 28


CVAT_POINTS = "".join(
    f'<points label="{name}" source="manual" outside="0" occluded="{int(name == "diameter_right")}"'
    f' points="{x:.2f},{y:.2f}"></points>'
    for name, (x, y) in POINTS.items()
)


def cvat_file(path: Path, shapes: str) -> None:
    picture(path.parent / "images/a.jpg")
    path.write_text(
        f'<?xml version="1.0" encoding="utf-8"?>\n<annotations><version>1.1</version>'
        f'<image id="0" name="a.jpg" width="{WIDTH}" height="{HEIGHT}" subset="Validation">{shapes}'
        "</image></annotations>"
    )


@pytest.mark.parametrize("grouped", [True, False])
def test_cvat_mask_and_points(tmp_path: Path, grouped: bool) -> None:
    group = 'group_id="4"' if grouped else ""
    mask = f'<mask label="tree" {group} rle="0, 600" left="10" top="20" width="20" height="30"/>'
    points = f'<skeleton label="tree" {group}>{CVAT_POINTS}</skeleton>' if grouped else CVAT_POINTS
    cvat_file(tmp_path / "annotations.xml", points + mask)
    ((split, dataset),) = read_any(tmp_path)
    assert split == "val"
    check_tree(dataset.frames[0])


def test_cvat_masks_of_one_group_are_one_tree(tmp_path: Path) -> None:
    masks = (
        f'<mask label="tree" group_id="7" rle="0, 300" left="10" top="{top}" width="20"'
        ' height="15"/>'
        for top in (20, 35)
    )
    cvat_file(tmp_path / "annotations.xml", "".join(masks))
    check_tree(only_frame(tmp_path), keypoints=False)


@pytest.mark.parametrize(
    ("shape", "box"),
    [
        # 20 x 30 px around (40, 35), a quarter turned.
        ('<box label="tree" xtl="30" ytl="20" xbr="50" ybr="50" rotation="90"/>', (25, 25, 55, 45)),
        ('<ellipse label="tree" cx="40" cy="35" rx="10" ry="15"/>', (30, 20, 50, 50)),
        (
            '<ellipse label="tree" cx="40" cy="35" rx="10" ry="15" rotation="90"/>',
            (25, 25, 55, 45),
        ),
    ],
)
def test_cvat_boxes_and_ellipses_may_be_turned(
    tmp_path: Path, shape: str, box: tuple[float, ...]
) -> None:
    cvat_file(tmp_path / "annotations.xml", shape)
    frame = only_frame(tmp_path)
    (tree,) = frame.trees
    np.testing.assert_allclose(tree.box_px, box, atol=0.1)
    share = np.pi / 4 if "ellipse" in shape else 1.0
    assert frame.mask(tree).sum() == pytest.approx(600 * share, rel=0.05)


def test_a_leaning_box_of_cvat_turns_clockwise(tmp_path: Path) -> None:
    shape = '<box label="tree" xtl="38" ytl="10" xbr="42" ybr="50" rotation="30"/>'
    cvat_file(tmp_path / "annotations.xml", shape)
    frame = only_frame(tmp_path)
    mask = frame.mask(frame.trees[0])
    assert mask[15, 48]  # its top leans to the right
    assert mask[45, 31]
    assert not mask[15, 32]


def test_cvat_shapes_that_are_no_region_are_told(tmp_path: Path) -> None:
    box = '<box label="tree" xtl="4" ytl="0" xbr="9" ybr="9"/>'
    cvat_file(tmp_path / "annotations.xml", box + "<cuboid/><cuboid/>")
    ((_, dataset),) = read_any(tmp_path)
    assert "left out: 2 cuboids" in " ".join(dataset.notes)


def test_cvat_mask_of_negative_size_is_refused(tmp_path: Path) -> None:
    mask = '<mask label="tree" rle="600" left="30" top="50" width="-20" height="-30"/>'
    cvat_file(tmp_path / "annotations.xml", mask)
    with pytest.raises(DatasetError, match="expected runs that fill its box"):
        read_any(tmp_path)


def test_cvat_skeleton_alone_has_the_box_of_its_points(tmp_path: Path) -> None:
    cvat_file(tmp_path / "annotations.xml", f'<skeleton label="tree">{CVAT_POINTS}</skeleton>')
    (tree,) = only_frame(tmp_path).trees
    np.testing.assert_allclose(tree.box_px, [11, 22, 29, 48])


def brush(mask: np.ndarray[Any, Any]) -> list[int]:
    """Pack a mask as Label Studio does: runs of equal bytes with lengths of 16 bits."""
    values = np.repeat(mask.reshape(-1, 1) * np.uint8(255), 4, 1).reshape(-1)
    bits = f"{len(values):032b}{7:05b}" + f"{15:04b}" * 4
    starts = [0, *(np.flatnonzero(np.diff(values)) + 1).tolist(), len(values)]
    for start, end in itertools.pairwise(starts):
        bits += f"100{end - start - 1:016b}{values[start]:08b}"
    bits += "0" * (-len(bits) % 8)
    return [int(bits[place : place + 8], 2) for place in range(0, len(bits), 8)]


def label_studio_result(kind: str, number: str, **value: Any) -> dict[str, Any]:
    sizes = {"original_width": WIDTH, "original_height": HEIGHT, "image_rotation": 0}
    return {"id": number, "type": kind, "to_name": "image", **sizes, "value": value}


def label_studio_file(path: Path, results: list[dict[str, Any]]) -> None:
    picture(path.parent / "images/a.jpg")
    annotations = [{"id": 2, "was_cancelled": False, "result": results}]
    data = {"image": "/data/local-files/?d=trees%2Fimages%2Fa.jpg"}
    path.write_text(json.dumps([{"id": 1, "data": data, "annotations": annotations}]))


def label_studio_points() -> list[dict[str, Any]]:
    found = []
    for name, (x, y) in POINTS.items():
        at = {"x": 100 * x / WIDTH, "y": 100 * y / HEIGHT, "width": 0.5}
        found.append(label_studio_result("keypointlabels", name, keypointlabels=[name], **at))
    return found


@pytest.mark.parametrize("kind", ["polygon", "brush", "rectangle"])
def test_label_studio(tmp_path: Path, kind: str) -> None:
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    mask[20:50, 10:30] = 1
    share = {"x": 12.5, "y": 100 / 3, "width": 25, "height": 50, "rotation": 0}
    percents = np.reshape(SQUARE, (-1, 2)) * 100 / [WIDTH, HEIGHT]
    regions = {
        "polygon": {"points": percents.tolist(), "polygonlabels": ["tree"]},
        "brush": {"format": "rle", "rle": brush(mask), "brushlabels": ["tree"]},
        "rectangle": {**share, "rectanglelabels": ["tree"]},
    }
    region = label_studio_result(f"{kind}labels", "r", **regions[kind])
    relations = [
        {"type": "relation", "from_id": name, "to_id": "r", "direction": "right"} for name in POINTS
    ]
    label_studio_file(tmp_path / "project-1.json", [*label_studio_points(), region, *relations])
    frame = only_frame(tmp_path)
    check_tree(frame, keypoints=False, mask=kind != "rectangle")
    np.testing.assert_allclose(frame.trees[0].keypoints[:, :2], list(POINTS.values()), atol=1e-6)


def test_label_studio_shapes_need_the_size_of_their_picture(tmp_path: Path, call: Call) -> None:
    value = {"points": [[10, 10], [20, 10], [20, 60]], "polygonlabels": ["tree"]}
    region = label_studio_result("polygonlabels", "r", **value)
    del region["original_width"], region["original_height"]
    label_studio_file(tmp_path / "in" / "project-1.json", [region])
    code, _, errors = call("data", "convert", tmp_path / "in", "--out", tmp_path / "out")
    assert code == 2
    assert "has shapes without original_width and original_height, expected both" in errors


@pytest.mark.parametrize(("form", "lost"), [("yolo-pose", "masks"), ("yolo-seg", "keypoints")])
def test_what_a_yolo_form_cannot_hold_is_told(
    write_dataset: Callable[..., Path], tmp_path: Path, call: Call, form: str, lost: str
) -> None:
    source = write_dataset(train=2, val=1, test=1)
    code, _, errors = call("data", "convert", source, "--out", tmp_path / "out", "--to", form)
    assert code == 0, errors
    assert re.search(rf"left out: the {lost} of \d+ trees, for which this form has no", errors)
    assert "left out: depth and metric values of 4 frames" in errors


@pytest.mark.parametrize("form", WRITTEN_FORMS)
def test_what_is_written_is_read_again(
    write_dataset: Callable[..., Path], tmp_path: Path, form: str
) -> None:
    source = write_dataset(train=3, val=1, test=0)
    before = {split: read_dataset(source, split) for split in ("train", "val")}
    frames: dict[str | None, list[FrameRecord]] = {
        split: dataset.frames for split, dataset in before.items()
    }
    out = tmp_path / "out"
    write_anew(out, frames, form)
    after = dict(read_any(out))
    assert set(after) == {"train", "val"}
    for split, dataset in after.items():
        assert len(dataset.frames) == len(frames[split])
        for one, other in zip(frames[split], dataset.frames, strict=True):
            assert other.image_path.read_bytes() == one.image_path.read_bytes()
            assert len(other.trees) == len(one.trees)
            for tree, copy in zip(one.trees, other.trees, strict=True):
                np.testing.assert_allclose(copy.box_px, tree.box_px, atol=1.5)
                if form in ("coco", "labelme", "yolo-pose"):
                    np.testing.assert_allclose(copy.keypoints, tree.keypoints, atol=0.01)
                if form in ("coco", "labelme", "yolo-seg"):
                    first, second = one.mask(tree), other.mask(copy)
                    assert (first & second).sum() > 0.9 * (first | second).sum()
                if form == "coco":
                    assert copy.truth == tree.truth


@pytest.mark.parametrize(
    ("name", "content", "expected"),
    [
        ("data.yaml", "train: elsewhere\nnames: [tree]", "expected a folder of pictures beside"),
        ("data.yaml", "names: [tree]", "expected train, val or test"),
        ("data.yaml", "kpt_shape: [5, 4]\ntrain: images", "expected the number of keypoints"),
        ("labels/a.txt", "0 0.5 0.5", "line 1 has 3 numbers"),
        ("labels/a.txt", "0 0.5 0.5 0.5 x", "is 'x', expected a finite number"),
        ("labels/a.txt", "0 30 20 10 10", "line 1 has the coordinate 30, expected shares"),
        (
            "labels/a.txt",
            "0 0.5 0.5 0.1 0.1 0.5 0.5 0.93",
            "line 1 has the visibility 0.93, expected 0, 1 or 2",
        ),
        ("a.xml", "<annotations><image", "not readable XML"),
        ("a.xml", "<!DOCTYPE a [<!ENTITY b 'c'>]><annotations/>", "declares entities"),
        ("a.json", '{"shapes": [{"points": 3}], "imagePath": "a.jpg"}', "no list of x and y"),
    ],
)
def test_broken_labels_are_one_line(
    tmp_path: Path, call: Call, name: str, content: str, expected: str
) -> None:
    folder = tmp_path / "labels of a tool"
    picture(folder / "images/a.jpg")
    picture(folder / "a.jpg")
    (folder / name).parent.mkdir(exist_ok=True)
    (folder / name).write_text(content)
    if "visibility" in expected:
        settings = "kpt_shape: [1, 3]\ntrain: images\nnames: [tree]"
        (folder / "data.yaml").write_text(settings)
    code, _, errors = call("data", "convert", folder, "--out", tmp_path / "out")
    assert code == 2
    assert name.rpartition("/")[2] in errors
    assert expected in errors
    assert len(errors.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_a_broken_entry_is_left_out_on_request(tmp_path: Path, call: Call) -> None:
    folder = tmp_path / "cvat"
    polygon = '<polygon label="tree" points="10,20;30,20;30,50;10,50"/>'
    cvat_file(folder / "a.xml", polygon + '<box label="tree" xtl="4" ytl="0" xbr="9" ybr="9"/>')
    command = ("data", "convert", folder, "--out", tmp_path / "out")
    code, _, errors = call(*command)
    assert (code, "--skip-broken" in errors) == (2, True)
    code, _, errors = call(*command, "--skip-broken")
    assert (code, "left out 1 broken entries" in errors) == (0, True)
    check_tree(only_frame(tmp_path / "out"), keypoints=False)


def test_a_folder_that_holds_something_is_not_written_to(
    write_dataset: Callable[..., Path], call: Call, tmp_path: Path
) -> None:
    source = write_dataset(train=1, val=1, test=0)
    (tmp_path / "out").mkdir()
    (tmp_path / "out/mine.txt").touch()
    for out in (tmp_path / "out", source):
        code, _, errors = call("data", "convert", source, "--out", out)
        assert (code, "expected a new folder" in errors) == (2, True)
    with pytest.raises(DatasetError, match="expected labels"):
        read_any(tmp_path / "nothing")
