"""``perceptree predict``: annotated images and COCO labels."""

import json
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from schema_check import check_schema

import calib
from perceptree.data import read_split
from perceptree.evaluation import pictures as evaluation_pictures
from perceptree.keypoints import KEYPOINT_NAMES
from perceptree.models import TreeRCNN, make_spec, save_checkpoint

Result = tuple[int, str, str]
Call = Callable[..., Result]


def sure_model(modality: str) -> TreeRCNN:
    """Random weights that detect trees everywhere with high scores."""
    torch.manual_seed(3)
    changes = {"fpn_width": 32, "backbone": "mobilenetv4_conv_small"}
    spec = make_spec("edge-n", modality, 64, 96, **changes)  # type: ignore[arg-type]
    model = TreeRCNN(spec)
    with torch.no_grad():
        model.box_head.score.bias[0] += 4.0
    return model.eval()


@pytest.fixture(scope="module")
def checkpoints(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("checkpoints")
    paths = {modality: folder / f"{modality}.safetensors" for modality in ("rgb", "depth")}
    for modality, path in paths.items():
        save_checkpoint(path, sure_model(modality), {"data": "none"})
    return paths


@pytest.fixture
def pictures(tmp_path: Path) -> Path:
    """Images of different sizes, two of which share a stem."""
    folder = tmp_path / "pictures"
    folder.mkdir()
    rng = np.random.default_rng(0)
    for name, (height, width) in {
        "a.jpg": (90, 120),
        "a.png": (64, 96),
        "b.png": (200, 60),
    }.items():
        cv2.imwrite(str(folder / name), rng.integers(0, 255, (height, width, 3), np.uint8))
    (folder / "notes.txt").write_text("no picture")
    return folder


def test_a_folder_gives_drawings_and_labels(
    call: Call, checkpoints: dict[str, Path], pictures: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    code, printed, told = call("predict", checkpoints["rgb"], pictures, "--out", out, "--json")
    assert (code, told) == (0, "")
    result = json.loads(printed)
    assert result["pictures"] == 3
    labels = json.loads(Path(result["labels"]).read_text())
    assert result["trees"] == len(labels["annotations"]) > 0
    assert [image["file_name"] for image in labels["images"]] == ["a.jpg", "a.png", "b.png"]
    assert [image["width"] for image in labels["images"]] == [120, 96, 60]
    assert sorted(path.name for path in out.iterdir()) == [
        "a.jpg_trees.jpg",
        "a.png_trees.jpg",
        "b_trees.jpg",
        "labels.json",
    ]
    assert cv2.imread(str(out / "b_trees.jpg")).shape[1] == 60
    assert all(annotation["score"] >= 0.5 for annotation in labels["annotations"])
    assert labels["categories"][0]["keypoints"] == list(KEYPOINT_NAMES)
    polygons = [part for annotation in labels["annotations"] for part in annotation["segmentation"]]
    assert polygons
    assert all(isinstance(part, list) and len(part) >= 6 for part in polygons)


def test_corrected_labels_can_be_trained_on(
    call: Call, checkpoints: dict[str, Path], pictures: Path, tmp_path: Path
) -> None:
    """The data reader accepts the written labels, with the same coordinates."""
    for more in ((), ("--rle",)):
        out = tmp_path / f"out{len(more)}"
        assert call("predict", checkpoints["rgb"], pictures, "--out", out, *more)[0] == 0
        shutil.copy(out / "labels.json", pictures / "train_RGB.json")
        frames = read_split(pictures, "train")
        annotations = json.loads((out / "labels.json").read_text())["annotations"]
        first = frames[0].trees[0]
        x, y, width, height = annotations[0]["bbox"]
        assert first.box_px.tolist() == pytest.approx([x, y, x + width, y + height])
        labelled = first.keypoints[:, 2] == 2
        assert labelled.sum() == annotations[0]["num_keypoints"] > 0
        area = annotations[0]["area"]
        assert frames[0].mask(first).sum() == pytest.approx(area, rel=0.0 if more else 0.2)
        (pictures / "train_RGB.json").unlink()


def test_a_higher_threshold_keeps_fewer_trees(
    call: Call, checkpoints: dict[str, Path], pictures: Path, tmp_path: Path
) -> None:
    counts = []
    for score in (0.0, 0.5, 1.0):
        arguments = ("--out", tmp_path / "out", "--score-threshold", score, "--json")
        counts.append(json.loads(call("predict", checkpoints["rgb"], pictures, *arguments)[1]))
    trees = [count["trees"] for count in counts]
    assert trees[0] >= trees[1] > trees[2] == 0


def test_depth_is_read_in_millimetres_and_8_bit(
    call: Call, checkpoints: dict[str, Path], tmp_path: Path
) -> None:
    depth_m = np.tile(np.linspace(0.5, 19, 96, dtype=np.float32), (64, 1))
    depth_m[:9] = 0
    found = []
    for name in ("mm", "grey"):
        folder = tmp_path / name
        folder.mkdir()
        if name == "mm":
            calib.write_depth(folder / "a.png", depth_m)
        else:
            grey = calib.encode_depth(np.round(depth_m, 3), calib.DepthEncoding())
            cv2.imwrite(str(folder / "a.png"), grey)
        out = tmp_path / f"{name}_out"
        assert call("predict", checkpoints["depth"], folder, "--out", out)[0] == 0
        labels = json.loads((out / "labels.json").read_text())
        check_schema(labels, "calib.found-labels")
        found.append(labels["annotations"])
    assert found[0] == found[1] != []


MISTAKES = {
    "no folder": (("{f}/none", "--out", "{t}/o"), "none: no such folder"),
    "no pictures": (("{t}", "--out", "{t}/o"), "no images, expected .jpg"),
    "over itself": (("{f}", "--out", "{f}"), "the folder of the images: expected another"),
    "score": (("{f}", "--out", "{t}/o", "--score-threshold", "7"), "is 7.0: expected 0 to 1"),
    "device": (("{f}", "--out", "{t}/o", "--device", "tpu"), "--device is 'tpu'"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_an_error_is_one_line(
    call: Call, checkpoints: dict[str, Path], pictures: Path, tmp_path: Path, mistake: str
) -> None:
    arguments, expected = MISTAKES[mistake]
    filled = (part.format(f=pictures, t=tmp_path) for part in arguments)
    code, printed, told = call("predict", checkpoints["rgb"], *filled)
    assert (code, printed) == (2, "")
    assert told.count("\n") == 1
    assert expected in told


def test_invalid_images_are_named(
    call: Call, checkpoints: dict[str, Path], pictures: Path, tmp_path: Path
) -> None:
    code, _, told = call("predict", checkpoints["depth"], pictures, "--out", tmp_path / "o")
    assert code == 2
    assert "a.jpg: a colour image, expected depth for this model: one channel, 16-bit" in told
    (pictures / "broken.jpg").write_bytes(b"no picture at all")
    code, _, told = call("predict", checkpoints["rgb"], pictures, "--out", tmp_path / "o")
    assert code == 1
    assert "broken.jpg: not a readable image" in told
    assert told.endswith("1 of 4 images left out, see above\n")
    labels = json.loads((tmp_path / "o" / "labels.json").read_text())
    assert [image["file_name"] for image in labels["images"]] == ["a.jpg", "a.png", "b.png"]


def test_an_interrupt_keeps_the_labels_so_far(
    call: Call,
    checkpoints: dict[str, Path],
    pictures: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found = evaluation_pictures.detect_pictures

    def interrupted(*arguments: Any) -> Iterator[Any]:
        yield next(found(*arguments))
        raise KeyboardInterrupt

    monkeypatch.setattr(evaluation_pictures, "detect_pictures", interrupted)
    out = tmp_path / "out"
    assert call("predict", checkpoints["rgb"], pictures, "--out", out)[0] == 130
    labels = json.loads((out / "labels.json").read_text())
    assert [image["file_name"] for image in labels["images"]] == ["a.jpg"]
    assert (out / "a.jpg_trees.jpg").is_file()
