"""What the page shows of a result, as a JSON object."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from basetree.arrays import Float
from calib import PinholeCamera
from edgetree.drawing.primitives import Colour
from edgetree.drawing.trees import tree_colour
from edgetree.frames.frame import level_axes
from edgetree.live.results import LiveResult
from edgetree.live.tracking.tracks import TreeTrack
from edgetree.measure.estimates import interval_keys, interval_values

PAGE_SCHEMA: Final = "edgetree.live.page/1"

QUANTITIES: Final = ("diameter_m", "dbh_m", "cut_height_m", "inclination_deg")


def page_record(result: LiveResult) -> dict[str, Any]:
    """The stems of a result as a JSON object of the schema `PAGE_SCHEMA`.

    Stems in view come first, then the nearer ones. `plan_m` is the stem's place seen from above:
    metres to the right of the camera and ahead of it.
    """
    frame = result.frame
    axes = level_axes(result.vertical)[:2]
    stems = [_stem(track, axes, frame.stamp_s) for track in result.tracks]
    stems.sort(key=lambda stem: (not stem["in_view"], round(stem["distance_m"]), stem["number"]))
    return {
        "schema": PAGE_SCHEMA,
        "frame": frame.number,
        "time_s": frame.time_s,
        "age_s": round(result.age_s, 4),
        "dropped": result.dropped,
        "stages_ms": {name: round(ms, 1) for name, ms in result.stages_ms.items()},
        "field_of_view_deg": None if frame.camera is None else _field_of_view_deg(frame.camera),
        "trees": len(result.trees),
        "metres_need": result.metres_need,
        "stems": stems,
    }


def _stem(track: TreeTrack, axes: Float, now_s: float) -> dict[str, Any]:
    right_m, ahead_m = (float(value) for value in axes @ track.position_camera_m)
    record: dict[str, Any] = {
        "number": track.number,
        "colour": _hex(tree_colour(track.number)),
        "state": track.state,
        "in_view": track.tree is not None,
        "unseen_s": round(max(now_s - track.last_seen_s, 0.0), 2),
        "plan_m": [round(right_m, 3), round(ahead_m, 3)],
        "plan_std_m": round(float(np.max(track.position_m.std_m[:2])), 4),
        "distance_m": round(math.hypot(right_m, ahead_m), 3),
    }
    for quantity in QUANTITIES:
        estimate = getattr(track, quantity)
        if estimate:
            values = (round(value, 4) for value in estimate)
            record |= zip(interval_keys(quantity), values, strict=False)
        else:
            record |= interval_values(quantity, estimate)
    return {
        **record,
        "frames": track.frames,
        "views": track.views,
        "arc_deg": round(track.arc_deg, 1),
        "more_views_help": track.more_views_help,
        "warnings": list(track.warnings),
    }


def _hex(colour: Colour) -> str:
    """A colour, BGR, as in CSS."""
    blue, green, red = colour
    return f"#{red:02x}{green:02x}{blue:02x}"


def _field_of_view_deg(camera: PinholeCamera) -> list[float]:
    """Directions of the image's left and right edge in degrees, positive to the right."""
    edges = (-0.5 - camera.cx, camera.width - 0.5 - camera.cx)
    return [round(math.degrees(math.atan2(edge, camera.fx)), 1) for edge in edges]
