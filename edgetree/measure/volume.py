"""Volume of whole stems by published functions of the diameter at breast height."""

from __future__ import annotations

import math
from typing import Final, Literal, NamedTuple, TypeAlias, get_args

from basetree.errors import InputError
from edgetree.measure.estimates import Estimate, Failure

Species: TypeAlias = Literal["pine", "spruce", "birch"]

SPECIES: Final[tuple[Species, ...]] = get_args(Species)
"""Species groups with a volume function."""

EXPECTED_SPECIES: Final = f"{', '.join(SPECIES[:-1])} or {SPECIES[-1]}"
"""The species in words, for messages."""

VOLUME_SOURCE: Final = "Laasasenaho 1982"


class _VolumeFunction(NamedTuple):
    """Coefficients and standard errors of Laasasenaho (1982), functions 61.2 and 61.3.

    Attributes:
        by_diameter: a, b, c of ln V = a + b ln(2 + 1.25 d) + c d.
        by_height: a, b, c, e, f of ln V = a + b ln d + c ln h + e ln(h - 1.3) + f d.
        diameter_std: Relative standard error of the volume by diameter alone.
        height_std: Relative standard error of the volume by diameter and height.
        largest_cm: Largest diameter that the functions were fitted to.
    """

    by_diameter: tuple[float, float, float]
    by_height: tuple[float, float, float, float, float]
    diameter_std: float
    height_std: float
    largest_cm: float


# Coefficients as in the program of the Finnish Forest Research Institute of 1984 (subroutines CV1K
# and CV2K, published with Lappi's J software). Some reviews print pine's c as -0.039884, which
# contradicts function 61.3 and the published data: 865 dm³ at 40 cm in place of 1187 dm³.
# Standard errors: Laasasenaho (1982), page 42, as quoted in the documentation of the R package
# forester. Largest diameters: Kangas et al. (2020), Silva Fennica 54(4), 10269, table 1.
_FUNCTIONS: Final[dict[Species, _VolumeFunction]] = {
    "pine": _VolumeFunction(
        (-5.39417, 3.48060, -0.0319884),
        (-3.32176, 2.01395, 2.07025, -1.07209, -0.0032473),
        0.172,
        0.0710,
        50.6,
    ),
    "spruce": _VolumeFunction(
        (-5.39934, 3.46468, -0.0273199),
        (-3.77543, 1.91505, 2.82541, -1.53547, -0.0085726),
        0.187,
        0.0747,
        61.9,
    ),
    "birch": _VolumeFunction(
        (-5.41948, 3.57630, -0.0395855),
        (-4.49213, 2.10253, 3.98519, -2.65900, -0.014097),
        0.188,
        0.0823,
        49.7,
    ),
}
_MIN_DIAMETER_CM: Final = 1.5
# Below this height in m, the functions of diameter and height give too large volumes.
_MIN_HEIGHT_M: Final = 4.0


def volume_by_dbh(species: Species | None, dbh: Estimate | Failure) -> Estimate | Failure:
    """Volume of the whole stem by its diameter at breast height, or why there is none."""
    if species is None:
        return Failure("no species given")
    return dbh if isinstance(dbh, Failure) else stem_volume(species, dbh)


def stem_volume(
    species: Species, dbh_m: Estimate, height_m: Estimate | None = None
) -> Estimate | Failure:
    """Volume of a whole stem over bark, by the Finnish volume functions.

    Laasasenaho, J. 1982. Taper curve and volume functions for pine, spruce and birch.
    Communicationes Instituti Forestalis Fenniae 108. The functions were fitted to trees in
    Finland. Elsewhere, and in stands of unusual form, their own error is larger than stated.

    The standard deviation combines the standard error of the function (17 to 19 % with the
    diameter alone, 7 to 8 % with the height) with those of diameter and height, by first-order
    error propagation.

    Args:
        species: "pine" (Pinus sylvestris), "spruce" (Picea abies) or "birch" (Betula).
        dbh_m: Diameter at breast height over bark.
        height_m: Height of the tree, if known.

    Returns:
        The volume in m³, or why there is none: a diameter or height outside the function's range.

    Raises:
        InputError: It is another species.
    """
    if species not in _FUNCTIONS:
        raise InputError(f"species is {species!r}: expected one of {', '.join(_FUNCTIONS)}")
    function, d = _FUNCTIONS[species], 100 * dbh_m.value
    if not _MIN_DIAMETER_CM <= d <= function.largest_cm:
        return Failure(
            f"the volume function for {species} does not hold at a DBH of {d:.1f} cm, only from"
            f" {_MIN_DIAMETER_CM:g} to {function.largest_cm:g} cm"
        )
    height_part = 0.0
    if height_m is None:
        constant, growth, bend = function.by_diameter
        log_dm3 = constant + growth * math.log(2 + 1.25 * d) + bend * d
        per_cm = 1.25 * growth / (2 + 1.25 * d) + bend
        function_std = function.diameter_std
    else:
        h = height_m.value
        if not h >= _MIN_HEIGHT_M:
            return Failure(
                f"the volume function for {species} does not hold at a height of {h:.1f} m, only"
                f" from {_MIN_HEIGHT_M:g} m"
            )
        constant, growth, rise, fall, bend = function.by_height
        log_dm3 = constant + growth * math.log(d) + bend * d
        log_dm3 += rise * math.log(h) + fall * math.log(h - 1.3)
        per_cm = growth / d + bend
        height_part = (rise / h + fall / (h - 1.3)) * height_m.std
        function_std = function.height_std
    value = math.exp(log_dm3) / 1000
    return Estimate(value, value * math.hypot(function_std, per_cm * 100 * dbh_m.std, height_part))
