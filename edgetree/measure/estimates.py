"""What a measurement is: a value with its standard deviation, or a failure with its reason."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

__all__ = ["Estimate", "Failure", "TreeMeasurement"]

JsonValue: TypeAlias = float | str | list[float]


class Estimate(NamedTuple):
    """A measured value and its standard deviation, both finite, in the unit of its name."""

    value: float
    std: float

    def __bool__(self) -> Literal[True]:
        return True


@dataclass(frozen=True)
class Failure:
    """No value, and why. Falsy."""

    reason: str

    def __bool__(self) -> Literal[False]:
        return False


@dataclass(frozen=True, eq=False)
class TreeMeasurement:
    """One tree in metres.

    Attributes:
        diameter_m: of the stem, across its axis, at the diameter keypoints.
        cut_height_m: of the axis at the felling cut above the ground on the uphill side, along
            the vertical.
        inclination_deg: of the axis from the vertical.
        distance_m: from the camera's centre to the axis at the felling cut.
        cut_point_m: (3,) float64 where the cut meets the bark that faces the camera, in the
            camera's frame (x right, y down, z forward).
    """

    diameter_m: Estimate | Failure
    cut_height_m: Estimate | Failure
    inclination_deg: Estimate | Failure
    distance_m: Estimate | Failure
    cut_point_m: NDArray[np.floating[Any]] | Failure

    @classmethod
    def failed(cls, reason: str) -> TreeMeasurement:
        """A tree of which nothing can be measured, for one reason."""
        failure = Failure(reason)
        return cls(failure, failure, failure, failure, failure)

    def to_dict(self) -> dict[str, JsonValue]:
        """Flat and JSON-ready: `diameter_m` and `diameter_std_m`, or `diameter_failure`."""
        values: dict[str, JsonValue] = {}
        for quantity in ("diameter_m", "cut_height_m", "inclination_deg", "distance_m"):
            name, unit = quantity.rsplit("_", 1)
            result: Estimate | Failure = getattr(self, quantity)
            if isinstance(result, Failure):
                values[f"{name}_failure"] = result.reason
            else:
                values[quantity] = result.value
                values[f"{name}_std_{unit}"] = result.std
        if isinstance(self.cut_point_m, Failure):
            values["cut_point_failure"] = self.cut_point_m.reason
        else:
            values["cut_point_m"] = self.cut_point_m.tolist()
        return values
