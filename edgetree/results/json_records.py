"""Results as JSON values. The unit of each number is in its key or its parent's key."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict
from typing import TYPE_CHECKING, Any, Final, TextIO

from calib import encode_rle
from edgetree.detections import KEYPOINT_NAMES, TreeDetections, UnlikeTraining
from edgetree.frames.pipeline import FrameResult
from edgetree.measure import Failure, PixelSize
from edgetree.measure.estimates import interval_keys, interval_values

if TYPE_CHECKING:
    from edgetree.live.results import LiveResult
    from edgetree.live.tracking.tracks import TreeTrack

FRAME_SCHEMA: Final = "edgetree.frame/1"
LIVE_SCHEMA: Final = "edgetree.live/1"
STEMS_SCHEMA: Final = "edgetree.live.stems/1"
TRACK_QUANTITIES: Final = ("diameter_m", "dbh_m", "cut_height_m", "inclination_deg")


def frame_record(result: FrameResult) -> dict[str, Any]:
    """A frame's result as a JSON object.

    Pixel coordinates are continuous, with (0, 0) at the outer corner of the first pixel. `tree` is
    the number in tables and pictures, `track` that of the stem in all frames of a stream (null
    until three frames show it; not there for pictures), `box_px` is x0, y0, x1, y1, a keypoint is
    x, y, score, and `mask_rle` is a compressed COCO RLE mask of the image's size. `pixels` is the
    tree's width in the picture, which needs neither depth nor camera. `metres` is the measurement,
    or null if there is none; `metres_need` then says which option is missing. `unlike_training` is
    the statistic that tells that the image looks unlike the training pictures, with advice; it is
    there only then. `alone` says which image a model of colour and depth used alone, and why; it is
    there only then.
    """
    trees = result.trees
    record: dict[str, Any] = {
        "schema": FRAME_SCHEMA,
        "frame": result.frame.name,
        "path": result.frame.where,
        "image_width_px": trees.image_width,
        "image_height_px": trees.image_height,
        "detect_ms": round(result.detect_ms, 1),
        "trees": [_tree_record(result, index) for index in range(len(trees))],
    }
    if result.frame.time_s is not None:
        record["time_s"] = result.frame.time_s
    if trees.unlike is not None:
        record["unlike_training"] = _unlike_record(trees.unlike)
    return record | _alone(trees)


def _alone(trees: TreeDetections) -> dict[str, Any]:
    return {} if trees.alone is None else {"alone": asdict(trees.alone)}


def _unlike_record(unlike: UnlikeTraining) -> dict[str, Any]:
    return {
        "statistic": unlike.statistic,
        "value": round(float(unlike.value), 3),
        "usual": [unlike.low, unlike.high],
        "unit": unlike.unit,
        "advice": unlike.advice,
    }


def _tree_record(result: FrameResult, index: int) -> dict[str, Any]:
    trees = result.trees
    record: dict[str, Any] = {"tree": result.found.numbers[index]}
    if result.found.tracks is not None:
        record["track"] = result.found.tracks[index]
    record |= _detection(result, index)
    if trees.keypoints_px is not None:
        record["keypoints_px"] = {
            name: [*_rounded((x, y), 2), *_rounded((score,), 4)]
            for name, (x, y, score) in zip(KEYPOINT_NAMES, trees.keypoints_px[index], strict=True)
        }
    mask = result.found.mask(index)
    if mask is not None:
        record["mask_rle"] = encode_rle(mask)
    record["pixels"] = _pixels(result.pixel_sizes[index])
    record["metres"] = _metres(result, index)
    if result.measurements is None:
        record["metres_need"] = result.metres_need
    return record


def live_record(result: LiveResult) -> dict[str, Any]:
    """A live result as a JSON object of the schema `LIVE_SCHEMA`.

    `tree` counts the trees of the frame from 1 on; `track` is the number of the stem, the same
    as long as it is followed. Lengths are in metres, pixel coordinates are continuous. `alone`
    is as in `frame_record`.
    """
    frame, trees = result.frame, result.trees
    followed: dict[int | None, int | None] = dict(enumerate(result.found.tracks or ()))
    followed |= {track.tree: track.number for track in result.tracks}
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
                **_detection(result, index),
                "metres": _metres(result, index),
            }
            for index in range(len(trees))
        ],
        "tracks": [track_record(track) for track in result.tracks],
    }
    if result.metres_need is not None:
        record["metres_need"] = result.metres_need
    return record | _alone(trees)


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
        record |= interval_values(quantity, getattr(track, quantity))
    return {
        **record,
        "frames": track.frames,
        "views": track.views,
        "arc_deg": track.arc_deg,
        "more_views_help": track.more_views_help,
        "last_seen_s": track.last_seen_s,
        "map_part": track.map_part,
        "absorbed": list(track.absorbed),
        "warnings": list(track.warnings),
    }


def stems_message(result: LiveResult, max_bytes: int, sequence: int | None = None) -> bytes:
    """The stems of a result as a short JSON text of the schema `STEMS_SCHEMA`.

    Args:
        result: The result.
        max_bytes: Limit of the text. The farthest stems are left out until it fits, and
            `left_out` says how many; without any stem the text has some 100 bytes.
        sequence: Number of the message, from which a receiver tells that some were lost.
    """
    stems = sorted(result.tracks, key=lambda track: float((track.position_camera_m**2).sum()))
    records = [_short(track) for track in stems]
    # Each stem adds its own text and a comma, so that the number of stems needs no search.
    sizes = [len(_text(record)) + 1 for record in records]
    room = max_bytes - len(_text(_message(result, [], len(records), sequence)))
    count = 0
    while count < len(records) and sizes[count] <= room:
        room -= sizes[count]
        count += 1
    return _text(_message(result, records[:count], len(records) - count, sequence))


def _message(
    result: LiveResult, records: list[dict[str, Any]], left_out: int, sequence: int | None
) -> dict[str, Any]:
    return {
        "schema": STEMS_SCHEMA,
        **({} if sequence is None else {"sequence": sequence}),
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
        "position_camera_m": _rounded(track.position_camera_m, 3),
    }
    for quantity in ("diameter_m", "cut_height_m"):
        result = getattr(track, quantity)
        values = _rounded(result, 4) if result else (None, None)
        record |= zip(interval_keys(quantity)[:2], values, strict=True)
    return {**record, "last_seen_s": track.last_seen_s}


def _detection(result: FrameResult, index: int) -> dict[str, Any]:
    trees = result.trees
    (score,) = _rounded((trees.scores[index],), 4)
    return {"score": score, "box_px": _rounded(trees.boxes_px[index], 2)}


def _metres(result: FrameResult, index: int) -> dict[str, Any] | None:
    return None if result.measurements is None else result.measurements[index].to_dict()


def _pixels(size: PixelSize | Failure) -> dict[str, Any]:
    """The size in the picture as a JSON object, or the reason why there is none."""
    if isinstance(size, Failure):
        return {"width_failure": size.reason}
    return {
        name: round(value, 3) if isinstance(value, float) else value
        for name, value in size.to_dict().items()
    }


def _rounded(values: Iterable[float], digits: int) -> list[float]:
    return [round(float(value), digits) for value in values]


def _text(value: dict[str, Any]) -> bytes:
    return json.dumps(value, allow_nan=False, separators=(",", ":")).encode()


def write_json_line(stream: TextIO, record: dict[str, Any]) -> None:
    """Write one record as one line and flush the stream, for programs that read along."""
    stream.write(json.dumps(record, allow_nan=False) + "\n")
    stream.flush()
