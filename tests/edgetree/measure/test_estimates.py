"""Estimates, failures, and their JSON records."""

import json

import numpy as np
import pytest

from basetree.errors import InputError
from edgetree.measure import (
    Estimate,
    Evidence,
    Failure,
    PointEstimate,
    StemProfile,
    TreeMeasurement,
)
from edgetree.measure.estimates import QUANTITIES, interval_values, split_unit


def test_an_estimate_of_zero_is_still_true():
    assert Estimate(0.0, 0.0)


def test_a_failure_is_false():
    assert not Failure("why")


def test_the_interval_holds_95_percent_of_true_values():
    rng = np.random.default_rng(1)
    low, high = Estimate(0.3, 0.02).interval95
    truths = rng.normal(0.3, 0.02, 20_000)
    assert np.mean((truths > low) & (truths < high)) == pytest.approx(0.95, abs=0.01)


def test_records_name_their_units():
    tree = TreeMeasurement(
        diameter_m=Estimate(0.31, 0.01),
        dbh_m=Failure("the stem is not seen at breast height"),
        cut_height_m=Failure("no ground"),
        inclination_deg=Estimate(2.0, 0.5),
        lean_direction_deg=Estimate(-90.0, 20.0),
        distance_m=Estimate(5.0, 0.02),
        axis_distance_m=Failure("far"),
        taper_cm_per_m=Estimate(1.2, 0.5),
        seen_volume_m3=Estimate(0.2, 0.01),
        volume_m3=Failure("no species given"),
        profile=StemProfile(
            heights_from="ground",
            height_m=np.array([0.3, 0.4]),
            diameter_m=np.array([0.3123456, 0.31]),
            diameter_std_m=np.array([0.01, 0.02]),
            edges_m=np.zeros((2, 2, 3)),
        ),
        species="birch",
        cut_point_m=PointEstimate(np.array([1.0, 2.0, 3.0]), np.array([0.1, 0.2, 0.3])),
        cut_point_machine_m=Failure("no mounting of the camera given"),
        evidence=Evidence(
            method="keypoints",
            source_diameters_m={"keypoints": 0.31},
            source_std_m={"keypoints": 0.01},
            arc_deg=106.0,
            valid_depth_share=0.9,
            visible_share=1.0,
            ground="a plane",
            distance_at="felling cut",
            warnings=("w",),
        ),
    )
    expected = {
        "diameter_m": 0.31,
        "diameter_std_m": 0.01,
        "diameter_low95_m": 0.31 - 1.96 * 0.01,
        "diameter_high95_m": 0.31 + 1.96 * 0.01,
        "dbh_failure": "the stem is not seen at breast height",
        "cut_height_failure": "no ground",
        "inclination_deg": 2.0,
        "inclination_std_deg": 0.5,
        "inclination_low95_deg": 2.0 - 1.96 * 0.5,
        "inclination_high95_deg": 2.0 + 1.96 * 0.5,
        "lean_direction_deg": -90.0,
        "lean_direction_std_deg": 20.0,
        "lean_direction_low95_deg": -90.0 - 1.96 * 20.0,
        "lean_direction_high95_deg": -90.0 + 1.96 * 20.0,
        "distance_m": 5.0,
        "distance_std_m": 0.02,
        "distance_low95_m": 5.0 - 1.96 * 0.02,
        "distance_high95_m": 5.0 + 1.96 * 0.02,
        "axis_distance_failure": "far",
        "taper_cm_per_m": 1.2,
        "taper_std_cm_per_m": 0.5,
        "taper_low95_cm_per_m": 1.2 - 1.96 * 0.5,
        "taper_high95_cm_per_m": 1.2 + 1.96 * 0.5,
        "seen_volume_m3": 0.2,
        "seen_volume_std_m3": 0.01,
        "seen_volume_low95_m3": 0.2 - 1.96 * 0.01,
        "seen_volume_high95_m3": 0.2 + 1.96 * 0.01,
        "volume_failure": "no species given",
        "species": "birch",
        "profile": {
            "heights_from": "ground",
            "height_m": [0.3, 0.4],
            "diameter_m": [0.31235, 0.31],
            "diameter_std_m": [0.01, 0.02],
        },
        "cut_point_m": [1.0, 2.0, 3.0],
        "cut_point_std_m": [0.1, 0.2, 0.3],
        "cut_point_machine_failure": "no mounting of the camera given",
        "evidence": {
            "method": "keypoints",
            "distance_from": "depth",
            "source_diameters_m": {"keypoints": 0.31},
            "source_std_m": {"keypoints": 0.01},
            "arc_deg": 106.0,
            "valid_depth_share": 0.9,
            "visible_share": 1.0,
            "ground": "a plane",
            "distance_at": "felling cut",
            "warnings": ["w"],
        },
    }
    assert json.loads(json.dumps(tree.to_dict(), allow_nan=False)) == expected


