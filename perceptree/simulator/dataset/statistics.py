"""Statistics of a dataset: frames, trees, distances, sizes, visibility and conditions."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import PurePosixPath
from typing import Any

import numpy as np

from perceptree.keypoints import KEYPOINT_NAMES
from perceptree.simulator.settings import DEPTH_KINDS, GROUNDS, SPECIES, TIMES, WEATHERS

Record = dict[str, Any]
Figures = dict[str, Any]

PAPER_TREES_PER_FRAME = 3.8

_FLAGS = ("outside", "hidden", "visible")
_TREE_EDGES: dict[str, list[float]] = {
    "distance_m": [float(edge) for edge in range(11)],
    "diameter_m": [0.05 * edge for edge in range(17)],
    "diameter_breast_m": [0.05 * edge for edge in range(17)],
    "inclination_deg": [2.0 * edge for edge in range(13)],
    "visible_fraction": [0.1 * edge for edge in range(11)],
}
_BOX_STEPS = 16


def dataset_statistics(splits: dict[str, list[Record]]) -> Figures:
    """Compute the statistics of a dataset.

    Args:
        splits: Frame records of each split.

    Returns:
        Values that JSON can hold, by topic.
    """
    records = [record for split in splits.values() for record in split]
    images = [record["image"] for record in records]
    trees = [tree for record in records for tree in record["annotations"]]
    scenes = {image["scene"]["seed"]: image["scene"] for image in images}.values()
    return {
        "splits": {name: _split_figures(split) for name, split in splits.items() if split},
        "trees_per_frame": _trees_per_frame(records),
        "tree": _tree_figures(trees, images),
        "keypoints": _keypoint_flags(trees),
        "species": _counts((tree["species"] for tree in trees), SPECIES),
        "models": _counts((tree["model"] for tree in trees), ()),
        "weather_by_light": {
            weather: _counts(
                (i["scene"]["light"] for i in images if i["scene"]["weather"] == weather), TIMES
            )
            for weather in WEATHERS
        },
        "terrain": _counts((image["scene"]["terrain"] for image in images), GROUNDS),
        "slope_deg": _histogram([s["slope_deg"] for s in scenes], [3.0 * n for n in range(11)]),
        "stems_per_ha": _histogram(
            [s["stems_per_ha"] for s in scenes], _round_edges([s["stems_per_ha"] for s in scenes])
        ),
        "carrier": _counts((image["pose"]["carrier"] for image in images), ()),
        "depth_sensor": _counts((i["depth_sensor"]["kind"] for i in images), DEPTH_KINDS),
        "depth_valid_share": _valid_shares(records),
        "bytes_per_frame": _bytes(records),
        "realism": _realism(images),
    }


def conditions(figures: Figures) -> dict[str, dict[str, int]]:
    """Count the frames of each condition.

    Args:
        figures: Result of `dataset_statistics`.

    Returns:
        Number of frames by kind of condition and value; values that do not occur are left out.
    """
    weather = figures["weather_by_light"]
    lights = {name: sum(row[name] for row in weather.values()) for name in TIMES}
    found = {
        "weather": {name: sum(row.values()) for name, row in weather.items()},
        "light": lights,
        "ground": figures["terrain"],
        "carrier": figures["carrier"],
        "depth sensor": figures["depth_sensor"],
        "addition": figures["realism"],
    }
    return {
        group: {name: count for name, count in counts.items() if count}
        for group, counts in found.items()
        if any(counts.values())
    }


def _realism(images: list[dict[str, Any]]) -> dict[str, int]:
    """Number of frames with each addition beyond the paper's conditions."""
    counts: Counter[str] = Counter()
    for image in images:
        counts.update(name for name, value in image.get("realism", {}).items() if value)
    return dict(sorted(counts.items()))


def _split_figures(records: list[Record]) -> Figures:
    trees = sum(len(record["annotations"]) for record in records)
    return {
        "scenes": len({record["image"]["scene"]["seed"] for record in records}),
        "frames": len(records),
        "trees": trees,
        "trees_per_frame": round(trees / len(records), 3),
    }


