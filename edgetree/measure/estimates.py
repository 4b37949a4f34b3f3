"""Results of a measurement: values with standard deviations, or failures with reasons."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final, Literal, NamedTuple, TypeAlias

from basetree.arrays import Float
from basetree.counts import counted
from basetree.errors import InputError
from basetree.normal import NORMAL_975
from edgetree.measure.profile import StemProfile

JsonValue: TypeAlias = (
    float
    | str
    | bool
    | list[float]
    | list[str]
    | dict[str, float]
    | dict[str, str | list[float]]
    | None
)

QUANTITIES: Final = (
    "diameter_m",
    "dbh_m",
    "cut_height_m",
    "inclination_deg",
    "lean_direction_deg",
    "distance_m",
    "axis_distance_m",
    "taper_cm_per_m",
    "seen_volume_m3",
    "volume_m3",
)
"""The scalar quantities of a `TreeMeasurement`, in the order of its records."""

_SIGNED: Final = frozenset(("lean_direction_deg", "taper_cm_per_m"))

_UNITS: Final = ("cm_per_m", "m3", "deg", "m")


def split_unit(quantity: str) -> tuple[str, str]:
    """Split one of `QUANTITIES` into its name and its unit, such as "taper" and "cm_per_m"."""
    unit = next(unit for unit in _UNITS if quantity.endswith(f"_{unit}"))
    return quantity.removesuffix(f"_{unit}"), unit


def _half_width(level: float) -> float:
    """Half the width of the interval of a level, in standard deviations."""
    if not 0 < level < 1:
        raise InputError(f"the level is {level}: expected a number between 0 and 1, such as 0.95")
    return NORMAL_975 * _tangent(level) / _tangent(0.95)


def _tangent(level: float) -> float:
    """Quantile of Student's t with 3 degrees of freedom for (1 + level) / 2, over sqrt(3).

    With the quantile sqrt(3) tan(a), the distribution is 1/2 + (a + sin(a) cos(a)) / pi.
    """
    low, high = 0.0, math.pi / 2
    while low < (middle := (low + high) / 2) < high:
        if middle + math.sin(middle) * math.cos(middle) < level * math.pi / 2:
            low = middle
        else:
            high = middle
    return math.tan(low)


class Estimate(NamedTuple):
    """A measured value and its standard deviation, both finite and in the quantity's unit.

    Always true, even if the value is 0.

    Examples:
        >>> from edgetree.measure import Estimate, Failure
        >>> diameter_m = Estimate(0.314, 0.008)
        >>> [round(end, 3) for end in diameter_m.interval95]
        [0.298, 0.33]
        >>> bool(Failure("no depth on the stem"))
        False
    """

    value: float
    std: float

    @property
    def interval95(self) -> tuple[float, float]:
        """Lower and upper end of the 95 % confidence interval: 1.96 standard deviations."""
        return self.value - NORMAL_975 * self.std, self.value + NORMAL_975 * self.std

    def interval(self, level: float) -> tuple[float, float]:
        """Lower and upper end of the confidence interval of a level.

        Errors are taken to follow Student's t distribution with 3 degrees of freedom, scaled so
        that its 95 % interval is that of a normal error, `interval95`: most are smaller than normal
        errors of the standard deviation `std`, and a few are much larger, because what is doubtful
        is right as a rule.

        Args:
            level: Probability of the interval, between 0 and 1, such as 0.9.

        Raises:
            InputError: The level is not between 0 and 1.
        """
        half = self.std * _half_width(level)
        return self.value - half, self.value + half


@dataclass(frozen=True, eq=False)
class PointEstimate:
    """A measured point.

    Attributes:
        xyz_m: (3,) coordinates in metres.
        std_m: (3,) standard deviation of each coordinate in metres.
    """

    xyz_m: Float
    std_m: Float


@dataclass(frozen=True, eq=False, kw_only=True)
class StemAxis:
    """The line of a stem's axis in camera coordinates (x right, y down, z forward).

    Attributes:
        point_m: (3,) axis point at the felling cut; if the cut is not known, axis point of the
            section at which the diameter is measured.
        point_covariance_m2: (3, 3) covariance of its error.
        direction: (3,) unit vector up the axis.
        direction_covariance: (3, 3) covariance of its error, rad².
    """

    point_m: Float
    point_covariance_m2: Float
    direction: Float
    direction_covariance: Float


@dataclass(frozen=True)
class Failure:
    """The reason why a quantity could not be measured. Always false.

    Attributes:
        reason: One line of text.
    """

    reason: str

    def __bool__(self) -> Literal[False]:
        return False


def interval_keys(quantity: str) -> tuple[str, ...]:
    """The keys of a quantity: its value, its `std`, `low95`, `high95`, and its `failure`."""
    name, unit = split_unit(quantity)
    spread = (f"{name}_{what}_{unit}" for what in ("std", "low95", "high95"))
    return (quantity, *spread, f"{name}_failure")


def interval_values(quantity: str, result: Estimate | Failure) -> dict[str, float | str]:
    """A value with its standard deviation and 95 % interval by `interval_keys`, or the reason.

    The lower end is cut at 0, except for lean directions and tapers, which have a sign. It is never
    above the value: a cut may be measured a little below the ground.
    """
    *numbers, failure = interval_keys(quantity)
    if isinstance(result, Failure):
        return {failure: result.reason}
    low, high = result.interval95
    low = low if quantity in _SIGNED else max(low, min(result.value, 0.0))
    return dict(zip(numbers, (*result, low, high), strict=True))


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """What a measurement is based on, for judging its quality.

    Attributes:
        method: Sources with a weight in the diameter, such as "keypoints + mask + depth".
        distance_from: What the distance comes from: "depth", or without it the way, the relative
            error of sizes, and what most of it comes from; empty without either.
        source_diameters_m: Diameter in metres that each source gives by itself.
        source_std_m: Standard deviation of each of these in metres.
        arc_deg: Arc of the stem's circumference with depth readings, in degrees; at most 180 is
            visible.
        valid_depth_share: Fraction of the depth samples on the stem that have a reading.
        visible_share: Fraction of the stem's length, from the bottom to the top of its box, that
            the mask shows; None without a mask.
        ground: Reference of the heights, as text.
        distance_at: Where `TreeMeasurement.distance_m` is taken: "felling cut", or without
            keypoints "lowest seen part of the stem"; empty if there is no such distance.
        warnings: Problems to know about before using the values.
    """

    method: str = ""
    distance_from: str = "depth"
    source_diameters_m: dict[str, float] = field(default_factory=dict)
    source_std_m: dict[str, float] = field(default_factory=dict)
    arc_deg: float = 0.0
    valid_depth_share: float = 0.0
    visible_share: float | None = None
    ground: str = ""
    distance_at: str = ""
    warnings: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, JsonValue]:
        """The attributes as a JSON-ready dictionary."""
        return {
            "method": self.method,
            "distance_from": self.distance_from,
            "source_diameters_m": dict(self.source_diameters_m),
            "source_std_m": dict(self.source_std_m),
            "arc_deg": self.arc_deg,
            "valid_depth_share": self.valid_depth_share,
            "visible_share": self.visible_share,
            "ground": self.ground,
            "distance_at": self.distance_at,
            "warnings": list(self.warnings),
        }


@dataclass(frozen=True, eq=False, kw_only=True)
class TreeMeasurement:
    """The measurements of one tree.

    Attributes:
        diameter_m: Stem diameter at right angles to the axis, at the section through the diameter
            keypoints near the felling cut. If the cut is below the image, it is inferred from the
            lowest visible section with `MeasureSettings.butt_swell`, with a warning. Without
            keypoints, it is measured in the middle of the visible part of the mask.
        dbh_m: Stem diameter at breast height.
        cut_height_m: Height of the axis at the felling cut above the ground on the uphill side,
            along the vertical.
        inclination_deg: Angle of the axis from the vertical. If no vertical is given, it is
            estimated from the other stems, the ground and the camera, and its error is included.
        lean_direction_deg: Direction of the lean, seen from above: 0 away from the camera, 90 to
            the right, -90 to the left, 180 towards the camera. Without a given vertical it needs
            three other stems.
        distance_m: Distance from the camera's centre to the axis at the felling cut; without
            keypoints, at the lowest part of the stem that the mask shows (`Evidence.distance_at`).
        axis_distance_m: Shortest distance from the camera's centre to the line of the stem's axis.
            For an upright stem it is the horizontal distance. It needs neither the felling cut nor
            the ground.
        taper_cm_per_m: Mean decrease of the diameter, in cm per metre of the stem, between the
            lowest and the highest diameter of `profile`; by the outline alone, also of clouds.
        seen_volume_m3: Volume over bark of the part of the stem between the lowest and the highest
            diameter of `profile`, likewise. Between two diameters it is a truncated cone.
        volume_m3: Volume over bark of the whole stem, from `dbh_m` by the volume function of
            `MeasureSettings.species`, see `stem_volume`.
        profile: Diameters at every 10 cm along the stem.
        species: Species of the volume function, if one was given.
        cut_point_m: Point of the cut on the bark that faces the camera, in camera coordinates
            (x right, y down, z forward).
        cut_point_machine_m: The same point in machine coordinates.
        axis: Line of the axis in camera coordinates. It is not part of `to_dict`.
        section_m: Diameter at `axis.point_m`. `diameter_m` is larger where the cut is inferred from
            it, and of another part where this is a failure. It is not part of `to_dict`.
        evidence: What the measurement is based on.
        rig_std: Part of the standard deviations of `diameter_m`, `dbh_m`, `cut_height_m` and
            `inclination_deg` that comes from the rig. It is the same error in all frames and does
            not average away. It is not part of `to_dict`.
    """

    diameter_m: Estimate | Failure
    dbh_m: Estimate | Failure
    cut_height_m: Estimate | Failure
    inclination_deg: Estimate | Failure
    lean_direction_deg: Estimate | Failure
    distance_m: Estimate | Failure
    axis_distance_m: Estimate | Failure
    taper_cm_per_m: Estimate | Failure
    seen_volume_m3: Estimate | Failure
    volume_m3: Estimate | Failure
    profile: StemProfile | Failure
    species: str | None = None
    cut_point_m: PointEstimate | Failure
    cut_point_machine_m: PointEstimate | Failure
    axis: StemAxis | Failure = Failure("the axis is not measured")
    section_m: Estimate | Failure = Failure("the section is not measured")
    evidence: Evidence = Evidence()
    rig_std: dict[str, float] = field(default_factory=dict)

    def __repr__(self) -> str:
        named = ("diameter", self.diameter_m), ("DBH", self.dbh_m), ("distance", self.distance_m)
        words = [
            f"{name} {found.value:.3f} ± {found.std:.3f} m" if found else f"no {name}"
            for name, found in named
        ]
        warnings = len(self.evidence.warnings)
        told = f", {counted(warnings, 'warning')}" if warnings else ""
        return f"<TreeMeasurement: {', '.join(words)}{told}>"

    @classmethod
    def failed(cls, reason: str) -> TreeMeasurement:
        """A tree of which nothing can be measured, all for the same reason."""
        failure = Failure(reason)
        return cls(
            diameter_m=failure,
            dbh_m=failure,
            cut_height_m=failure,
            inclination_deg=failure,
            lean_direction_deg=failure,
            distance_m=failure,
            axis_distance_m=failure,
            taper_cm_per_m=failure,
            seen_volume_m3=failure,
            volume_m3=failure,
            profile=failure,
            cut_point_m=failure,
            cut_point_machine_m=failure,
            axis=failure,
            section_m=failure,
        )

    def to_dict(self) -> dict[str, JsonValue]:
        """A JSON-ready dictionary.

        Each quantity gives four entries such as `diameter_m`, `diameter_std_m`,
        `diameter_low95_m` and `diameter_high95_m`, or one such as `diameter_failure`. The species,
        the profile, the points and the evidence follow.
        """
        values: dict[str, JsonValue] = {}
        for quantity in QUANTITIES:
            values |= interval_values(quantity, getattr(self, quantity))
        values["species"] = self.species
        if isinstance(self.profile, Failure):
            values["profile_failure"] = self.profile.reason
        else:
            values["profile"] = self.profile.to_dict()
        for name in ("cut_point", "cut_point_machine"):
            point: PointEstimate | Failure = getattr(self, f"{name}_m")
            if isinstance(point, Failure):
                values[f"{name}_failure"] = point.reason
            else:
                values[f"{name}_m"] = point.xyz_m.tolist()
                values[f"{name}_std_m"] = point.std_m.tolist()
        return {**values, "evidence": self.evidence.to_dict()}  # type: ignore[dict-item]
