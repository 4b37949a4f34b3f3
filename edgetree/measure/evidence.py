"""What a measurement is based on: sources, visible parts and warnings."""

from __future__ import annotations

import math

from edgetree.measure.base_ground import BaseGround
from edgetree.measure.constants.outlines import MAX_DISAGREEMENT_STDS
from edgetree.measure.estimates import Estimate, Evidence, Failure
from edgetree.measure.even_cover import hidden_std_m
from edgetree.measure.observations import StemObservations
from edgetree.measure.stem_fit import Stems

FELLING_CUT, LOWEST_SEEN = "felling cut", "lowest seen part of the stem"
"""Places at which the distance is taken."""

_SOURCES = ("keypoints", "mask", "depth")
# A source is named in `Evidence.method` from this weight on.
_MIN_WEIGHT = 0.02


def gather_evidence(
    index: int,
    stems: Stems,
    observed: StemObservations,
    ground: BaseGround | Failure,
    place: str,
    warnings: tuple[str, ...],
) -> Evidence:
    """Describe what the measurement of one stem is based on.

    Args:
        index: Number of the stem.
        stems: The fitted stems.
        observed: The observations that they are fitted to.
        ground: Ground at the stem.
        place: Where the distance is taken.
        warnings: Warnings about other values of the stem, which come first.
    """
    distance_m = stems.distance_m.item(index)
    known = {
        name: (half.rad.item(index), half.std_rad.item(index))
        for name, half in zip(_SOURCES, stems.sources, strict=True)
        if math.isfinite(half.std_rad.item(index))
    }
    diameters = {name: 2 * distance_m * math.sin(rad) for name, (rad, _) in known.items()}
    stds = {name: 2 * distance_m * math.cos(rad) * std for name, (rad, std) in known.items()}
    weights = zip(_SOURCES, stems.weights[:, index].tolist(), strict=True)
    outline = observed.outline
    return Evidence(
        method=" + ".join(name for name, weight in weights if weight > _MIN_WEIGHT),
        source_diameters_m=diameters,
        source_std_m=stds,
        arc_deg=math.degrees(stems.arc_rad.item(index)),
        valid_depth_share=observed.valid_depth_fraction.item(index),
        visible_share=None if outline is None else outline.visible_fraction.item(index),
        ground=ground.description() if isinstance(ground, BaseGround) else ground.reason,
        warnings=warnings
        + _disagreement(diameters, stds)
        + _straight_part(observed, index)
        + _second_stem(observed, index)
        + _depth_warnings(observed, index),
        distance_at=place,
    )


def distance_place(has_cut: bool, offers_keypoints: bool) -> str:
    """Where `TreeMeasurement.distance_m` is taken; empty if it is not known."""
    if has_cut:
        return FELLING_CUT
    return "" if offers_keypoints else LOWEST_SEEN


def stump_warning(
    height: Estimate | Failure,
    above_surface: Estimate | Failure,
    ground: BaseGround | Failure,
    limit_m: float,
) -> tuple[str, ...]:
    """A warning if the stump would be too high, or may be because plants or snow hide the ground.

    Args:
        height: Height of the cut.
        above_surface: The same above the surface around the base, which may be that of plants.
        ground: Ground at the stem.
        limit_m: Largest height of a stump in metres.
    """
    if not isinstance(above_surface, Estimate):
        return ()
    if not isinstance(height, Estimate):
        return (f"plants hide the ground: the stump may be too high, limit {100 * limit_m:.0f} cm",)
    stump = f"{_cm(height)} high, limit {100 * limit_m:.0f} cm"
    if height.value - height.std > limit_m:
        return (f"the stump would be {stump}",)
    hidden = isinstance(ground, BaseGround) and ground.overgrown
    if hidden and height.interval95[1] > limit_m:
        return (f"plants hide the ground: the stump may be too high, {stump}",)
    stated = isinstance(ground, BaseGround) and ground.stated_cover.value > 0
    if not stated and hidden_std_m(height.value) > max(above_surface.std, height.value / 2):
        low = f"the felling cut is only {_cm(height)} above the surface"
        stating = "if so, --ground-cover states their height"
        return (f"plants or snow with an even top may hide the ground: {low}; {stating}",)
    return ()


def _cm(height: Estimate) -> str:
    return f"{100 * height.value:.0f} ± {100 * height.std:.0f} cm"


def _disagreement(diameters: dict[str, float], stds: dict[str, float]) -> tuple[str, ...]:
    """A warning if keypoints and mask tell different diameters."""
    if not {"keypoints", "mask"} <= diameters.keys():
        return ()
    keypoints_m, mask_m = diameters["keypoints"], diameters["mask"]
    std_m = math.hypot(stds["keypoints"], stds["mask"])
    if abs(keypoints_m - mask_m) <= MAX_DISAGREEMENT_STDS * std_m:
        return ()
    return (f"keypoints and mask disagree: {100 * keypoints_m:.1f} cm and {100 * mask_m:.1f} cm",)


def _second_stem(observed: StemObservations, index: int) -> tuple[str, ...]:
    """A warning if a second stem was cut out of the mask."""
    if observed.second is None or not observed.second.cut[index]:
        return ()
    return (
        "the mask shows more than one stem: the nearer one, or that below a fork, is measured by"
        " its own edges",
    )


def _straight_part(observed: StemObservations, index: int) -> tuple[str, ...]:
    """A warning if only a part of the mask is measured."""
    if observed.straight is None or not observed.straight.cut[index]:
        return ()
    return (
        "the mask shows more than the stem, as ground, plants or roots: the part in which both"
        " edges are straight is measured",
    )


def _depth_warnings(observed: StemObservations, index: int) -> tuple[str, ...]:
    """Warnings about depth that is doubtful, smoothed, or beside the picture."""
    warnings = _doubtful_depth(observed, index)
    outline = observed.outline
    if outline is None:
        return warnings
    if outline.depth_ramp_px > 0:
        warnings += (
            f"the depth is smoothed over {outline.depth_ramp_px:.0f} px at the edges of stems: turn"
            " off the camera's smoothing, hole filling and averaging over frames",
        )
    shift_px = float(outline.depth_shift_px[index])
    if shift_px:
        side = "right" if shift_px > 0 else "left"
        warnings += (
            f"the depth lies {abs(shift_px):.0f} px to the {side} of the picture: check that both"
            " are aligned and of the same moment",
        )
    return warnings


def _doubtful_depth(observed: StemObservations, index: int) -> tuple[str, ...]:
    """A warning if the depth within the outline is no other than that beside it."""
    if not observed.doubtful_depth[index]:
        return ()
    return (
        "the depth on the stem goes on beside it: it may be of brush or netting in front of the"
        " stem",
    )
