"""The examples run against fakes of the packages that they are for."""

from __future__ import annotations

import runpy
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from basetree.errors import InputError
from edgetree import sample_frames

EXAMPLES = Path(__file__).parents[2] / "examples"
FRAMES = 3


@pytest.fixture
def sample() -> Any:
    return sample_frames()[0]


def depth_mm(sample: Any) -> np.ndarray:
    return cv2.imread(str(sample.depth_path), cv2.IMREAD_UNCHANGED)


def fake_modules(monkeypatch: pytest.MonkeyPatch, modules: dict[str, dict[str, Any]]) -> None:
    for name, content in modules.items():
        module = ModuleType(name)
        module.__dict__.update(content)
        monkeypatch.setitem(sys.modules, name, module)


def test_the_zed_camera_is_read_until_it_vanishes(
    monkeypatch: pytest.MonkeyPatch, sample: Any
) -> None:
    closed: list[bool] = []

    class Mat:
        def get_data(self) -> np.ndarray:
            return self.data

    class Camera:
        grabbed = 0

        def open(self, settings: Any) -> str:
            return "gone" if closed else "success"

        def grab(self) -> str:
            self.grabbed += 1
            return "success" if self.grabbed <= FRAMES else "failure"

        def get_camera_information(self) -> Any:
            camera = sample.camera
            left = SimpleNamespace(fx=camera.fx, fy=camera.fy, cx=camera.cx, cy=camera.cy)
            return SimpleNamespace(
                camera_configuration=SimpleNamespace(
                    calibration_parameters=SimpleNamespace(left_cam=left),
                    resolution=SimpleNamespace(width=camera.width, height=camera.height),
                )
            )

        def retrieve_image(self, mat: Any, view: str) -> None:
            mat.data = cv2.cvtColor(sample.image(), cv2.COLOR_BGR2BGRA)

        def retrieve_measure(self, mat: Any, measure: str) -> None:
            metres = sample.depth_m()
            mat.data = np.where(metres > 0, metres, np.nan)

        def get_timestamp(self, reference: str) -> Any:
            return SimpleNamespace(get_nanoseconds=lambda: self.grabbed * 10**8)

        def close(self) -> None:
            closed.append(True)

    sl = {
        "Camera": Camera,
        "Mat": Mat,
        "InitParameters": lambda **given: given,
        "UNIT": SimpleNamespace(METER="m"),
        "DEPTH_MODE": SimpleNamespace(NEURAL="neural"),
        "ERROR_CODE": SimpleNamespace(SUCCESS="success"),
        "VIEW": SimpleNamespace(LEFT="left"),
        "MEASURE": SimpleNamespace(DEPTH="depth"),
        "TIME_REFERENCE": SimpleNamespace(IMAGE="image"),
    }
    fake_modules(monkeypatch, {"pyzed": {}, "pyzed.sl": sl})
    monkeypatch.setattr(sys.modules["pyzed"], "sl", sys.modules["pyzed.sl"], raising=False)
    zed = runpy.run_path(str(EXAMPLES / "zed.py"))
    frames = []
    with pytest.raises(InputError, match="does not answer any more"):
        frames.extend(zed["ZedFrames"]())
    source = iter(zed["ZedFrames"]())
    first = next(source)
    assert first.image.shape == (720, 1280, 3)
    assert first.depth_m.dtype == np.float32
    np.testing.assert_array_equal(first.depth_m, sample.depth_m())
    assert first.time_s == pytest.approx(0.1)


def test_the_program_of_your_own_says_how_it_went(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], sample: Any
) -> None:
    monkeypatch.setattr(sys, "argv", ["camera.py", str(sample.image_path)])
    runpy.run_path(str(EXAMPLES / "camera.py"), run_name="__main__")
    assert capsys.readouterr().out == (
        "ended: 0 frames, 0.0 per second, 1 left out: without depth, which the model takes\n"
    )
