"""What a drive tells of a rig's errors, as the measurement takes it."""

import pytest

from edgetree.measure import RigUncertainty
from edgetree.rig_check.checks import RigCheck
from edgetree.rig_check.report import error_words


def check(name: str, value: float | None, half: float | None) -> RigCheck:
    return RigCheck(name, "", "holds", 3.0, "", value, half)


def test_the_larger_error_of_the_vertical_and_that_of_the_scale_are_told() -> None:
    checks = [
        check("stems lean away from the camera", 0.3, 1.96 * 0.4),
        check("stems lean to the left", -1.2, 1.96 * 0.5),
        check("scale of the depth", -0.3, 1.96 * 0.4),
        check("faulty depth", 4.0, None),
    ]
    words = error_words(checks)
    assert words == "vertical=1.3,scale=0.005"
    read = RigUncertainty.from_text(words)
    assert read.vertical_std_deg == pytest.approx(1.3)
    assert read.depth_scale_std == 0.005


def test_what_a_drive_does_not_show_is_not_told() -> None:
    assert error_words([check("scale of the depth", None, None)]) == ""
