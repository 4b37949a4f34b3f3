"""What a measurement is: a value with its standard deviation, or a failure with its reason."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Final, Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

__all__ = ["QUANTITIES", "Estimate", "Evidence", "Failure", "PointEstimate", "TreeMeasurement"]

JsonValue: TypeAlias = float | str | bool | list[float] | list[str] | dict[str, float] | None

QUANTITIES: Final = (
    "diameter_m",
    "dbh_m",
    "cut_height_m",
    "inclination_deg",
    "lean_direction_deg",
    "distance_m",
)
"""The numbers of a `TreeMeasurement`, in the order in which records hold them."""

_NORMAL_95 = 1.96


class Estimate(NamedTuple):
    """A measured value and its standard deviation, both finite, in the unit of its name."""

    value: float
    std: float

    @property
    def interval95(self) -> tuple[float, float]:
        """Where the truth lies in 95 of 100 cases."""
        return self.value - _NORMAL_95 * self.std, self.value + _NORMAL_95 * self.std

    def __bool__(self) -> Literal[True]:
        return True


@dataclass(frozen=True, eq=False)
class PointEstimate:
    """A measured point: `xyz_m` (3,) and the standard deviation of each coordinate (3,)."""

    xyz_m: NDArray[np.floating[Any]]
    std_m: NDArray[np.floating[Any]]


@dataclass(frozen=True)
class Failure:
    """No value, and why. Falsy."""

    reason: str

    def __bool__(self) -> Literal[False]:
        return False


@dataclass(frozen=True)
class Evidence:
    """What a measurement rests on, so that a reader can judge it.

    Attributes:
        method: the sources of the diameter that counted, such as "keypoints + mask + depth".
        source_diameters_m: the diameter that each source gives by itself.
        source_std_m: and its standard deviation.
        arc_deg: how much of the stem's round the depth shows, 180 being the half that can be seen.
        valid_depth_share: share of the places looked at inside the stem that have a reading.
        visible_share: share of the stem's length, from foot to top of its box, that the mask
            shows; None without a mask.
        ground: what heights refer to, in words.
        warnings: what a reader should know before using the numbers.
    """

    method: str = ""
    source_diameters_m: dict[str, float] = field(default_factory=dict)
    source_std_m: dict[str, float] = field(default_factory=dict)
    arc_deg: float = 0.0
    valid_depth_share: float = 0.0
    visible_share: float | None = None
    ground: str = ""
    warnings: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, JsonValue]:
        """JSON-ready."""
        return {
            "method": self.method,
            "source_diameters_m": dict(self.source_diameters_m),
            "source_std_m": dict(self.source_std_m),
            "arc_deg": self.arc_deg,
            "valid_depth_share": self.valid_depth_share,
            "visible_share": self.visible_share,
            "ground": self.ground,
            "warnings": list(self.warnings),
        }


@dataclass(frozen=True, eq=False)
class TreeMeasurement:
    """One tree in metres.

    Attributes:
        diameter_m: of the stem, across its axis, at the felling cut (on the section through the
            diameter keypoints); where the cut is below the picture, inferred from the lowest
            visible section by `MeasureSettings.butt_swell`, with a warning; of a mask without
            keypoints in the middle of what it shows.
        dbh_m: the same at breast height.
        cut_height_m: of the axis at the felling cut above the ground on the uphill side, along
            the vertical.
        inclination_deg: of the axis from the vertical; from the ground's normal, and as uncertain
            as the ground's slope, where no vertical is given.
        lean_direction_deg: where the stem leans to, seen from above: 0 away from the camera,
            90 to the right, -90 to the left, 180 towards it.
        distance_m: from the camera's centre to the axis at the felling cut; of a mask without
            keypoints to the middle of what it shows.
        cut_point_m: where the cut meets the bark that faces the camera, in the camera's frame
            (x right, y down, z forward).
        cut_point_machine_m: the same in the machine's frame.
        evidence: what all of it rests on.
    """

    diameter_m: Estimate | Failure
    dbh_m: Estimate | Failure
    cut_height_m: Estimate | Failure
    inclination_deg: Estimate | Failure
    lean_direction_deg: Estimate | Failure
    distance_m: Estimate | Failure
    cut_point_m: PointEstimate | Failure
    cut_point_machine_m: PointEstimate | Failure
    evidence: Evidence = Evidence()

    @classmethod
    def failed(cls, reason: str) -> TreeMeasurement:
        """A tree of which nothing can be measured, for one reason."""
        failure = Failure(reason)
        return cls(failure, failure, failure, failure, failure, failure, failure, failure)

    def to_dict(self) -> dict[str, JsonValue]:
        """JSON-ready: `diameter_m`, `diameter_std_m`, `diameter_low95_m` and `diameter_high95_m`,
        or `diameter_failure`; so for each quantity; points; and the evidence.
        """
        values: dict[str, JsonValue] = {}
        for quantity in QUANTITIES:
            name, unit = quantity.rsplit("_", 1)
            result: Estimate | Failure = getattr(self, quantity)
            if isinstance(result, Failure):
                values[f"{name}_failure"] = result.reason
            else:
                values[quantity] = result.value
                values[f"{name}_std_{unit}"] = result.std
                values[f"{name}_low95_{unit}"], values[f"{name}_high95_{unit}"] = result.interval95
        for name in ("cut_point", "cut_point_machine"):
            point: PointEstimate | Failure = getattr(self, f"{name}_m")
            if isinstance(point, Failure):
                values[f"{name}_failure"] = point.reason
            else:
                values[f"{name}_m"] = point.xyz_m.tolist()
                values[f"{name}_std_m"] = point.std_m.tolist()
        return {**values, "evidence": self.evidence.to_dict()}  # type: ignore[dict-item]
