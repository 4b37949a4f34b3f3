"""The diameter at the felling cut, where the section that is measured lies above it."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from edgetree.measure.estimates import Estimate
from edgetree.measure.keypoints import CUT, Keypoints
from edgetree.measure.settings import MeasureSettings

__all__ = ["ButtSwell"]

Float = NDArray[np.floating[Any]]

# Of a stem that the lower side of the image cuts off, networks predict the keypoints of the
# diameter's section near that side. The section is as likely below the image as not if they are up
# to the first distance above it, and never from the second on, in metres. Chosen on 673 frames.
_BELOW_M, _WITHIN_M = 0.05, 0.3


class ButtSwell(NamedTuple):
    """How much thicker T stems are at the cut than at the section that is measured.

    Attributes:
        share: (T,) relative differences of the diameters.
        std: (T,) their standard deviations.
        warnings: T times the warning, or nothing where the section is that of the diameter.
    """

    share: Float
    std: Float
    warnings: list[tuple[str, ...]]

    @classmethod
    def of(
        cls, keypoints: Keypoints, image_height: int, m_per_px: Float, settings: MeasureSettings
    ) -> ButtSwell:
        """What keypoints near the lower side of the image tell.

        Args:
            keypoints: keypoints of T stems.
            image_height: height of the image in pixels.
            m_per_px: (T,) metres per pixel at the stems.
            settings: the butt swell of stems.
        """
        unseen = ~keypoints.within[:, CUT] & keypoints.offered
        inferred = unseen & ~keypoints.has_section
        above_m = keypoints.section_above_px(image_height) * m_per_px
        likely = np.clip((_WITHIN_M - above_m) / (_WITHIN_M - _BELOW_M), 0.0, 1.0)
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
            [(text,) if text else () for text in texts],
        )

    def at_cut(self, index: int, section: Estimate) -> Estimate:
        """The diameter of one stem at the cut from that at its section."""
        growth = 1 + float(self.share[index])
        std = math.hypot(section.std * growth, section.value * float(self.std[index]))
        return Estimate(section.value * growth, std)