def test_a_value_is_within_its_interval_also_below_zero() -> None:
    """The cut of a stem on soft ground may be measured a little below the ground."""
    values = interval_values("cut_height_m", Estimate(-0.03, 0.04))
    low, high = values["cut_height_low95_m"], values["cut_height_high95_m"]
    assert low <= values["cut_height_m"] <= high
    assert interval_values("cut_height_m", Estimate(0.03, 0.04))["cut_height_low95_m"] == 0


def test_records_hold_no_lower_end_below_zero_where_there_is_no_sign():
    upright = interval_values("inclination_deg", Estimate(0.5, 1.0))
    assert upright["inclination_low95_deg"] == 0
    assert upright["inclination_high95_deg"] == pytest.approx(2.46)
    assert interval_values("taper_cm_per_m", Estimate(0.5, 1.0))["taper_low95_cm_per_m"] < 0
    direction = interval_values("lean_direction_deg", Estimate(0.5, 9.0))
    assert direction["lean_direction_low95_deg"] < 0


def test_a_failed_tree_has_one_reason():
    record = TreeMeasurement.failed("no depth on the stem").to_dict()
    reasons = {value for name, value in record.items() if name.endswith("_failure")}
    assert reasons == {"no depth on the stem"}
    assert record.pop("species") is None
    assert len(record) == len(QUANTITIES) + 3 + 1


@pytest.mark.parametrize("how", ["keypoints", "mask", "holes"])
def test_measured_records_are_plain_json(scene, pole, how):
    stand = scene(pole(0.3, 0.5, 4.0))
    if how == "holes":
        tree = stand.measure(depth_m=np.zeros_like(stand.depth_m))
    else:
        tree = stand.measure() if how == "keypoints" else stand.measure_mask()
    record = tree.to_dict()
    assert json.loads(json.dumps(record, allow_nan=False)) == record
    for quantity in QUANTITIES:
        name, unit = split_unit(quantity)
        if quantity in record:
            low, high = record[f"{name}_low95_{unit}"], record[f"{name}_high95_{unit}"]
            assert low < record[quantity] < high
            assert f"{name}_failure" not in record
        else:
            assert record[f"{name}_failure"]


def test_intervals_of_other_levels_have_heavy_tails_and_agree_at_95_percent():
    # Squared normal errors of 3 degrees of freedom make Student's t of a normal error.
    rng = np.random.default_rng(2)
    scale = np.sqrt(3 / rng.chisquare(3, 200_000)) * 1.96 / 3.182
    error_m = 0.02 * scale * rng.normal(size=200_000)
    for level in (0.1, 0.5, 0.68, 0.9, 0.95, 0.99):
        low, high = Estimate(0.3, 0.02).interval(level)
        assert low + high == pytest.approx(0.6)
        assert np.mean(np.abs(error_m) < high - 0.3) == pytest.approx(level, abs=0.005)
    estimate = Estimate(0.3, 0.02)
    assert estimate.interval(0.95) == pytest.approx(estimate.interval95, abs=1e-4)


@pytest.mark.parametrize("level", [0.0, 1.0, -0.5, 95.0, float("nan")])
def test_levels_are_between_0_and_1(level):
    with pytest.raises(InputError, match="between 0 and 1"):
        Estimate(0.3, 0.02).interval(level)
