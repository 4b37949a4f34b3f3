"""Whether a depth scale can be that of a depth camera, or comes from a mistake."""

from __future__ import annotations

from typing import Final

MOST_SCALE_SHARE: Final = 0.05
"""Deviation of the scale from 1 up to which it is written.

Source: chosen, 2.5 times what the maker of the OAK cameras states for depth below 4 m (Luxonis,
Depth accuracy: 2 %)."""
TOLD_SCALE_SHARE: Final = 0.02
"""Deviation of the scale from 1 from which a line tells about it.

Source: published, the same page."""
_UNITS_MM: Final = (1000.0, 304.8, 100.0, 25.4, 10.0, 0.25, 0.125, 0.1, 0.01, 0.001)
_STDS: Final = 2.0


def tell_scale(
    scale: float, scale_std: float, side_m: float | None = None
) -> tuple[str | None, str | None]:
    """Judge a scale between a board's size and a depth camera's metres.

    Both are metres, so that the scale of a sound camera is 1 within some percent.

    Args:
        scale: True metres per metre of reading.
        scale_std: Its standard deviation.
        side_m: Side of a square or tag, or spacing, that was given for the board.

    Returns:
        Why the scale is refused, or None; and what to look at if it is kept, or None.
    """
    off, doubt = abs(scale - 1), _STDS * scale_std
    sizes = (
        f"sides of {1000 * side_m / scale:.4g} mm instead of the {1000 * side_m:.4g} mm given"
        if side_m
        else f"sides of {1 / scale:.4g} times those given"
    )
    if off > MOST_SCALE_SHARE + min(doubt, MOST_SCALE_SHARE):
        nearest_mm = min(_UNITS_MM, key=lambda unit: abs(scale / unit - 1))
        fits = abs(scale / nearest_mm - 1) < MOST_SCALE_SHARE
        unit = f"units of {nearest_mm:g} mm" if fits else f"another unit ({scale:.4g} times)"
        return (
            f"the depth would have a scale of {scale:.3f}, and those of depth cameras are within"
            f" {MOST_SCALE_SHARE:.0%} of 1: the board has {sizes} (measure it, correct --board), or"
            f" the depth is in {unit} rather than in millimetres or metres (convert it)"
        ), None
    if off > TOLD_SCALE_SHARE:
        return None, (
            f"a depth scale of {scale:.3f} is more than makers state ({TOLD_SCALE_SHARE:.0%}):"
            f" measure the board, {sizes} would explain it"
        )
    if doubt > MOST_SCALE_SHARE:
        return None, (
            f"the depth scale is only known within {doubt:.0%}, so that it does not show whether"
            " the board's size is right: hold the board at more distances"
        )
    return None, None
