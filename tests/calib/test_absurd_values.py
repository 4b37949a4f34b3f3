"""Values that are finite and cannot be: refused in all files of calib."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from basetree.errors import InputError
from calib import (
    DepthScale,
    PinholeCamera,
    RigidTransform,
    load_camera,
    load_depth_scale,
    load_transform,
)

FARTHER = [1e5, -1e9, 1e300, -1e308]
SCALE: dict[str, Any] = {
    "schema": "calib.depth_scale/1",
    "scale": 1.01,
    "offset_m": -0.02,
    "scale_std": 0.002,
    "offset_std_m": 0.004,
    "correlation": -0.8,
    "nearest_m": 1.0,
    "farthest_m": 4.0,
}


def refused(path: Path, values: dict[str, Any], load: Any) -> str:
    path.write_text(json.dumps(values))
    with pytest.raises(InputError) as caught:
        load(path)
    assert str(caught.value).startswith(str(path))
    return str(caught.value)


@pytest.mark.parametrize("metres", FARTHER)
@pytest.mark.parametrize("place", [0, 1, 2])
def test_places_beyond_the_machine(tmp_path: Path, metres: float, place: int) -> None:
    position_m = [0.1, 0.2, 0.3]
    position_m[place] = metres
    mounting = {"schema": "calib.transform/1", "mounting": {"position_m": position_m}}
    message = refused(tmp_path / "t.json", mounting, load_transform)
    assert "m apart: expected" in message or "expected metres, up to 1e+08" in message
    identity = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
    plain = {"schema": "calib.transform/1", "rotation": identity, "translation_m": position_m}
    refused(tmp_path / "t.json", plain, load_transform)


def test_poses_on_a_map_are_no_files() -> None:
    pose = RigidTransform([[1, 0, 0], [0, 1, 0], [0, 0, 1]], [500_000.0, 5_800_000.0, 200.0])
    assert pose.translation_m[1] == 5_800_000.0


@pytest.mark.parametrize("degrees", [361.0, -1e6, 1e300])
@pytest.mark.parametrize("name", ["roll_deg", "pitch_deg", "yaw_deg"])
def test_turns_beyond_a_whole_one(tmp_path: Path, name: str, degrees: float) -> None:
    mounting = {"position_m": [0, 0, 1], name: degrees}
    values = {"schema": "calib.transform/1", "mounting": mounting}
    assert "from -360 to 360" in refused(tmp_path / "t.json", values, load_transform)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *(("scale", value) for value in (0.0, 1e-300, -1.0, 1e5, 1e300)),
        *(("offset_m", value) for value in (1e4, -1e300)),
        *((name, 1e300) for name in ("scale_std", "offset_std_m", "nearest_m", "farthest_m")),
        ("nearest_m", 4.5),
        ("scale_std", -0.1),
    ],
)
def test_scales_of_depth(tmp_path: Path, name: str, value: float) -> None:
    message = refused(tmp_path / "s.json", SCALE | {name: value}, load_depth_scale)
    assert f"{name} is {value}" in message


def test_the_scale_of_depth_itself_is_read(tmp_path: Path) -> None:
    (tmp_path / "s.json").write_text(json.dumps(SCALE))
    assert load_depth_scale(tmp_path / "s.json").scale == DepthScale.from_dict(SCALE).scale


@pytest.mark.parametrize("value", [1e20, 1e300, -1e300])
@pytest.mark.parametrize("name", ["width", "fx", "cy", "focal_std_px", "k1", "tau_x"])
def test_cameras(tmp_path: Path, name: str, value: float) -> None:
    values = PinholeCamera(640, 480, 500.0, 500.0, 320.0, 240.0, (0.1, 0, 0, 0)).to_dict()
    if name in ("k1", "tau_x"):
        values["distortion"] = [0.0] * 14
        values["distortion"][0 if name == "k1" else 12] = value
    else:
        values[name] = value
    refused(tmp_path / "c.json", values, load_camera)


def test_more_pixels_than_a_picture_may_have(tmp_path: Path) -> None:
    values = {"width": 99_000, "height": 99_000, "fx": 9e4, "fy": 9e4, "cx": 49e3, "cy": 49e3}
    message = refused(tmp_path / "c.json", values, load_camera)
    assert "at most 200000000 pixels, the limit image_pixels" in message
