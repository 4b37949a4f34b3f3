"""What a shift between depth and colour does to diameters, for the limit of `edgetree check-rig`.

perceptree synth --out DRIVES/1 --preset drive --frames 150 --width 640 --height 360 --seed 1
python -m benchmarks.check_rig_limits DRIVES/* --result benchmarks/results/check_rig_limits.json

The packaged colour model finds the stems; they are measured with depth that is shifted sideways.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.check_rig_faults import warped
from benchmarks.tools.program import finish, program
from edgetree import TreeDetector
from edgetree.catalogue import default_model
from edgetree.frames.frame import Frame
from edgetree.measure import Failure, TreeMeasurement, measure_trees
from edgetree.sources.drive import open_drive

_EVERY = 5
_SHIFTS_PX = (-8, -4, -2, -1, 1, 2, 4, 8)
# Shifts as shares of the stem's width in the picture.
_CLASSES = ((0.0, 0.1), (0.1, 0.2), (0.2, 0.3), (0.3, 0.5), (0.5, 1.0))


def main() -> None:
    """Measure the stems of all drives and write the changes by class."""
    parser = program(__doc__)
    parser.add_argument("drives", type=Path, nargs="+", help="folders of drives")
    arguments = parser.parse_args()
    detector = TreeDetector.load(default_model("rgb"), threads=1)
    rows = np.array(
        [
            row
            for drive in arguments.drives
            for number, frame in enumerate(open_drive(drive))
            if number % _EVERY == 0
            for row in changes(frame, detector)
        ]
    )
    result = {
        "drives": len(arguments.drives),
        "stems": len(rows) // len(_SHIFTS_PX),
        "classes": [figures(rows, low, high) for low, high in _CLASSES],
    }
    finish(result, arguments.result)


def changes(frame: Frame, detector: TreeDetector) -> list[tuple[float, float]]:
    """Of each stem and shift: the shift over the stem's width, and the relative change.

    The change is NaN where the stem could not be measured any more.
    """
    assert frame.image is not None
    assert frame.camera is not None
    trees = detector.detect(frame.image)

    def measured(changed: Frame) -> list[TreeMeasurement]:
        assert changed.depth_m is not None
        assert frame.camera is not None
        return measure_trees(trees, changed.depth_m, frame.camera, up_camera=frame.up_camera)

    rows = []
    right = measured(frame)
    for shift_px in _SHIFTS_PX:
        for before, after in zip(right, measured(warped(x=shift_px)(frame, frame)), strict=True):
            if isinstance(before.diameter_m, Failure) or isinstance(before.distance_m, Failure):
                continue
            width_px = frame.camera.fx * before.diameter_m.value / before.distance_m.value
            change = float("nan")
            if not isinstance(after.diameter_m, Failure):
                change = after.diameter_m.value / before.diameter_m.value - 1
            rows.append((abs(shift_px) / width_px, change))
    return rows


def figures(rows: Any, low: float, high: float) -> dict[str, Any]:
    """The changes of one class."""
    change = np.abs(rows[(rows[:, 0] >= low) & (rows[:, 0] < high), 1])
    known = change[~np.isnan(change)]
    return {
        "shift_over_width": [low, high],
        "count": len(change),
        "median_change": round(float(np.median(known)), 4),
        "tenth_changes_more_than": round(float(np.quantile(known, 0.9)), 4),
        "not_measured": round(1 - len(known) / len(change), 4),
    }


if __name__ == "__main__":
    main()
