"""False alarms and found faults of `edgetree check-rig` on simulated drives.

perceptree synth --out DRIVES/1 --preset drive --frames 150 --width 640 --height 360 --seed 1
python -m benchmarks.check_rig DRIVES/* --result benchmarks/results/check_rig.json

Every drive is checked as it is, and then with one fault at a time, put into its frames. Of a fault,
only the group of checks runs that should find it.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from benchmarks.check_rig_faults import (
    Change,
    focal,
    hanging,
    heading,
    late,
    parallax,
    scaled,
    tilted,
    warped,
)
from benchmarks.tools.program import finish, note, program
from calib import PinholeCamera
from edgetree import TreeDetections, TreeDetector
from edgetree.catalogue import default_model
from edgetree.frames import Rig
from edgetree.frames.frame import Frame
from edgetree.rig_check import RigCheck, RigReport, check_rig
from edgetree.rig_check.alignment import FrameSilhouettes, alignment_checks
from edgetree.rig_check.image_motion import image_velocity
from edgetree.rig_check.odometry import odometry_checks
from edgetree.rig_check.silhouettes import find_silhouettes
from edgetree.rig_check.stem_sightings import StemFinder
from edgetree.rig_check.stream import StreamCounts
from edgetree.rig_check.vertical import vertical_checks
from edgetree.sources.drive import open_drive
from edgetree.sources.source import BaseSource

Group = Callable[[list[Frame], Any], list[RigCheck]]

# Two of the ten frames per second are searched, as `check_rig` does.
_EVERY = 5


@dataclass(frozen=True)
class Fault:
    """A fault: the check that should find it, the value that it should find, and the change.

    The change gets a frame and the one before it. `group` runs the checks.
    """

    check: str
    expected: float
    change: Change
    group: Group


class FaultySource(BaseSource):
    """A drive with a fault."""

    def __init__(self, name: str, frames: list[Frame], change: Change | None = None) -> None:
        super().__init__(name)
        self._frames, self._change = frames, change

    def __iter__(self) -> Iterator[Frame]:
        change = self._change
        for before, frame in zip([self._frames[0], *self._frames], self._frames, strict=False):
            yield frame if change is None else change(frame, before)


class RememberingDetector:
    """A detector that finds the trees of each picture once."""

    def __init__(self, detector: TreeDetector) -> None:
        self._detector, self.manifest = detector, detector.manifest
        self._known: dict[bytes, TreeDetections] = {}

    def detect(self, image: NDArray[Any], camera: PinholeCamera | None = None) -> TreeDetections:
        """The trees of a picture."""
        key = hashlib.sha256(image.tobytes() + repr(camera).encode()).digest()
        if key not in self._known:
            self._known[key] = self._detector.detect(image, camera=camera)
        return self._known[key]


def main() -> None:
    """Check all drives; the result is written after each."""
    parser = program(__doc__)
    parser.add_argument("drives", type=Path, nargs="+", help="folders of drives")
    parser.add_argument("--with-faults", type=int, help="faults in the first so many; default: all")
    arguments = parser.parse_args()
    detector = TreeDetector.load(default_model("depth"), threads=1)
    most = len(arguments.drives) if arguments.with_faults is None else arguments.with_faults
    unchanged: list[RigReport] = []
    faulty: dict[str, list[list[RigCheck]]] = {name: [] for name in faults()}
    for number, drive in enumerate(arguments.drives):
        frames = list(open_drive(drive))
        remembering: Any = RememberingDetector(detector)
        unchanged.append(check_rig(FaultySource(drive.name, frames), remembering))
        if number < most:
            for name, fault in faults().items():
                changed = FaultySource(drive.name, frames, fault.change)
                faulty[name].append(fault.group(list(changed), remembering))
        result = {
            "drives": len(unchanged),
            "drives_with_faults": min(most, len(unchanged)),
            "frames": [report.frames for report in unchanged],
            "unchanged": unchanged_figures(unchanged),
            "faults": {name: fault_figures(each, faulty[name]) for name, each in faults().items()},
        }
        finish(result, arguments.result)
        note(f"{drive}: done")


def unchanged_figures(reports: list[RigReport]) -> dict[str, Any]:
    """Verdicts, values and half-intervals of each check over the unchanged drives."""
    figures: dict[str, Any] = {}
    for checks in zip(*(report.checks for report in reports), strict=True):
        values = [check.value for check in checks if check.value is not None]
        halves = [check.half_interval for check in checks if check.half_interval is not None]
        figures[checks[0].name] = {
            **verdicts([check.verdict for check in checks]),
            "values": [round(value, 3) for value in values],
            "half_intervals95": [round(half, 3) for half in halves],
        }
    return figures


def fault_figures(fault: Fault, reports: list[list[RigCheck]]) -> dict[str, Any]:
    """How many drives show a fault, and the error of its estimate."""
    checks = [check for report in reports for check in report if check.name == fault.check]
    errors = [check.value - fault.expected for check in checks if check.value is not None]
    others = [
        check.name
        for report in reports
        for check in report
        if check.name != fault.check and check.verdict == "does not hold"
    ]
    return {
        "check": fault.check,
        "expected": fault.expected,
        **verdicts([check.verdict for check in checks]),
        "errors": [round(error, 3) for error in errors],
        "half_intervals95": [
            round(check.half_interval, 3) for check in checks if check.half_interval is not None
        ],
        "other_checks_that_fail": {name: others.count(name) for name in sorted(set(others))},
    }


def verdicts(found: list[str]) -> dict[str, int]:
    """How often each verdict was given."""
    return {name: found.count(name) for name in ("holds", "does not hold", "cannot tell")}


def faults() -> dict[str, Fault]:
    """All faults by name."""
    right, down, size, turn = "shift to the right", "shift downwards", "size", "turn clockwise"
    away, left = "stems lean away from the camera", "stems lean to the left"
    depth, ahead = "scale of the depth", "heading to the left"
    moved: dict[str, tuple[str, float, Change]] = {
        **{f"shift {px:+d} px right": (right, px, warped(x=px)) for px in (1, 2, -4, 8)},
        **{f"shift {px:+d} px down": (down, px, warped(y=px)) for px in (2, -4, 8)},
        **{f"size {p:+d} %": (size, p, warped(size=1 + p / 100)) for p in (1, -2)},
        **{f"turn {deg:+.1f} deg": (turn, deg, warped(turn=deg)) for deg in (0.5, -1.0)},
        "baseline +40 mm": ("error of the baseline", 40, parallax(0.04)),
        "delay of 100 ms": ("delay of the depth", 100, late),
    }
    turned: dict[str, tuple[str, float, Change]] = {
        **{f"vertical {deg} deg ahead": (away, deg, tilted(deg, 0)) for deg in (1, 2, 4, 8)},
        **{f"vertical {deg} deg aside": (left, deg, tilted(deg, 2)) for deg in (1, 2, 4, 8)},
        **{f"depth {p:+d} %": (depth, p, scaled(1 + p / 100)) for p in (2, -5)},
        **{f"focal length {p:+d} %": ("focal length", p, focal(1 + p / 100)) for p in (2, 5)},
        **{f"heading {deg} deg": (ahead, deg, heading(deg)) for deg in (2, 4)},
    }
    return {
        **{name: Fault(*fault, alignment) for name, fault in moved.items()},
        **{name: Fault(*fault, stems) for name, fault in turned.items()},
        "depth hangs": Fault("depth that repeats", 10, hanging, stream),
    }


def alignment(frames: list[Frame], _: Any) -> list[RigCheck]:
    """The checks of depth against colour."""
    found = []
    for before, frame in list(pairwise(frames))[::_EVERY]:
        assert frame.image is not None
        assert before.image is not None
        assert frame.depth_m is not None
        assert frame.number is not None
        seen = find_silhouettes(frame.image, frame.depth_m, frame.number)
        step_s = frame.stamp_s - before.stamp_s
        velocity = image_velocity(before.image, frame.image, step_s, seen.xy_px)
        found.append(FrameSilhouettes(frame.stamp_s, seen, velocity))
    camera = frames[0].camera
    assert camera is not None
    return alignment_checks(found, camera)


def stems(frames: list[Frame], detector: Any) -> list[RigCheck]:
    """The checks by stems."""
    finder = StemFinder(detector, Rig())
    for frame in frames[::_EVERY]:
        finder.add(frame)
    return vertical_checks(finder.sightings) + odometry_checks(finder.sightings)


def stream(frames: list[Frame], _: Any) -> list[RigCheck]:
    """The checks of the frames themselves."""
    counts = StreamCounts()
    for frame in frames:
        counts.add(frame)
    return counts.checks({})


if __name__ == "__main__":
    main()
