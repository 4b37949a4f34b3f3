"""`evaluate_file` counts trees beyond the reach of the labels as users get them with a camera."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from stems_at_a_distance import CAMERA, HEIGHT, PAIR, PAIR_M, REACH_M, WIDTH, faked

from calib import CocoLabels, DepthEncoding, encode_depth, write_depth
from edgetree import TreeDetector
from edgetree.errors import InputError
from edgetree.evaluate import chances_within_reach, evaluate_file
from perceptree.data import read_dataset
from perceptree.keypoints import KEYPOINT_NAMES

ROOT = Path(__file__).parents[3]
NOTE = "scores of trees beyond 10 m are lowered, by the depth of 1 of 1 frame"


def dataset(folder: Path, **fields: Any) -> Path:
    """A frame with two stems of which only the one within reach is labelled."""
    manifest = faked(PAIR).manifest
    assert manifest.depth_encoding is not None
    encoding = DepthEncoding.from_dict(dict(manifest.depth_encoding))
    cv2.imwrite(str(folder / "a.png"), np.zeros((HEIGHT, WIDTH, 3), np.uint8))
    cv2.imwrite(str(folder / "a8.png"), encode_depth(PAIR_M, encoding))
    write_depth(folder / "a16.png", PAIR_M)
    labels = CocoLabels("tree", KEYPOINT_NAMES)
    labels.add_image("a.png", WIDTH, HEIGHT)
    points = np.tile(PAIR.boxes_px[0, :2], (5, 1))
    labels.add(PAIR.boxes_px[0], 1.0, PAIR.mask(0), points)
    content = labels.to_dict()
    content["images"][0] |= {
        "depth8_file": "a8.png",
        "depth_encoding": manifest.depth_encoding,
        "depth_file": "a16.png",
        "camera": CAMERA.to_dict(),
    } | fields
    (folder / "test_RGB.json").write_text(json.dumps(content))
    return folder


def evaluated(data: Path, reach_m: float | None = REACH_M) -> dict[str, Any]:
    return evaluate_file(faked(PAIR, reach_m), {"name": "faked"}, data, "test").figures


def test_a_tree_out_of_reach_is_no_false_positive(tmp_path: Path) -> None:
    figures = evaluated(dataset(tmp_path))

    assert (figures["at_score"]["found"], figures["at_score"]["invented"]) == (1, 0)
    assert NOTE in figures["data"]["notes"]


@pytest.mark.parametrize(
    "fields",
    [
        {"camera": None},
        {"camera": {"name": "a camera"}},
        {"camera": CAMERA.scaled(1280, 960).to_dict()},
        {"depth_file": None},
    ],
    ids=["no camera", "other words", "another size", "no metres"],
)
def test_without_metres_and_camera_it_counts(tmp_path: Path, fields: dict[str, Any]) -> None:
    figures = evaluated(dataset(tmp_path, **fields))

    assert (figures["at_score"]["found"], figures["at_score"]["invented"]) == (1, 1)
    assert NOTE not in figures["data"]["notes"]


def test_a_model_without_reach_counts_all(tmp_path: Path) -> None:
    assert evaluated(dataset(tmp_path), reach_m=None)["at_score"]["invented"] == 1


@pytest.mark.parametrize(("inputs", "noted"), [("both", 1), ("depth", 1), ("colour", 0)])
def test_a_model_of_both_counts_so_where_it_is_shown_depth(
    tmp_path: Path, inputs: str, noted: int
) -> None:
    frames = read_dataset(dataset(tmp_path), "test").frames
    manifest = TreeDetector.load(ROOT / "models/edge-s.onnx").manifest

    chances, notes = chances_within_reach(manifest, frames, inputs)

    assert len(notes) == noted
    assert (chances is not None) == bool(noted)


def test_a_colour_model_counts_all(tmp_path: Path) -> None:
    """A training on simulated frames tells the reach of colour models, too."""
    frames = read_dataset(dataset(tmp_path), "test").frames
    manifest = replace(TreeDetector.load("edge-n-rgb").manifest, reach_m=REACH_M)

    assert chances_within_reach(manifest, frames) == (None, ())


def test_depth_of_another_size_is_told(tmp_path: Path) -> None:
    data = dataset(tmp_path)
    write_depth(data / "a16.png", np.full((20, 30), 9.0))

    with pytest.raises(InputError, match=r"a16.png: is 30x20 px, expected 640x480, the size of a"):
        evaluated(data)
