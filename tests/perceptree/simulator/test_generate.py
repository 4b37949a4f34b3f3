"""Datasets: one seed gives the same bytes, interruptions lose nothing, splits share nothing."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

import calib
from perceptree.errors import DatasetError
from perceptree.simulator import (
    CameraSettings,
    SimulatorSettings,
    StandSettings,
    generate,
    generate_dataset,
)

SETTINGS = SimulatorSettings(
    camera=CameraSettings(width=128, height=72),
    stand=StandSettings(stems_per_ha=(300, 300)),
    views_per_scene=2,
)


def contents(directory: Path) -> dict[str, bytes]:
    files = sorted(path for path in directory.rglob("*") if path.is_file())
    return {str(path.relative_to(directory)): path.read_bytes() for path in files}


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("forest")
    generate_dataset(directory, 7, SETTINGS, seed=3, workers=1)
    return directory


def read(directory: Path, split: str) -> dict:
    return json.loads((directory / f"{split}_RGB.json").read_text())


def test_every_frame_is_on_disk_and_no_scene_is_in_two_splits(dataset: Path):
    scenes: dict[str, set[int]] = {}
    frames = 0
    for split in ("train", "val", "test"):
        images = read(dataset, split)["images"]
        scenes[split] = {image["scene"]["seed"] for image in images}
        frames += len(images)
        for image in images:
            depth_m = calib.read_depth(dataset / image["depth_file"])
            eight_bit = cv2.imread(str(dataset / image["depth8_file"]), cv2.IMREAD_UNCHANGED)
            encoding = calib.DepthEncoding.from_dict(image["depth_encoding"])
            again = calib.encode_depth(depth_m, encoding).astype(int)
            assert depth_m.shape == (72, 128)
            assert np.abs(again - eight_bit).max() <= 1
            assert cv2.imread(str(dataset / image["file_name"])).shape == (72, 128, 3)
    assert frames == 7
    assert not scenes["train"] & scenes["val"] | scenes["train"] & scenes["test"]
    assert not scenes["val"] & scenes["test"]


def test_labels_carry_metres_and_keypoints_inside_the_frame(dataset: Path):
    trees = [
        tree for split in ("train", "val", "test") for tree in read(dataset, split)["annotations"]
    ]
    assert trees
    for tree in trees:
        assert 0 < tree["distance_m"] <= 10
        assert 0.02 < tree["diameter_m"] < 1.5
        assert tree["cut_height_m"] == pytest.approx(0.20)
        x, y, flag = np.array(tree["keypoints"]).reshape(5, 3).T
        assert tree["num_keypoints"] == (flag > 0).sum()
        assert ((x >= -0.5) & (x < 127.5) & (y >= -0.5) & (y < 71.5)).all()


def test_an_interrupted_run_resumes_to_the_same_bytes(dataset: Path, tmp_path, monkeypatch):
    started = []

    def stop_after_two_scenes(job):
        if len(started) == 2:
            raise KeyboardInterrupt
        started.append(job)
        return generate._run_job(job)

    def run_in_process(jobs, workers, frames, progress):
        generate._start_worker()
        for job in jobs:
            if not job.shard.exists():
                stop_after_two_scenes(job)

    monkeypatch.setattr(generate, "_draw_missing", run_in_process)
    with pytest.raises(KeyboardInterrupt):
        generate_dataset(tmp_path, 7, SETTINGS, seed=3)
    monkeypatch.undo()
    assert not (tmp_path / "train_RGB.json").exists()
    report = generate_dataset(tmp_path, 7, SETTINGS, seed=3, workers=1)
    assert sum(report.frames.values()) == 7
    assert contents(tmp_path) == contents(dataset)


def test_a_folder_of_other_settings_is_refused_by_name(dataset: Path):
    with pytest.raises(DatasetError, match=r"settings.json: holds other settings or another seed"):
        generate_dataset(dataset, 7, SETTINGS, seed=4)


def test_too_few_frames_for_three_splits_are_refused(tmp_path):
    with pytest.raises(DatasetError, match="3 frames make 2 scenes: expected at least three"):
        generate_dataset(tmp_path, 3, SETTINGS)


def test_a_folder_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(DatasetError, match=r"file.*cannot be written"):
        generate_dataset(tmp_path / "file" / "out", 7, SETTINGS)
