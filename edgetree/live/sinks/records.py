"""Live results as JSON objects: everything for files, and a short message for controllers."""

from __future__ import annotations

import json
from typing import Any, Final

from edgetree.live.results import LiveResult
from edgetree.live.tracking.tracks import TreeTrack
from edgetree.measure import Failure
from edgetree.measure.estimates import split_unit

__all__ = [
    "LIVE_SCHEMA",
    "STEMS_SCHEMA",
    "TRACK_QUANTITIES",
    "live_record",
    "stems_message",
    "track_record",
]

LIVE_SCHEMA: Final = "edgetree.live/1"
STEMS_SCHEMA: Final = "edgetree.live.stems/1"
TRACK_QUANTITIES: Final = ("diameter_m", "dbh_m", "cut_height_m", "inclination_deg")


def live_record(result: LiveResult) -> dict[str, Any]:
    """A live result as a JSON object of the schema `LIVE_SCHEMA`.

    `tree` counts the trees of the frame from 1 on; `track` is the number of the stem, the same
    as long as it is followed. Lengths are in metres, pixel coordinates are continuous.
    """
    frame, trees = result.frame, result.trees
    followed = {track.tree: track.number for track in result.tracks}
    record: dict[str, Any] = {
        "schema": LIVE_SCHEMA,
        "frame": frame.number,
        "time_s": frame.time_s,
        "image_width_px": trees.image_width,
        "image_height_px": trees.image_height,
        "age_s": round(result.age_s, 4),
        "dropped": result.dropped,
        "stages_ms": {name: round(ms, 2) for name, ms in result.stages_ms.items()},
        "trees": [
            {
                "tree": index + 1,
                "track": followed.get(index),
                "score": round(float(trees.scores[index]), 4),
                "box_px": [round(float(value), 2) for value in trees.boxes_px[index]],
                "metres": None
                if result.measurements is None
                else result.measurements[index].to_dict(),
            }
            for index in range(len(trees))
        ],
        "tracks": [track_record(track) for track in result.tracks],
    }
    if result.metres_need is not None:
        record["metres_need"] = result.metres_need
    return record


def track_record(track: TreeTrack) -> dict[str, Any]:
    """A stem that is followed as a JSON object."""
    record: dict[str, Any] = {
        "track": track.number,
        "state": track.state,
        "tree": None if track.tree is None else track.tree + 1,
        "position_m": track.position_m.xyz_m.tolist(),
        "position_std_m": track.position_m.std_m.tolist(),
        "position_camera_m": track.position_camera_m.tolist(),
    }
    for quantity in TRACK_QUANTITIES:
        name, unit = split_unit(quantity)
        estimate = getattr(track, quantity)
        if isinstance(estimate, Failure):
            record[f"{name}_failure"] = estimate.reason
            continue
        record[quantity] = estimate.value
        record[f"{name}_std_{unit}"] = estimate.std
        record[f"{name}_low95_{unit}"], record[f"{name}_high95_{unit}"] = estimate.interval95
    return {
        **record,
        "frames": track.frames,
        "views": track.views,
        "arc_deg": track.arc_deg,
        "more_views_help": track.more_views_help,
        "last_seen_s": track.last_seen_s,
        "warnings": list(track.warnings),
    }


def stems_message(result: LiveResult, max_bytes: int) -> bytes:
    """The stems of a result as a short JSON text of the schema `STEMS_SCHEMA`.

    Args:
        result: the result.
        max_bytes: limit of the text. The farthest stems are left out until it fits, and
            `left_out` says how many.
    """
    stems = sorted(result.tracks, key=lambda track: float((track.position_camera_m**2).sum()))
    records = [_short(track) for track in stems]
    # Each stem adds its own text and a comma, so that the number of stems needs no search.
    sizes = [len(_text(record)) + 1 for record in records]
    room = max_bytes - len(_text(_message(result, [], len(records))))
    count = 0
    while count < len(records) and sizes[count] <= room:
        room -= sizes[count]
        count += 1
    return _text(_message(result, records[:count], len(records) - count))


def _message(result: LiveResult, records: list[dict[str, Any]], left_out: int) -> dict[str, Any]:
    return {
        "schema": STEMS_SCHEMA,
        "frame": result.frame.number,
        "time_s": result.frame.time_s,
        "age_s": round(result.age_s, 4),
        "left_out": left_out,
        "stems": records,
    }


def _short(track: TreeTrack) -> dict[str, Any]:
    """What a controller needs of a stem; null for what was not measured."""
    record: dict[str, Any] = {
        "track": track.number,
        "state": track.state,
        "in_view": track.tree is not None,
        "position_camera_m": [round(float(value), 3) for value in track.position_camera_m],
    }
    for quantity in ("diameter_m", "cut_height_m"):
        name, unit = split_unit(quantity)
        estimate = getattr(track, quantity)
        failed = isinstance(estimate, Failure)
        record[quantity] = None if failed else round(estimate.value, 4)
        record[f"{name}_std_{unit}"] = None if failed else round(estimate.std, 4)
    return {**record, "last_seen_s": track.last_seen_s}


def _text(value: dict[str, Any]) -> bytes:
    return json.dumps(value, allow_nan=False, separators=(",", ":")).encode()
