"""What the values of depth maps mean: their unit, their kind and their correction."""

from __future__ import annotations

from dataclasses import dataclass
from numbers import Real
from typing import TYPE_CHECKING, Any, Final, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from basetree.arrays import Float32
from calib.depth.conversion import range_to_depth
from calib.errors import DepthError

if TYPE_CHECKING:
    from calib.camera import PinholeCamera
    from calib.depth_scale import DepthScale

DepthKind: TypeAlias = Literal["depth", "range"]
"""Whether values are distances along the optical axis, or along the ray of each pixel."""

_DEPTH_KINDS: Final = get_args(DepthKind)
_MILLIMETRE_M: Final = 0.001
_MIN_SCALE_M, _MAX_SCALE_M = 1e-6, 1e3  # no depth is stored in smaller or larger units
_MAX_READING_M: Final = float(np.finfo(np.float32).max)
_MAX_MEDIAN_M: Final = 60.0  # as in `check_depth`
_SAMPLED_PIXELS: Final = 5_000


@dataclass(frozen=True)
class DepthConvention:
    """How the values of a source's depth maps become metres along the optical axis.

    Attributes:
        scale_m: Metres per unit, of integers and of floating point. None: integers are
            millimetres, floating point is metres.
        kind: "depth" along the optical axis, or "range" along the ray of each pixel.
        calibration: Correction of the metres along the axis; None for none.

    Raises:
        DepthError: The scale is not from 1e-6 to 1000 m, or the kind is unknown.

    Examples:
        >>> import numpy as np
        >>> from calib import DepthConvention
        >>> DepthConvention(scale_m=0.0002).metres(np.array([[5000, 0]], np.uint16), "frame 0")
        array([[1., 0.]], dtype=float32)
    """

    scale_m: float | None = None
    kind: DepthKind = "depth"
    calibration: DepthScale | None = None

    def __post_init__(self) -> None:
        check_scale(self.scale_m, "depth_scale_m")
        check_kind(self.kind, "depth_kind")

    def metres(
        self, values: NDArray[Any], name: str, camera: PinholeCamera | None = None
    ) -> Float32:
        """Convert a depth map.

        Args:
            values: (H, W) integers or floating point; 0 and what is not finite is no reading.
            name: What messages call it.
            camera: The camera of these pixels; needed for a range.

        Returns:
            (H, W) float32 metres along the optical axis, 0 for no reading.

        Raises:
            DepthError: As for `values_to_metres`, or a range has no camera.
            CameraError: The camera is for another size.
        """
        return self.corrected(values_to_metres(values, self.scale_m, name), name, camera)

    def corrected(self, metres: Float32, name: str, camera: PinholeCamera | None = None) -> Float32:
        """Apply the kind and the correction to (H, W) metres; the rest is as for `metres`."""
        if self.kind == "range":
            if camera is None:
                raise DepthError(
                    f"{name} is a range along the rays: expected the camera that turns it into"
                    " depth, with --camera or from the source"
                )
            metres = range_to_depth(metres, camera)
        return metres if self.calibration is None else self.calibration.apply(metres)


def check_scale(scale_m: Any, name: str) -> None:
    """Raise DepthError if a number of metres per unit is not from 1e-6 to 1000."""
    if scale_m is None:
        return
    is_number = isinstance(scale_m, Real) and not isinstance(scale_m, bool)
    if not (is_number and _MIN_SCALE_M <= scale_m <= _MAX_SCALE_M):
        raise DepthError(
            f"{name} is {scale_m}: expected metres per unit, {_MIN_SCALE_M:g} to {_MAX_SCALE_M:g}"
        )


def check_kind(kind: str, name: str) -> None:
    """Raise DepthError if a kind of depth is unknown."""
    if kind not in _DEPTH_KINDS:
        raise DepthError(
            f"{name} is {kind}: expected depth, which is along the optical axis, or range, which"
            " is along the ray of each pixel"
        )


def values_to_metres(values: NDArray[Any], scale_m: float | None, name: str) -> Float32:
    """Convert the values of a depth map to metres.

    Args:
        values: (H, W) or (H, W, 1) integers or floating point.
        scale_m: Metres per unit. None: integers of 16 bits and more are millimetres, floating
            point is metres.
        name: What messages call it.

    Returns:
        (H, W) float32 metres. Values that are not positive, not finite or too large become 0.

    Raises:
        DepthError: The shape or the type is another one; values of 8 bits have no scale; floating
            point without a scale cannot be in metres, as its median is above 60.
    """
    if values.ndim == 3 and values.shape[2] == 1:
        values = values[..., 0]
    kind = values.dtype.kind
    if values.ndim != 2 or values.size == 0 or kind not in "iuf":
        is_colour = values.ndim == 3 and values.dtype == np.uint8
        raise DepthError(
            f"{name} has shape {values.shape} of {values.dtype}: expected (H, W) of integers in"
            " steps of a scale, by default 0.001 m, or of floating point in metres"
            + ("; are picture and depth swapped?" if is_colour else "")
        )
    if kind == "f":
        return _float_metres(values, scale_m, name)
    if scale_m is None and values.dtype.itemsize == 1:
        raise DepthError(
            f"{name} holds integers of 8 bits, whose unit cannot be told: expected 16 bits, or"
            " metres per unit with --depth-scale (in Python depth_scale_m)"
        )
    metres = in_metres(values, _MILLIMETRE_M if scale_m is None else scale_m)
    return metres if kind == "u" else np.maximum(metres, np.float32(0))


def in_metres(steps: NDArray[Any], scale_m: float) -> Float32:
    """Convert integer steps to metres.

    If 1 / scale_m is a whole number, divide by it: the result is then the float32 nearest to the
    exact value.
    """
    per_m = 1 / scale_m
    if abs(per_m - round(per_m)) < 1e-6 * per_m:
        return np.asarray(np.divide(steps, np.float32(round(per_m)), dtype=np.float32))
    return np.asarray(np.multiply(steps, np.float32(scale_m), dtype=np.float32))


def _float_metres(values: NDArray[Any], scale_m: float | None, name: str) -> Float32:
    """Metres of floating-point depth."""
    with np.errstate(invalid="ignore", over="ignore"):
        metres = values
        if scale_m is not None and scale_m != 1.0:
            metres = values.astype(np.promote_types(values.dtype, np.float32)) * scale_m
        usable = (metres > 0) & (metres <= _MAX_READING_M)
        metres = np.where(usable, metres, 0).astype(np.float32)
    if scale_m is None:
        refuse_millimetres(metres, name)
    return metres


def refuse_millimetres(metres: NDArray[np.floating[Any]], name: str) -> None:
    """Raise DepthError if floating-point depth looks like millimetres.

    Args:
        metres: Depth that is said to be in metres; 0, NaN and infinity are no reading.
        name: What messages call it.
    """
    sampled = metres.ravel()[:: max(1, metres.size // _SAMPLED_PIXELS)]
    readings = sampled[(sampled > 0) & np.isfinite(sampled)]
    median = float(np.median(readings)) if readings.size else 0.0
    if median > _MAX_MEDIAN_M:
        raise DepthError(
            f"{name} is floating point with a median of {median:g}: expected metres; this looks"
            " like millimetres: divide by 1000, or give the unit with --depth-scale 0.001 (in"
            " Python scale=0.001 of read_depth or depth_scale_m=0.001 of a Rig; 1 for metres)"
        )
