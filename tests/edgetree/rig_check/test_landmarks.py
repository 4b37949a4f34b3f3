"""The vertical, the scale and the heading against stems whose places are known."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from calib import RigidTransform
from edgetree.frames.frame import stream_frame
from edgetree.measure import StemAxis
from edgetree.rig_check.odometry import odometry_checks
from edgetree.rig_check.stem_sightings import Sighting
from edgetree.rig_check.vertical import vertical_checks

# Camera's axes in the machine's level frame (x forward, y left, z up): right, down, forward.
_CAMERA = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])


def turn(angle_deg: float) -> np.ndarray:
    cos, sin = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    return np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])


def drive(
    *,
    stems: int = 20,
    known: bool = True,
    depth: float = 1.0,
    focal: float = 1.0,
    heading_deg: float = 0.0,
    tilt_deg: float = 0.0,
) -> list[Sighting]:
    """Sightings of stems from a level camera in a curve, with errors of 3 cm and leans of 3°.

    Args:
        stems: number of stems.
        known: whether poses and vertical are given.
        depth, focal: factors on the depth and on the focal length.
        heading_deg: by how much the given poses look too far left.
        tilt_deg: by how much the given vertical is turned so that stems seem to lean away.
    """
    generator = np.random.default_rng(1)
    places = np.column_stack([generator.uniform(3, 16, stems), generator.uniform(-6, 6, stems)])
    leans = generator.normal(0, math.tan(math.radians(3)), (stems, 2))
    tilt = math.radians(tilt_deg)
    up = np.array([0, -math.cos(tilt), -math.sin(tilt)])
    found = []
    for number in range(24):
        place, rotation = np.array([0.4 * number, 0.0, 2.0]), turn(1.5 * number - 15) @ _CAMERA
        given = RigidTransform(turn(heading_deg) @ rotation, place)
        frame = stream_frame(
            number,
            0.5 * number,
            None,
            up_camera=up if known else None,
            pose=given if known else None,
        )
        for stem in range(stems):
            point = rotation.T @ (np.array([*places[stem], 0.3]) - place)
            if not 2 < point[2] < 9:
                continue
            point += generator.normal(0, 0.03, 3)
            point = depth * point * [1 / focal, 1, 1]
            direction = rotation.T @ np.array([*leans[stem], 1])
            axis = StemAxis(
                point_m=point,
                point_covariance_m2=np.eye(3) * 0.03**2,
                direction=direction / np.linalg.norm(direction),
                direction_covariance=np.eye(3) * math.radians(1.5) ** 2,
            )
            found.append(Sighting(stem, axis, frame))
    return found


def test_a_good_rig_holds() -> None:
    assert {check.verdict for check in odometry_checks(drive())} == {"holds"}
    assert {check.verdict for check in vertical_checks(drive(stems=60))} == {"holds"}


@pytest.mark.parametrize(
    ("name", "expected", "fault"),
    [
        ("scale of the depth", 6.0, {"depth": 1.06}),
        ("scale of the depth", -6.0, {"depth": 0.94}),
        ("focal length", 6.0, {"focal": 1.06}),
        ("heading to the left", 4.0, {"heading_deg": 4.0}),
    ],
)
def test_each_fault_is_found_by_its_check_alone(
    name: str, expected: float, fault: dict[str, Any]
) -> None:
    checks = {check.name: check for check in odometry_checks(drive(**fault))}
    found = checks.pop(name)
    assert found.verdict == "does not hold"
    assert found.value is not None
    assert found.half_interval is not None
    assert abs(found.value - expected) < found.half_interval
    assert {check.verdict for check in checks.values()} == {"holds"}


def test_a_tilted_vertical_does_not_hold() -> None:
    away, left = vertical_checks(drive(stems=60, tilt_deg=9))
    assert away.verdict == "does not hold"
    assert away.value == pytest.approx(9, abs=1.5)
    assert left.verdict == "holds"


def test_few_stems_cannot_tell() -> None:
    assert {check.verdict for check in vertical_checks(drive(stems=8))} == {"cannot tell"}
    checks = odometry_checks(drive(stems=4))
    assert {check.verdict for check in checks} == {"cannot tell"}
    assert "5 are needed" in checks[0].reason


def test_without_poses_and_vertical_it_says_what_is_missing() -> None:
    unknown = drive(known=False)
    assert "poses" in odometry_checks(unknown)[0].reason
    assert "--up" in vertical_checks(unknown)[0].reason
