"""Labels of a drive that people edited or that come from strangers."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from basetree.errors import InputError
from edgetree.sources import drive
from edgetree.sources.drive import open_drive

IMAGE = {
    "file_name": "images/000000.jpg",
    "depth_file": "depth/000000.png",
    "imu_file": "imu/000004.csv",
    "time_s": 0.5,
    "camera": {"width": 64, "height": 48, "fx": 60.0, "fy": 60.0, "cx": 31.5, "cy": 23.5},
    "up_camera": [0.0, -1.0, 0.0],
    "pose_world": {"origin_m": [0, 0, 2], "rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]]},
}


def drive_with(folder: Path, labels: Any) -> Path:
    (folder / "imu").mkdir()
    content = labels if isinstance(labels, bytes) else json.dumps(labels).encode()
    (folder / "test_RGB.json").write_bytes(content)
    return folder


def test_labels_with_other_fields_are_read(tmp_path: Path) -> None:
    labels = {"images": [IMAGE, IMAGE | {"later": [1]}], "annotations": [{"id": 1}]}
    source = open_drive(drive_with(tmp_path, labels), scene=4)
    assert source.count == 2


@pytest.mark.parametrize(
    ("image", "message"),
    [
        ({"depth_file": 5}, r"images\[0\].depth_file is a whole number, expected text"),
        ({"file_name": None}, r"images\[0\].file_name is null, expected text"),
        ({"camera": [1]}, r"images\[0\].camera is a list, expected an object"),
        ({"time_s": "now"}, r"images\[0\].time_s is text, expected a number"),
        ({"time_s": 10**400}, r"images\[0\].time_s: expected a number of 64 bits"),
        ({"up_camera": [0, 1]}, r"images\[0\].up_camera"),
        ({"pose_world": {"origin_m": [0, 0, 0]}}, "pose_world has no field 'rotation'"),
        (
            {"pose_world": {"origin_m": [0, 0, 0], "rotation": [[1, 0, 0], [0, 1], [0, 0, 1]]}},
            r"images\[0\].pose_world.rotation\[1\]",
        ),
        ({"imu_file": "imu/first.csv"}, r"imu_file is 'imu/first.csv', expected a number"),
        ({"imu_file": "imu/" + "9" * 5000 + ".csv"}, "imu_file is 'imu/999"),
    ],
)
def test_a_wrong_field_is_named(tmp_path: Path, image: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message) as raised:
        open_drive(drive_with(tmp_path, {"images": [IMAGE | image]}))
    assert str(raised.value).startswith(f"labels {tmp_path / 'test_RGB.json'} cannot be read")


@pytest.mark.parametrize("labels", [b"{", b"\xff", b"[" * 100_000, [], {"images": 5}])
def test_other_texts_are_refused(tmp_path: Path, labels: Any) -> None:
    with pytest.raises(InputError, match=r"test_RGB.json cannot be read .* expected those of a dr"):
        open_drive(drive_with(tmp_path, labels))


def test_very_large_labels_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(drive, "_LARGEST_LABELS_BYTES", 1000)
    with pytest.raises(InputError, match="it has more than 1000 bytes"):
        open_drive(drive_with(tmp_path, {"images": [IMAGE] * 9}))


@pytest.mark.parametrize(
    "image",
    [
        {"camera": {}},
        {"camera": {"width": "x"}},
        {"up_camera": [0, 0, 0]},
        {"up_camera": [9e307] * 3},
    ],
)
def test_a_frame_without_a_camera_or_gravity_is_left_out(
    tmp_path: Path, image: dict[str, Any], caplog: pytest.LogCaptureFixture
) -> None:
    source = open_drive(drive_with(tmp_path, {"images": [IMAGE | image]}))
    assert list(source) == []
    assert source.counts == {"unreadable images": 1}
    assert len(caplog.records) == 1
