"""Frames of a simulated dataset, read for the demonstration."""

import json
import re
from pathlib import Path

import pytest

import calib

pytest.importorskip("pycocotools")

from basetree.errors import InputError
from edgetree.demo.held_out import held_out_frames
from perceptree.errors import DatasetError

WIDTH, HEIGHT = 640, 384


def annotation(number: int, image_id: int, x_px: float) -> dict[str, object]:
    return {
        "id": number,
        "category_id": 1,
        "segmentation": [[x_px, 50.0, x_px + 20, 50.0, x_px + 20, 310.0, x_px, 310.0]],
        "image_id": image_id,
        "bbox": [x_px, 50.0, 20.0, 260.0],
        "keypoints": [
            x_px + 10,
            300,
            2,
            x_px,
            280,
            2,
            x_px + 20,
            280,
            2,
            0,
            0,
            0,
            x_px + 10,
            180,
            1,
        ],
        "diameter_m": 0.25,
        "cut_height_m": 0.2,
        "distance_m": 9.0,
        "inclination_deg": 1.0,
        "visible_fraction": 0.9,
        "species": "fir",
    }


@pytest.fixture
def data(tmp_path: Path) -> Path:
    """The labels of a dataset of three frames, as the simulator writes them."""
    camera = calib.PinholeCamera(WIDTH, HEIGHT, 500.0, 500.0, 319.5, 191.5)
    images, annotations = [], []
    for number in range(3):
        images.append(
            {
                "id": number,
                "width": WIDTH,
                "height": HEIGHT,
                "file_name": f"images/{number:06d}.jpg",
                "depth_file": f"depth/{number:06d}.png",
                "camera": camera.to_dict(),
                "up_camera": [0.0, -1.0, 0.0],
            }
        )
        annotations.append(annotation(number, number, 101.0))
    coco = {"images": images, "annotations": annotations}
    (tmp_path / "test_RGB.json").write_text(json.dumps(coco))
    return tmp_path


def test_frames_are_picked_evenly_and_keypoints_are_continuous(data: Path) -> None:
    frames = held_out_frames(data, "test", 2)
    assert [frame.name for frame in frames] == ["000000", "000002"]
    assert len(held_out_frames(data, "test", 9)) == 3
    (tree,) = frames[0].trees
    assert tree.box_px.tolist() == [101.0, 50.0, 121.0, 310.0]
    assert tree.keypoints_px[0].tolist() == [111.5, 300.5, 2.0]
    assert tree.keypoints_px[3].tolist() == [0.0, 0.0, 0.0]
    assert (tree.distance_m, tree.species) == (9.0, "fir")
    assert frames[0].depth_path == data / "depth/000000.png"
    assert frames[0].camera.width == WIDTH


def test_a_dataset_without_ground_truth_is_named(data: Path) -> None:
    path = data / "test_RGB.json"
    path.write_text(path.read_text().replace('"diameter_m"', '"other"'))
    with pytest.raises(InputError, match=r"has no 'diameter_m': expected a dataset of the sim"):
        held_out_frames(data, "test", 1)


@pytest.mark.parametrize("content", [None, "{", "{}", '{"images": [{"id": 1}], "annotations": []}'])
def test_a_broken_dataset_is_named(tmp_path: Path, content: str | None) -> None:
    if content is not None:
        (tmp_path / "test_RGB.json").write_text(content)
    with pytest.raises(DatasetError, match=re.escape(str(tmp_path))):
        held_out_frames(tmp_path, "test", 6)
