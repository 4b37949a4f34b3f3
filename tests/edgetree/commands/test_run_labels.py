"""Tests of `edgetree run --coco`: COCO labels from detections."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from edgetree.detections import KEYPOINT_NAMES

Cli = Callable[..., Any]


def test_a_folder_becomes_a_coco_data_set(
    run_cli: Cli, model: Path, images: Path, tmp_path: Path
) -> None:
    labels = tmp_path / "labels.json"
    done = run_cli("run", images, "--model", model, "--coco", labels, "--json")
    assert done.code == 0
    assert json.loads(done.out)["coco"] == str(labels)
    content = json.loads(labels.read_text())
    assert [image["file_name"] for image in content["images"]] == ["a.jpg", "b.jpg"]
    assert [(image["width"], image["height"]) for image in content["images"]] == [(640, 360)] * 2
    first, second = content["annotations"]  # the one clear tree of each picture
    assert (first["image_id"], second["image_id"]) == (1, 2)
    assert first["bbox"] == [100, 50, 20, 260]
    assert first["score"] == pytest.approx(0.9)
    # In COCO files, keypoints are pixel indices.
    assert first["keypoints"][:3] == [109.5, 299.5, 2]
    assert first["num_keypoints"] == 5
    (category,) = content["categories"]
    assert category["keypoints"] == list(KEYPOINT_NAMES)
    assert category["skeleton"] == [[1, 4], [4, 5], [2, 3]]


def test_a_lower_threshold_gives_more_labels(
    run_cli: Cli, model: Path, images: Path, tmp_path: Path
) -> None:
    labels = tmp_path / "labels.json"
    done = run_cli(
        "run",
        images,
        "--model",
        model,
        "--coco",
        labels,
        "--score-threshold",
        "0.2",
        "--jsonl",
        tmp_path / "lines",
    )
    assert done.code == 0
    assert f"labels: {labels}" in done.err
    content = json.loads(labels.read_text())
    assert len(content["annotations"]) == 4
    assert "model.onnx finds with a score of at least 0.2" in content["info"]["description"]


def test_a_failed_run_keeps_the_old_labels(
    run_cli: Cli, model: Path, images: Path, tmp_path: Path
) -> None:
    labels = tmp_path / "labels.json"
    labels.write_text("corrected by hand")
    (images / "c.jpg").write_bytes(b"no picture")
    options = ("--model", model, "--coco", labels, "--strict-frames")
    assert run_cli("run", images, *options).code == 2
    assert labels.read_text() == "corrected by hand"


def test_labels_for_a_video_are_rejected(run_cli: Cli, model: Path, tmp_path: Path) -> None:
    video = tmp_path / "film.avi"
    writer = cv2.VideoWriter(str(video), cv2.VideoWriter.fourcc(*"MJPG"), 5, (64, 48))
    writer.write(np.zeros((48, 64, 3), np.uint8))
    writer.release()
    done = run_cli("run", video, "--model", model, "--coco", tmp_path / "labels.json")
    assert done.code == 2
    assert "is a video: expected images, as --coco is given" in done.err
    assert done.err.count("\n") == 1


def test_labels_do_not_overwrite_other_outputs(
    run_cli: Cli, model: Path, images: Path, tmp_path: Path
) -> None:
    same = tmp_path / "same"
    done = run_cli("run", images, "--model", model, "--coco", same, "--jsonl", same)
    assert done.code == 2
    assert "--coco is" in done.err
