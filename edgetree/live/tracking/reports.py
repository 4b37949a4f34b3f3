"""Report followed stems as `TreeTrack`."""

from __future__ import annotations

import math

import numpy as np

from basetree.arrays import Float
from basetree.counts import counted
from edgetree.live.tracking.motion import CameraMotion
from edgetree.live.tracking.settings import TrackingSettings
from edgetree.live.tracking.sightings import CUT_LEVEL, DIAMETER, QUANTITIES
from edgetree.live.tracking.stems import StemMap
from edgetree.live.tracking.tracks import TreeTrack
from edgetree.measure import Estimate, Failure, PointEstimate
from edgetree.measure.cut_diameter import if_certain

# Standard deviation of the height of a point on an axis as the place of a cut that was never seen.
_UNSEEN_CUT_STD_M = 1.0
_UNMEASURED = Failure("it has not been measured yet")
_NAMES = {
    "diameter_m": ("diameters", "m"),
    "dbh_m": ("diameters at breast height", "m"),
    "cut_height_m": ("cut heights", "m"),
    "inclination_deg": ("inclinations", "deg"),
}


def report_tracks(
    stems: StemMap, motion: CameraMotion, level: Float, settings: TrackingSettings, remark: str
) -> list[TreeTrack]:
    """All followed stems.

    Args:
        stems: The stems.
        motion: Place of the camera in the map.
        level: (3, 3) rotation from the camera's frame to the level frame.
        settings: What counts as a help.
        remark: a warning for all of them; empty if there is none.
    """
    rows = stems.rows
    known = np.isfinite(rows["stds"])
    level_known = known[:, CUT_LEVEL]
    height_m = np.where(level_known, rows["values"][:, CUT_LEVEL], rows["reference_m"])
    rise = (height_m - rows["reference_m"])[:, None]
    place = rows["line"][:, :2] + rise * rows["line"][:, 2:]
    spread = rows["line_covariance"]
    diagonal = np.stack([spread[:, 0, 0], spread[:, 1, 1]], -1)
    diagonal = diagonal + 2 * rise * np.stack([spread[:, 0, 2], spread[:, 1, 3]], -1)
    diagonal = diagonal + rise**2 * np.stack([spread[:, 2, 2], spread[:, 3, 3]], -1)
    height_std = np.where(level_known, rows["stds"][:, CUT_LEVEL], _UNSEEN_CUT_STD_M)
    point = np.column_stack([place, height_m])
    std = np.column_stack([np.sqrt(np.maximum(diagonal, 0.0)), height_std])
    level_place = np.column_stack(
        [(place - motion.state[:2]) @ motion.rotation(), height_m - motion.height_m]
    )
    in_camera = level_place @ level
    now, following = (
        np.hypot(rows[name], rows["rig_stds"])[:, DIAMETER] for name in ("stds", "next_stds")
    )
    better = following < (1 - settings.min_narrowing) * now
    helps = (better | ~known[:, DIAMETER]).tolist()
    confirmed = stems.confirmed.tolist()
    values, stds = rows["values"].tolist(), np.hypot(rows["stds"], rows["rig_stds"]).tolist()
    columns = zip(
        *(
            rows[name].tolist()
            for name in ("number", "tree", "frames", "views", "arc_deg", "last_seen_s")
        ),
        strict=True,
    )
    troubled = (
        (rows["conflict"] > 1.0).any(1) | (rows["contradicting"] > 0) | (rows["split_from"] > 0)
    )
    common = (remark,) if remark else ()
    tracks = []
    for row, (number, tree, frames, views, arc_deg, last_seen_s) in enumerate(columns):
        fused = [
            Estimate(value, deviation)
            if math.isfinite(deviation)
            else stems.reasons[row].get(name, _UNMEASURED)
            for name, value, deviation in zip(QUANTITIES, values[row], stds[row], strict=False)
        ]
        tracks.append(
            TreeTrack(
                number=number,
                tree=tree if tree >= 0 else None,
                state="confirmed" if confirmed[row] else "new",
                position_m=PointEstimate(point[row], std[row]),
                position_camera_m=in_camera[row],
                diameter_m=_if_certain(fused[0], "diameter"),
                dbh_m=_if_certain(fused[1], "diameter at breast height"),
                cut_height_m=fused[2],
                inclination_deg=fused[3],
                frames=frames,
                views=views,
                arc_deg=arc_deg,
                more_views_help=helps[row],
                last_seen_s=last_seen_s,
                map_part=stems.map_part,
                absorbed=stems.absorbed.get(number, ()),
                warnings=common + _warnings(stems, row) if troubled[row] else common,
            )
        )
    return tracks


def _if_certain(diameter: Estimate | Failure, name: str) -> Estimate | Failure:
    return if_certain(diameter, name) if isinstance(diameter, Estimate) else diameter


def _warnings(stems: StemMap, row: int) -> tuple[str, ...]:
    stem = stems.rows[row]
    warnings = []
    if stem["split_from"]:
        warnings.append(
            f"split from stem {stem['split_from']}: {counted(stem['frames'], 'frame')}"
            " saw it elsewhere"
        )
    for column, name in enumerate(QUANTITIES):
        if stem["conflict"][column] > 1.0:
            low, high = stem["spread"][column].tolist()
            what, unit = _NAMES[name]
            warnings.append(
                f"the views contradict each other: {what} from {low:.2f} to {high:.2f} {unit};"
                " the interval is widened"
            )
    if stem["contradicting"]:
        warnings.append(
            f"the stem is elsewhere in {counted(stem['contradicting'], 'frame')}, not counted"
        )
    return tuple(warnings)
