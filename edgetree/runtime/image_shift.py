"""Tell whether a picture looks unlike those that the model was trained on, and what helps."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final, NamedTuple

from edgetree.catalogue import other_model
from edgetree.detections import UnlikeTraining
from edgetree.model_file.manifest import UsualRange

_MARGIN: Final = 0.5
"""How far beyond its usual range a statistic may lie, as a share of the range's width."""
_LOW_SCORE: Final = 0.05
"""A score threshold that is not worth lowering."""
_GUIDE: Final = "docs/guides/fine-tune.md"


class _Statistic(NamedTuple):
    """What a statistic is called, its unit, and how its values are compared.

    Attributes:
        words: What it is.
        unit: Its unit.
        least_width: The width that a range is given at least, on the scale of the comparison.
        offset: If given, the scale is the logarithm of the value plus this, so that halves count
            as much as doubles.
    """

    words: str
    unit: str
    least_width: float
    offset: float | None = None

    def scaled(self, value: float) -> float:
        """A value on the scale of the comparison."""
        return value if self.offset is None else math.log(max(value, 0.0) + self.offset)


_STATISTICS: Final = {
    "lightness": _Statistic("mean lightness", "grey levels", 30.0),
    "contrast": _Statistic("contrast", "grey levels", 0.7, 2.0),
    "saturation": _Statistic("colourfulness", "grey levels", 0.7, 10.0),
    "green_red": _Statistic("green minus red", "grey levels", 80.0),
    "blue_yellow": _Statistic("blue minus yellow", "grey levels", 80.0),
    "top_bottom": _Statistic("lightness of the upper third minus the lower", "grey levels", 40.0),
    "blown_percent": _Statistic("share of blown-out pixels", "%", 40.0),
    "black_percent": _Statistic("share of black pixels", "%", 40.0),
    "texture": _Statistic("fine texture relative to the contrast", "", 0.7, 0.01),
    "local_contrast": _Statistic("local contrast relative to the whole", "", 0.7, 0.01),
    "upright": _Statistic("share of upright edges", "", 0.3),
    "reading_percent": _Statistic("share with a reading in range", "%", 0.7, 1.0),
    "median_m": _Statistic("median depth", "m", 0.7, 0.3),
    "spread_m": _Statistic("spread of the depth", "m", 0.7, 0.3),
    "top_bottom_m": _Statistic("median depth of the upper third minus the lower", "m", 2.0),
    "texture_m": _Statistic("mean step of the depth between pixels", "m", 0.7, 0.01),
}


def unlike_training(
    statistics: Mapping[str, float], usual: tuple[UsualRange, ...]
) -> UnlikeTraining | None:
    """The statistic that is farthest outside its usual range, if it is far outside.

    Args:
        statistics: Those of the picture, from `calib.picture_statistics`.
        usual: The usual ranges; statistics that this version does not know are left out.
    """
    farthest, found = _MARGIN, None
    for each in usual:
        known, value = _STATISTICS.get(each.statistic), statistics.get(each.statistic)
        if known is None or value is None:
            continue
        low, here, high = (known.scaled(one) for one in (each.low, value, each.high))
        beyond = max(low - here, here - high) / max(high - low, known.least_width)
        if beyond > farthest:
            farthest = beyond
            found = UnlikeTraining(
                each.statistic, value, each.low, each.high, known.words, known.unit
            )
    return found


def what_helps(modality: str, used: str, score_threshold: float) -> str:
    """What to try on pictures that are unlike those of the training, in the command line's words.

    Args:
        modality: "rgb", "depth" or "both".
        used: Name of the model in use.
        score_threshold: The one in use.
    """
    other = other_model(modality, used)
    ways = [] if other is None else [f"--model {other}"]
    if score_threshold > _LOW_SCORE:
        ways.append(f"a --score-threshold below {score_threshold:g}")
    return f"try {''.join(f'{way}, ' for way in ways)}or fine-tuning ({_GUIDE})"
