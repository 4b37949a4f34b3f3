"""The diameter at the section and at the felling cut below it, with its standard deviation."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from basetree.arrays import Bool, Float
from edgetree.measure.constants.outlines import (
    GIVEN_MASK_DOUBT,
    MAX_INCOMPLETE_STD,
    SECTION_CERTAIN_M,
    SECTION_DOUBTED_M,
)
from edgetree.measure.constants.stems import MAX_RELATIVE_STD
from edgetree.measure.estimates import Estimate, Failure
from edgetree.measure.frame import DepthFrame
from edgetree.measure.keypoints import CUT, Keypoints
from edgetree.measure.observations import StemObservations
from edgetree.measure.settings import MeasureSettings
from edgetree.measure.stem_fit import Stems

SEEN_PART_WARNING = "the cut is not in the picture: the diameter is that of the part that is seen"
"""Warning where the ground is not seen at any stem of the frame."""


def diameter_stds_m(frame: DepthFrame, stems: Stems, incomplete_std: Float) -> Float:
    """(T,) standard deviations of the diameters.

    First-order error propagation through the diameter 2 d sin(delta): its relative change is
    that of the distance d, plus that of delta times cot(delta). Since d depends on delta too,
    the relative change of d per radian of delta is added to cot(delta). The rig, the
    stem's shape and incomplete observations add independent relative errors.

    Args:
        frame: Camera and settings.
        stems: T fitted stems.
        incomplete_std: (T,) see `incomplete_stds`.
    """
    half = stems.sections.half_rad
    edges = stems.half_std_rad * np.abs(1 / np.tan(half) + stems.distance_change_per_rad)
    distance = stems.relative_size_std
    rig = np.full_like(half, frame.rig.size_std)
    shape = np.full_like(half, frame.settings.out_of_round_std)
    parts = [edges, distance, rig, shape, incomplete_std]
    return np.asarray(2 * stems.radius_m * np.linalg.norm(parts, axis=0))


def incomplete_stds(frame: DepthFrame, observed: StemObservations, stems: Stems) -> Float:
    """(T,) relative standard deviations for incomplete or contradictory observations.

    See `MeasureSettings.outline_doubt` and `readings_doubt`.
    """
    settings, edges = frame.settings, observed.edges
    shown = edges.valid.mean(2).min(0)
    outline = 0.0 if observed.outline is None else settings.outline_doubt
    unread = 1 - stems.used / observed.readings.depth_m.shape[1]
    parts = (outline * (1 - shown) ** 4, settings.readings_doubt * unread**2)
    share = GIVEN_MASK_DOUBT if frame.masks_given else 1.0
    return np.asarray(np.minimum(share * np.linalg.norm(parts, axis=0), MAX_INCOMPLETE_STD))


class ButtSwell(NamedTuple):
    """How much thicker T stems are at the cut than at the section that is measured.

    Attributes:
        share: (T,) relative differences of the diameters.
        std: (T,) their standard deviations.
        inferred: (T,) whether the section is not that of the cut, but the lowest part that is seen.
        warnings: T times the warning, or nothing where the section is that of the diameter.
    """

    share: Float
    std: Float
    inferred: Bool
    warnings: list[tuple[str, ...]]

    @classmethod
    def from_keypoints(
        cls, keypoints: Keypoints, m_per_px: Float, settings: MeasureSettings
    ) -> ButtSwell:
        """What keypoints near the lower side of the image tell.

        Args:
            keypoints: Keypoints of T stems.
            m_per_px: (T,) metres per pixel at the stems.
            settings: The butt swell of stems.
        """
        unseen = ~keypoints.within[:, CUT] & keypoints.offered
        inferred = unseen & ~keypoints.has_section
        above_m = keypoints.section_above_px * m_per_px
        doubted_m = SECTION_CERTAIN_M - SECTION_DOUBTED_M
        likely = np.clip((SECTION_CERTAIN_M - above_m) / doubted_m, 0.0, 1.0)
        doubtful = unseen & keypoints.has_section & keypoints.reaches_lower_side
        likely = np.where(doubtful, likely, 0.0)
        # Either the section is where its keypoints are, or the cut is further down the butt.
        half = likely * settings.butt_swell / 2
        std = np.hypot(half, likely * settings.butt_swell_std)
        doubt = "the cut may be below the picture: its diameter is in part inferred"
        from_above = "the cut is not in the picture: its diameter is inferred from the stem above"
        texts = np.where(inferred, from_above, np.where(likely > 0, doubt, "")).tolist()
        return cls(
            np.where(inferred, settings.butt_swell, half),
            np.where(inferred, settings.butt_swell_std, std),
            inferred,
            [(text,) if text else () for text in texts],
        )

    def at_cut(self, index: int, section: Estimate) -> Estimate:
        """The diameter of one stem at the cut from that at its section."""
        growth = 1 + float(self.share[index])
        std = math.hypot(section.std * growth, section.value * float(self.std[index]))
        return Estimate(section.value * growth, std)


def if_certain(diameter: Estimate, name: str = "diameter") -> Estimate | Failure:
    """The diameter, or a failure if its relative standard deviation is too large."""
    if not diameter.std <= MAX_RELATIVE_STD * diameter.value:
        return Failure(
            f"the {name} is too uncertain: {100 * diameter.value:.1f} ± {100 * diameter.std:.1f} cm"
        )
    return diameter
