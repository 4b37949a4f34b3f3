"""Real stems: captures of a phone's time-of-flight camera, and views of a laser scan."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from basetree.arrays import Bool, Float, Float32
from benchmarks.sensors.views import Readings, View, readings
from calib import PinholeCamera, project_points, read_depth
from edgetree.measure import Estimate, Failure, StemProfile

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
PORTRAIT_M = 0.466
"""Diameter of the stem in portrait: the mean of its outlines by depth, not of a tape."""
# A profile is read at a place up to so far beyond its ends, in px.
_BEYOND_PX = 15.0


def largest_part(depth_m: Float32) -> Bool:
    """(H, W) mask of the largest connected component with readings: the measured tree."""
    valid = (depth_m > 0).astype(np.uint8)
    closed = cv2.morphologyEx(valid, cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8))
    _, labels, stats, _ = cv2.connectedComponentsWithStats(closed)
    return np.asarray(labels == 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA])))


def phone() -> Iterator[View]:
    """18 captures of three stems with a tape around each."""
    folder = DATA / "tof_trees"
    known = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
    camera = PinholeCamera(**known["camera"])
    for frame in known["frames"]:
        depth_m = read_depth(folder / f"{frame['frame']}_depth_mm.png")
        yield _lone(depth_m, camera, frame["diameter_m"])


def portrait() -> Iterator[View]:
    """24 captures of one stem with its foot, turned upright."""
    folder = DATA / "tof_portrait"
    for path in sorted(folder.glob("mv[12]_*_depth_mm.png")):
        depth_m = np.rot90(read_depth(path), -1)
        yield _lone(np.ascontiguousarray(depth_m), _camera(folder, "camera_rotated"), PORTRAIT_M)


def scan(ground: bool) -> Iterator[View]:
    """Views of a laser scan of pines, with ground or without."""
    folder = DATA / "clouds" / "truebelief_artemis_treeiso" / "views"
    name = "truth.json" if ground else "truth_no_ground.json"
    for frame in json.loads((folder / name).read_text(encoding="utf-8"))["frames"]:
        yield View(
            depth_m=read_depth(folder / f"{frame['frame']}.png"),
            camera=_camera(folder, "camera"),
            up=np.array(frame["up_camera"]),
            places_px=[np.array(stem["breast_height_px"]) for stem in frame["stems"]],
            truths=list(frame["stems"]),
        )


def scan_readings(view: View, source: str) -> Readings:
    """Measurements of a view of the scan; without ground, those at the place of breast height."""
    for tree, truth in readings(view, source):
        if isinstance(tree.profile, StemProfile) and tree.profile.heights_from != "ground":
            place_px = np.array(truth["breast_height_px"])
            yield replace(tree, dbh_m=_at_place(tree.profile, view.camera, place_px)), truth
        else:
            yield tree, truth


def _at_place(profile: StemProfile, camera: PinholeCamera, place_px: Float) -> Estimate | Failure:
    """The diameter of a profile at a row of the picture."""
    rows = project_points(camera, profile.edges_m.mean(1))[:, 1]
    order = np.argsort(rows)
    if not rows.min() - _BEYOND_PX <= place_px[1] <= rows.max() + _BEYOND_PX:
        return Failure("not seen there")
    value, std = (
        float(np.interp(place_px[1], rows[order], values[order]))
        for values in (profile.diameter_m, profile.diameter_std_m)
    )
    return Estimate(value, std)


def _lone(depth_m: Float32, camera: PinholeCamera, diameter_m: float) -> View:
    mask = largest_part(depth_m)
    rows, columns = np.nonzero(mask)
    truth: dict[str, Any] = {"diameter_m": diameter_m}
    middle_px = np.array([np.median(columns), np.median(rows)])
    return View(
        depth_m=depth_m,
        camera=camera,
        up=None,
        places_px=[middle_px],
        truths=[truth],
        outlines=[mask],
    )


def _camera(folder: Path, name: str) -> PinholeCamera:
    values = json.loads((folder / f"{name}.json").read_text(encoding="utf-8"))
    return PinholeCamera.from_dict(values)
