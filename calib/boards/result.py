"""What a calibration from boards gives: a camera with its uncertainty, or the reason for none."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal

from calib.boards.coverage import Coverage
from calib.camera import PinholeCamera


@dataclass(frozen=True)
class Parameter:
    """One intrinsic parameter with its standard deviation; ``unit`` is "px", or "" for none."""

    name: str
    value: float
    std: float
    unit: str


@dataclass(frozen=True)
class ViewResult:
    """How well one view fits: ``rms_px`` and ``worst_px`` of the distances between its ``points``
    used and where the camera has them.

    ``pose`` is a rotation vector and metres, from board to camera points; ``distance_m`` that of
    the board's middle along the optical axis, ``tilt_deg`` between that axis and the board's.
    """

    name: str
    points: int
    rms_px: float
    worst_px: float
    distance_m: float
    tilt_deg: float
    pose: tuple[float, ...]


@dataclass(frozen=True)
class Dropped:
    """What was left out: ``points`` (their indices) of a view, or all of it if there are none."""

    view: str
    points: tuple[int, ...]
    reason: str


@dataclass(frozen=True)
class Calibration:
    """A camera and how far to trust it; truthy even where it did not pass.

    ``rms_px`` is over all points used. ``reasons`` says why it did not pass, and is empty if it
    did; ``advice`` says what further views would help.
    """

    camera: PinholeCamera
    parameters: tuple[Parameter, ...]
    rms_px: float
    views: tuple[ViewResult, ...]
    dropped: tuple[Dropped, ...]
    coverage: Coverage
    reasons: tuple[str, ...]
    advice: tuple[str, ...]

    @property
    def passed(self) -> bool:
        """Whether the camera is good enough to measure with."""
        return not self.reasons

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready values."""
        return {
            "passed": self.passed,
            "reasons": list(self.reasons),
            "advice": list(self.advice),
            "camera": self.camera.to_dict(),
            "parameters": [asdict(parameter) for parameter in self.parameters],
            "rms_px": self.rms_px,
            "coverage": self.coverage.share,
            "views_per_cell": [list(row) for row in self.coverage.views_per_cell],
            "views": [asdict(view) for view in self.views],
            "dropped": [asdict(dropped) for dropped in self.dropped],
        }


@dataclass(frozen=True)
class CalibrationFailure:
    """No camera, and why; ``advice`` says what would help. Falsy."""

    reason: str
    advice: tuple[str, ...] = ()
    dropped: tuple[Dropped, ...] = ()

    def __bool__(self) -> Literal[False]:
        return False

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready values."""
        return {
            "passed": False,
            "reasons": [self.reason],
            "advice": list(self.advice),
            "dropped": [asdict(dropped) for dropped in self.dropped],
        }
