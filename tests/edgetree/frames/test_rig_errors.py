"""What a rig states of its errors, and what is said of the rest."""

from dataclasses import replace

import numpy as np
import pytest

from basetree.errors import InputError
from calib import DepthScale, PinholeCamera, RigidTransform
from edgetree.frames.rig import Rig
from edgetree.measure import RigUncertainty

CAMERA = PinholeCamera(1280, 720, 700.0, 700.0, 639.5, 359.5)
SCALE = DepthScale(1.01, 0.0, 0.003, 0.01, -0.5, 1.0, 6.0)


def test_the_calibration_of_the_depth_says_how_well_its_scale_is_known() -> None:
    rig = Rig(CAMERA, depth_calibration=SCALE)
    assert rig.known_uncertainty().depth_scale_std == pytest.approx(SCALE.std_share)
    assert SCALE.std_share == pytest.approx(float(SCALE.std_m(1.0)))
    stated = replace(rig, uncertainty=RigUncertainty(depth_scale_std=0.001))
    assert stated.known_uncertainty().depth_scale_std == 0.001


def test_what_is_assumed_is_said_once(caplog: pytest.LogCaptureFixture) -> None:
    mounting = RigidTransform(np.eye(3), np.zeros(3))
    rig = Rig(CAMERA, mounting=mounting, uncertainty=RigUncertainty(principal_std_px=1.0))
    for _ in range(3):
        rig.tell_assumed(CAMERA, False)
    assert caplog.text.count("± takes in usual errors of a camera") == 1
    assert "depth scale 0.7 %, vertical 2 degrees, mounting 2 degrees;" in caplog.text
    assert "principal" not in caplog.text


def test_a_rig_that_states_all_hears_nothing(caplog: pytest.LogCaptureFixture) -> None:
    Rig(CAMERA, uncertainty=RigUncertainty(0.0, 1.0, 1.0)).tell_assumed(CAMERA, True)
    assert not caplog.text


def test_errors_are_read_from_a_text() -> None:
    read = RigUncertainty.from_text("scale=0.004, principal=1.2,mounting=1")
    assert read == RigUncertainty(0.004, 1.2, None, 1.0)
    assert RigUncertainty.from_text("offset=0.03") == RigUncertainty(depth_offset_std_m=0.03)


def test_a_value_out_of_range_is_named_as_it_was_given() -> None:
    with pytest.raises(InputError, match="the rig error scale is -1: expected 0 to"):
        RigUncertainty.from_text("scale=-1")


@pytest.mark.parametrize("text", ["", "scale", "scale=x", "size=1", "scale=1e-3,scale=2e-3"])
def test_other_texts_are_refused(text: str) -> None:
    with pytest.raises(InputError, match="expected NAME=NUMBER with each of scale, principal, "):
        RigUncertainty.from_text(text)
