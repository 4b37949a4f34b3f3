"""Results of a board calibration: a camera with uncertainties, or a failure."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from calib.boards.coverage import Coverage
from calib.camera import PinholeCamera
from calib.errors import Failure


@dataclass(frozen=True)
class Parameter:
    """One intrinsic parameter.

    Attributes:
        name: fx, fy, cx, cy or the name of a distortion coefficient.
        value: Estimated value.
        std: Standard deviation of the value.
        unit: "px", or "" for coefficients without a unit.
    """

    name: str
    value: float
    std: float
    unit: str


@dataclass(frozen=True)
class ViewResult:
    """The fit of one view.

    Attributes:
        name: Name of the image.
        points: Number of points used.
        rms_px: RMS reprojection error of the points used.
        worst_px: Largest reprojection error of the points used.
        distance_m: Distance of the board's centre along the optical axis in metres.
        tilt_deg: Angle between the optical axis and the board's normal.
        pose: Rotation vector and translation in metres (6 numbers), board to camera coordinates.
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
    """A view, or some of its points, left out of the calibration.

    Attributes:
        view: Name of the image.
        points: Indices of the points left out; empty if the whole view was.
        reason: Why it was left out.
    """

    view: str
    points: tuple[int, ...]
    reason: str


@dataclass(frozen=True)
class Calibration:
    """A calibrated camera with its quality. Truthy even if it did not pass.

    Attributes:
        camera: The camera.
        parameters: Intrinsic parameters with standard deviations.
        rms_px: RMS reprojection error of all points used.
        views: Fit of each view used.
        dropped: Views and points left out.
        coverage: Coverage of the image by the views used.
        reasons: Why the calibration did not pass; empty if it did.
        advice: What further views would help.
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
        """Return JSON-ready values."""
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
class CalibrationFailure(Failure):
    """No camera could be estimated. Falsy.

    Attributes:
        reason: Why.
        advice: What would help.
        dropped: Views and points left out before the failure.
    """

    advice: tuple[str, ...] = ()
    dropped: tuple[Dropped, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Return JSON-ready values."""
        return {
            "passed": False,
            "reasons": [self.reason],
            "advice": list(self.advice),
            "dropped": [asdict(dropped) for dropped in self.dropped],
        }