def _trees_per_frame(records: list[Record]) -> Figures:
    counts = [len(record["annotations"]) for record in records]
    histogram = np.bincount(counts) if counts else np.zeros(1, int)
    return {
        "mean": round(float(np.mean(counts)), 3) if counts else 0.0,
        "counts": histogram.tolist(),
    }


def _tree_figures(trees: list[Record], images: list[Record]) -> Figures:
    figures = {}
    for name, usual in _TREE_EDGES.items():
        values = [tree[name] for tree in trees]
        figures[name] = _histogram(values, _extended(usual, values))
    width, height = (max(image[side] for image in images) for side in ("width", "height"))
    for axis, name, longest in ((2, "box_width_px", width / 2), (3, "box_height_px", height)):
        edges = [longest * step / _BOX_STEPS for step in range(_BOX_STEPS + 1)]
        figures[name] = _histogram([tree["bbox"][axis] for tree in trees], edges)
    return figures


def _histogram(values: Sequence[float], edges: list[float]) -> Figures:
    """Histogram with outliers in the outermost bins, and quantiles."""
    array = np.asarray(values, float)
    figures: Figures = {"edges": [round(edge, 6) for edge in edges]}
    inside = np.clip(array, edges[0], edges[-1])
    figures["counts"] = np.histogram(inside, edges)[0].tolist()
    if array.size:
        low, median, high = np.percentile(array, (5, 50, 95))
        summary = {"mean": array.mean(), "p5": low, "median": median, "p95": high}
        figures |= {name: round(float(value), 4) for name, value in summary.items()}
    return figures


def _extended(edges: list[float], values: Sequence[float]) -> list[float]:
    """Append edges with the same step until the largest value is included."""
    step = edges[1] - edges[0]
    bins = max(len(edges) - 1, int(np.ceil(max(values, default=0.0) / step - 1e-9)))
    return [step * edge for edge in range(bins + 1)]


def _round_edges(values: Iterable[float]) -> list[float]:
    """Edges in steps of 100 that include all values."""
    array = np.asarray(list(values))
    low, high = int(array.min() // 100), int(array.max() // 100) + 1
    return [100.0 * edge for edge in range(low, high + 1)]


def _keypoint_flags(trees: list[Record]) -> Figures:
    """Number of trees whose keypoint is visible, hidden or outside the frame, by keypoint."""
    flags = np.array([tree["keypoints"][2::3] for tree in trees], int).reshape(-1, 5)
    return {
        name: {flag: int((flags[:, number] == value).sum()) for value, flag in enumerate(_FLAGS)}
        for number, name in enumerate(KEYPOINT_NAMES)
    }


def _counts(values: Iterable[str], known: tuple[str, ...]) -> dict[str, int]:
    """Count values, known ones first in their order."""
    counts = Counter(values)
    names = [*known, *sorted(set(counts) - set(known))]
    return {name: counts[name] for name in names}


def _valid_shares(records: list[Record]) -> Figures:
    """Mean fraction of pixels with a depth reading, of all frames and by kind of sensor."""
    shares: dict[str, list[float]] = {"all": []}
    for record in records:
        for name in ("all", record["image"]["depth_sensor"]["kind"]):
            shares.setdefault(name, []).append(record["depth_valid_share"])
    return {name: round(float(np.mean(shares[name])), 4) for name in sorted(shares)}


def _bytes(records: list[Record]) -> Figures:
    """Mean bytes per frame by folder, and mean and maximum of all files of a frame."""
    folders: Counter[str] = Counter()
    totals = []
    for record in records:
        for name, size in record["bytes"].items():
            folders[PurePosixPath(name).parts[0]] += size
        totals.append(sum(record["bytes"].values()))
    means = {folder: round(folders[folder] / len(records)) for folder in sorted(folders)}
    return {"folders": means, "mean": round(float(np.mean(totals))), "largest": max(totals)}
