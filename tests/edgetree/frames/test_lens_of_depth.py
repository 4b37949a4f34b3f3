"""A lens that bends the pixels of the depth is told once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib import PinholeCamera
from edgetree.detections import TreeDetections
from edgetree.frames.frame import Frame
from edgetree.frames.pipeline import FoundTrees, measure_frame
from edgetree.frames.rig import Rig

PLAIN = PinholeCamera(64, 48, 50.0, 50.0, 31.5, 23.5)
TOLD = "moves the corners of the picture by up to"


def bent(k1: float) -> PinholeCamera:
    """A camera that no other test has warned of."""
    return replace(PLAIN, distortion=(k1, 0.0, 0.0, 0.0))


def frame(camera: PinholeCamera | None = None, has_depth: bool = True) -> Frame:
    depth_m = np.full((48, 64), 3.0, np.float32) if has_depth else None
    return Frame("f", None, np.zeros((48, 64, 3), np.uint8), depth_m, camera=camera)


def test_a_lens_is_told_once_with_what_it_does(caplog: pytest.LogCaptureFixture) -> None:
    rig = Rig(bent(-0.11))
    for _ in range(3):
        rig.completed(frame(), 64, 48)
    assert caplog.text.count(TOLD) == 1
    assert "radtan -0.11, 0, 0, 0" in caplog.text
    assert "_RECTIFIED" in caplog.text


def test_measuring_a_frame_tells_the_lens(caplog: pytest.LogCaptureFixture) -> None:
    empty = TreeDetections(
        boxes_px=np.zeros((0, 4), np.float32),
        scores=np.zeros(0, np.float32),
        keypoints_px=None,
        masks=None,
        image_width=64,
        image_height=48,
    )
    measure_frame(frame(), FoundTrees.detected(empty, 0.0), Rig(bent(-0.12)))
    assert caplog.text.count(TOLD) == 1


@pytest.mark.parametrize(
    ("rig", "given"),
    [
        (Rig(PLAIN), frame()),
        (Rig(bent(-0.13)), frame(has_depth=False)),  # nothing is measured
        (Rig(bent(-0.14)), replace(frame(), depth_is_moved=True)),
        (Rig(), frame(bent(-0.16))),
        (
            Rig(bent(-0.17), depth_camera=PLAIN),
            frame(),
        ),  # the depth is moved into the lens's pixels
    ],
)
def test_nothing_is_told_without_doubt(
    rig: Rig, given: Frame, caplog: pytest.LogCaptureFixture
) -> None:
    rig.completed(given, 64, 48)
    assert TOLD not in caplog.text


def test_a_given_camera_takes_the_place_of_the_frames_own() -> None:
    given = replace(PLAIN, fx=55.0)
    assert Rig(given).completed(frame(PLAIN), 64, 48).camera == given
    assert Rig().completed(frame(PLAIN), 64, 48).camera == PLAIN
