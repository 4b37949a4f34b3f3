"""Cameras on their side and upside down: pictures are turned for the model, and results back."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import calib
from basetree.errors import InputError
from edgetree.catalogue import default_model
from edgetree.detections import TreeDetections
from edgetree.frames.pipeline import FrameResult, process
from edgetree.frames.rig import Rig
from edgetree.frames.turning import Turn, turn_of
from edgetree.measure import Estimate, PointEstimate, StemAxis, StemProfile
from edgetree.runtime.detector import TreeDetector
from edgetree.samples import sample_frames

Cli = Callable[..., Any]

LENSES = [
    ((), "radtan"),
    ((-0.2, 0.05, 0.003, -0.002), "radtan"),
    ((-0.2, 0.05, 0.003, -0.002, 0.01, 0.02, -0.01, 0.005), "radtan"),
    ((0.02, -0.01, 0.003, 0.001), "fisheye"),
]


@pytest.fixture(scope="module")
def detector() -> TreeDetector:
    return TreeDetector.load(default_model("depth"), threads=1)


@pytest.mark.parametrize(("terms", "model"), LENSES)
@pytest.mark.parametrize("degrees", [0, 90, 180, 270])
def test_a_turned_camera_sees_turned_pixels(
    terms: tuple[float, ...], model: str, degrees: int
) -> None:
    camera = calib.PinholeCamera(640, 360, 410.0, 400.0, 300.5, 190.5, terms, model)
    turned, turn = camera.rotated(degrees), Turn(degrees // 90)
    points = np.random.default_rng(0).uniform((-1, -0.6, 2), (1, 0.6, 4), (50, 3))
    xy = calib.project_points(camera, points)
    for _ in range(turn.quarters):
        xy = np.stack([-xy[:, 1], xy[:, 0]], axis=-1)
    xy += {0: (0, 0), 90: (360, 0), 180: (640, 360), 270: (0, 640)}[degrees]
    np.testing.assert_allclose(calib.project_points(turned, turn.directions(points)), xy, atol=1e-6)
    assert turned.rotated((360 - degrees) % 360) == camera


def test_other_angles_are_refused() -> None:
    camera = calib.PinholeCamera(64, 48, 60.0, 60.0, 31.5, 23.5)
    with pytest.raises(calib.CameraError, match="clockwise_deg is 45: expected 0, 90, 180 or 270"):
        camera.rotated(45)
    with pytest.raises(InputError, match="--rotate is 45: expected 0, 90, 180 or 270"):
        Rig(rotation_deg=45)


@pytest.mark.parametrize("quarters", [1, 2, 3])
def test_trees_turn_with_their_picture_and_back(quarters: int) -> None:
    rng = np.random.default_rng(0)
    masks = np.zeros((1, 28, 28), np.float32)
    masks[0, :9, 5:20] = 1
    keypoints = rng.uniform(5, 40, (1, 5, 3)).astype(np.float32)
    boxes = np.array([[8, 10, 36, 66]], np.float32)
    stds = rng.uniform(1, 9, (1, 5, 2)).astype(np.float32)
    trees = TreeDetections(boxes, np.array([0.9]), keypoints, masks, 96, 80, keypoint_stds_px=stds)
    turn = Turn(quarters)
    turned = turn.trees(trees)
    np.testing.assert_array_equal(turned.mask(0), turn.picture(trees.mask(0)))
    back = turn.back.trees(turned)
    np.testing.assert_allclose(back.boxes_px, boxes, rtol=1e-6)
    np.testing.assert_allclose(back.keypoints_px, keypoints, rtol=1e-5)
    np.testing.assert_array_equal(back.keypoint_stds_px, stds)
    sides = stds if quarters == 2 else stds[..., ::-1]
    np.testing.assert_array_equal(turned.keypoint_stds_px, sides)
    assert (turned.image_width, turned.image_height) == ((96, 80) if quarters == 2 else (80, 96))


@pytest.mark.parametrize(
    ("up", "quarters"),
    [
        ((0, -1, 0), 0),
        ((-1, 0, 0), 1),
        ((-2, -1, 0.5), 1),
        ((1, 0.2, -0.3), 3),
        ((-1, -1, 0), 0),
        ((0.1, 0, 1), 0),
        ((0, 1, 0), 0),
        ((0, 0, 0), 0),
        ((np.nan, 0, 0), 0),
        ((-1e300, 0, 0), 1),
        (None, 0),
    ],
)
def test_the_vertical_tells_a_camera_on_its_side_when_it_is_clear(up: Any, quarters: int) -> None:
    assert turn_of(None, up) == Turn(quarters)
    assert turn_of(180, up) == Turn(2)


@pytest.mark.parametrize("degrees", [90, 180, 270])
def test_a_turned_camera_measures_what_an_upright_one_does(
    detector: TreeDetector, degrees: int
) -> None:
    sample = sample_frames()[0]
    upright, turn = sample.read(), Turn(degrees // 90)
    mounting = calib.RigidTransform.mounting((1.0, 0.2, 2.5), pitch_deg=3.0)
    up = np.array(sample.up_camera)
    expected = process(upright, detector, Rig(sample.camera, tuple(up), mounting))
    given = replace(
        upright,
        image=turn.back.picture(upright.image),
        depth_m=turn.back.picture(upright.depth_m),
    )
    rig = Rig(
        turn.back.camera(sample.camera),
        tuple(turn.back.directions(up)),
        turn.back.mounting(mounting),
        rotation_deg=degrees,
    )
    found = process(given, detector, rig)
    back = turn.back.trees(expected.trees)
    np.testing.assert_allclose(found.trees.boxes_px, back.boxes_px, atol=1e-3)
    np.testing.assert_allclose(found.trees.keypoints_px, back.keypoints_px, atol=1e-3)
    compare(found, expected, turn)


def compare(found: FrameResult, expected: FrameResult, turn: Turn) -> None:
    assert found.measurements is not None
    assert expected.measurements is not None
    measured = 0
    for one, other in zip(found.measurements, expected.measurements, strict=True):
        for name in ("diameter_m", "dbh_m", "cut_height_m", "inclination_deg", "distance_m"):
            a, b = getattr(one, name), getattr(other, name)
            assert bool(a) == bool(b)
            if isinstance(a, Estimate):
                assert a == pytest.approx(b, rel=1e-3)
                measured += 1
        if isinstance(other.cut_point_m, PointEstimate):
            xyz_m = turn.back.directions(other.cut_point_m.xyz_m)
            np.testing.assert_allclose(one.cut_point_m.xyz_m, xyz_m, atol=1e-3)
            np.testing.assert_allclose(
                one.cut_point_machine_m.xyz_m, other.cut_point_machine_m.xyz_m, atol=1e-3
            )
        if isinstance(other.axis, StemAxis):
            direction = turn.back.directions(other.axis.direction)
            np.testing.assert_allclose(one.axis.direction, direction, atol=1e-3)
        if isinstance(other.profile, StemProfile):
            edges_m = turn.back.directions(other.profile.edges_m)
            np.testing.assert_allclose(one.profile.edges_m, edges_m, atol=1e-3)
    assert measured > 5


def write(folder: Path, degrees: int) -> tuple[tuple[object, ...], np.ndarray]:
    """Write the sample as a camera that must be turned by so much takes it; its options."""
    sample, turn = sample_frames()[0], Turn(degrees // 90).back
    frame = sample.read()
    assert frame.image is not None
    assert frame.depth_m is not None
    (folder / "images").mkdir(parents=True)
    (folder / "depth").mkdir()
    for stem in ("a", "b"):
        cv2.imwrite(str(folder / "images" / f"{stem}.png"), turn.picture(frame.image))
        calib.write_depth(folder / "depth" / f"{stem}.png", turn.picture(frame.depth_m))
    calib.save_camera(folder / "camera.json", turn.camera(sample.camera))
    up = turn.directions(sample.up_camera)
    given = ("--depth", folder / "depth", "--camera", folder / "camera.json", "--model", "depth")
    return given, up


@pytest.mark.parametrize(("degrees", "is_told"), [(180, True), (90, True), (90, False)])
def test_all_commands_take_turned_cameras(
    run_cli: Cli, tmp_path: Path, degrees: int, is_told: bool
) -> None:
    usual, up = write(tmp_path / "upright", 0)
    words = ("--up", ",".join(f"{value:.6f}" for value in up))
    lines = run_cli("run", tmp_path / "upright" / "images", *usual, *words).out.splitlines()
    expected = [tree["metres"].get("diameter_m") for tree in json.loads(lines[0])["trees"]]
    given, up = write(tmp_path / "turned", degrees)
    words = ("--up=" + ",".join(f"{value:.6f}" for value in up),)
    words += ("--rotate", str(degrees)) if is_told else ()
    images = tmp_path / "turned" / "images"
    for command in ("run", "live"):
        done = run_cli(command, images, *given, *words)
        assert done.code == 0, done.err
        for line in done.out.splitlines():
            found = [tree["metres"].get("diameter_m") for tree in json.loads(line)["trees"]]
            assert found == [value and pytest.approx(value, rel=0.01) for value in expected]
        assert ("the vertical says that the camera lies on its side" in done.err) != is_told
    depth = ("--depth", tmp_path / "turned" / "depth" / "a.png")
    done = run_cli("measure", images / "a.png", *given[2:], *depth, *words, "--json")
    assert done.code == 0, done.err
    assert len(json.loads(done.out)["frame"]["trees"]) == len(expected)
    done = run_cli("check-rig", images, *given, *words, "--json")
    assert json.loads(done.out)["frames"] == 2, done.err


def test_an_upside_down_camera_is_refused_with_the_option(run_cli: Cli, tmp_path: Path) -> None:
    given, _ = write(tmp_path / "turned", 180)
    done = run_cli("run", tmp_path / "turned" / "images", *given, "--up=0,1,0")
    assert done.code == 2
    assert "upside down: expected the direction away from gravity, or for a camera" in done.err
    assert "--rotate 180" in done.err


def test_masks_are_those_of_the_picture_as_it_is(run_cli: Cli, tmp_path: Path) -> None:
    given, up = write(tmp_path / "turned", 90)
    height, width = cv2.imread(str(tmp_path / "turned" / "images" / "a.png")).shape[:2]
    mask = np.zeros((height, width), np.uint8)
    mask[height // 3 : height // 3 + 20, width // 2 :] = 1
    cv2.imwrite(str(tmp_path / "mask.png"), mask)
    depth = ("--depth", tmp_path / "turned" / "depth" / "a.png", "--mask", tmp_path / "mask.png")
    words = ("--up=" + ",".join(f"{value:.6f}" for value in up), "--json")
    image = tmp_path / "turned" / "images" / "a.png"
    done = run_cli("measure", image, *given[2:4], *depth, *words)
    assert done.code == 0, done.err
    (tree,) = json.loads(done.out)["frame"]["trees"]
    assert tree["box_px"] == [width // 2, height // 3, width, height // 3 + 20]
