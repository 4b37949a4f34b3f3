"""Scale and offset of a depth camera, as values and as a file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from basetree.arrays import Float, Float32
from basetree.files.json import json_text
from basetree.files.writing import write_text
from calib.errors import DepthError
from calib.files.text import parse_record

SCHEMA: Final = "calib.depth_scale/1"
_EXPECTED: Final = "a depth scale as JSON"
_RANGES: Final = {
    "scale": (1e-4, 1e4),
    "offset_m": (-1000.0, 1000.0),
    "scale_std": (0.0, 1e4),
    "offset_std_m": (0.0, 1000.0),
    "nearest_m": (1e-6, 1e5),
    "farthest_m": (1e-6, 1e5),
}


@dataclass(frozen=True)
class TargetResidual:
    """What the fit leaves for one target.

    Attributes:
        name: Name of the target.
        distance_m: Mean true depth in metres.
        residual_m: Mean corrected reading minus mean true depth.
        noise_std_m: Standard deviation of the readings about a line through them.
        pixels: Number of readings used.
    """

    name: str
    distance_m: float
    residual_m: float
    noise_std_m: float
    pixels: int


@dataclass(frozen=True)
class DepthScale:
    """Linear correction: true depth = `scale` x reading + `offset_m`.

    Attributes:
        scale: True metres per metre of reading.
        offset_m: Offset in metres.
        scale_std: Standard deviation of `scale`.
        offset_std_m: Standard deviation of `offset_m`.
        correlation: Correlation of the errors of scale and offset, -1 to 1.
        nearest_m: Distance of the nearest target used.
        farthest_m: Distance of the farthest target used.
        targets: Residuals of the targets used.
        dropped: Names of the targets left out as outliers or for lack of readings.

    Raises:
        DepthError: If a value is out of range or not finite.
    """

    scale: float
    offset_m: float
    scale_std: float
    offset_std_m: float
    correlation: float
    nearest_m: float
    farthest_m: float
    targets: tuple[TargetResidual, ...] = ()
    dropped: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name, (least, most) in _RANGES.items():
            value = getattr(self, name)
            if not (math.isfinite(value) and least <= value <= most):
                raise DepthError(f"{name} is {value}: expected {least:g} to {most:g}")
        if self.nearest_m > self.farthest_m:
            raise DepthError(
                f"nearest_m is {self.nearest_m} and farthest_m {self.farthest_m}: expected the"
                " nearest first"
            )
        if not -1 <= self.correlation <= 1:
            raise DepthError(f"correlation is {self.correlation}: expected -1 to 1")

    def apply(self, depth_m: Float) -> Float32:
        """Correct (...) readings in metres.

        Args:
            depth_m: (...) readings, 0 for none.

        Returns:
            (...) corrected metres; 0 where there is no reading or the result is not above 0.
        """
        depths = np.asarray(depth_m, np.float32)
        true_m = depths * np.float32(self.scale) + np.float32(self.offset_m)
        return np.where((depths > 0) & np.isfinite(depths) & (true_m > 0), true_m, 0)

    def std_m(self, depth_m: ArrayLike) -> Float:
        """Return the (...) standard deviation that the fit adds to readings of (...) metres."""
        depths = np.asarray(depth_m, np.float64)
        mixed = 2 * self.correlation * self.scale_std * self.offset_std_m
        variance = (depths * self.scale_std) ** 2 + mixed * depths + self.offset_std_m**2
        return np.asarray(np.sqrt(np.maximum(variance, 0)))

    @property
    def std_share(self) -> float:
        """Largest relative standard deviation from the nearest target on, as a share."""
        return max(float(self.std_m(self.nearest_m)) / self.nearest_m, self.scale_std)

    def to_dict(self) -> dict[str, Any]:
        """Return JSON-ready values."""
        values = asdict(self)
        return {**values, "targets": list(values["targets"]), "dropped": list(self.dropped)}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> DepthScale:
        """Create a depth scale from the values of `to_dict`.

        Raises:
            DepthError: If a field is missing or has the wrong type.
        """
        targets, dropped = values.get("targets", []), values.get("dropped", [])
        if not isinstance(targets, list) or not all(isinstance(t, Mapping) for t in targets):
            raise DepthError(f"targets is {targets!r}: expected a list of objects")
        if not isinstance(dropped, list) or not all(isinstance(name, str) for name in dropped):
            raise DepthError(f"dropped is {dropped!r}: expected a list of names")
        names = [field.name for field in fields(cls) if field.type == "float"]
        return cls(
            **{name: _number(values, name) for name in names},
            targets=tuple(_target(target) for target in targets),
            dropped=tuple(dropped),
        )


def _number(values: Mapping[str, Any], name: str) -> float:
    value = values.get(name)
    if not isinstance(value, bool) and isinstance(value, int | float):
        with suppress(OverflowError):
            if math.isfinite(float(value)):
                return float(value)
    raise DepthError(f"{name} is {value!r}: expected a finite number")


def _target(values: Mapping[str, Any]) -> TargetResidual:
    numbers = {name: _number(values, name) for name in ("distance_m", "residual_m", "noise_std_m")}
    return TargetResidual(str(values.get("name")), **numbers, pixels=int(_number(values, "pixels")))


def load_depth_scale(path: Path | str) -> DepthScale:
    """Read a depth scale.

    Raises:
        InputFileError: If the file is missing, unreadable or has another schema.
        DepthError: If a value is invalid; the message names the file.
    """
    path = Path(path)
    values = parse_record(path, SCHEMA, _EXPECTED)
    try:
        return DepthScale.from_dict(values)
    except DepthError as error:
        raise DepthError(f"{path}: {error}") from error


def save_depth_scale(path: Path | str, depth_scale: DepthScale) -> None:
    """Write a depth scale as JSON.

    Raises:
        InputFileError: If the file cannot be written.
    """
    write_text(Path(path), json_text(SCHEMA, depth_scale.to_dict()))
