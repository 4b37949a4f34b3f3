"""The result of a frame as one short line, for people at a terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from basetree.counts import counted
from edgetree.frames.pipeline import FrameResult
from edgetree.measure import Estimate
from edgetree.results.units import AMOUNTS

if TYPE_CHECKING:
    from edgetree.live.results import LiveResult


def frame_line(result: FrameResult) -> str:
    """The frame's name, its trees, and their diameters at the felling cut.

    Such as "sample_0: 4 trees, diameters 15 to 32 cm".
    """
    text = f"{result.frame.name}: {counted(len(result.trees), 'tree')}"
    if result.measurements is None or not len(result.trees):
        return text
    diameters = [
        tree.diameter_m for tree in result.measurements if isinstance(tree.diameter_m, Estimate)
    ]
    if not diameters:
        return f"{text}, no diameter"
    if len(diameters) < len(result.trees):
        text = f"{text}, {len(diameters)} measured"
    if len(diameters) == 1:
        return f"{text}, diameter {AMOUNTS['diameter_m'].with_std(diameters[0])}"
    values_cm = [100 * diameter.value for diameter in diameters]
    return f"{text}, diameters {min(values_cm):.0f} to {max(values_cm):.0f} cm"


def live_line(result: LiveResult) -> str:
    """As `frame_line`, with the number of stems that are followed."""
    in_picture = sum(number is not None for number in result.found.tracks or ())
    return f"{frame_line(result)}, {counted(len(result.tracks) or in_picture, 'stem')} followed"
