"""Assumptions about stems that are placed without depth."""

from typing import Final

GROUND_SLOPE_STD_DEG: Final = 3.0
"""Standard deviation of the slope of ground that is said to be level, or to slope as given, about
each level axis, in degrees. Source: chosen, a rise of half a metre in ten."""

CAMERA_HEIGHT_STD: Final = 0.03
"""Relative standard deviation of a camera's height that states none.
Source: chosen, 5 cm of a height of 1.7 m, as measured with a tape on uneven ground."""

RELIEF_STD_M: Final = 0.1
"""Standard deviation of the ground's height at a foot about its plane: humps and hollows, and what
hides the foot. Source: chosen by hand."""

ROOT_FLARE_STD: Final = 0.3
"""Standard deviation of the place of the foot's bark in front of the stem's own, as a share of the
radius: roots and the flare of the butt. Source: chosen by hand."""

CUT_ABOVE_GROUND_M: Final = 0.17
"""Height of the felling cut's keypoint above the ground where the foot is hidden.
Source: chosen by hand, stumps are 5 to 30 cm high."""

CUT_ABOVE_GROUND_STD_M: Final = 0.1
"""Standard deviation of that height. Source: chosen by hand, stumps are 5 to 30 cm high."""

HIDDEN_FOOT_STDS: Final = 2.0
"""The foot is hidden where the mask ends above the cut's keypoint by more than this.
Source: chosen by hand."""

UNCHECKED_OUTLINE_STD: Final = 0.1
"""Relative standard deviation of widths by a network's outlines that no depth checks: a second stem,
a branch or a shadow in the mask. Source: chosen on 600 stems of 183 simulated frames."""
