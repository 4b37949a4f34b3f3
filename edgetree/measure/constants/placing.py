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
"""Relative standard deviation of widths by a network's outlines that no depth checks: a second
stem, a branch or a shadow in the mask. Source: chosen on 600 stems of 183 simulated frames."""

MARK_ON_STEM_STD_M: Final = 0.02
"""Standard deviation of the distance between a mark on a stem and its bark: the plate, and bark
that bulges. Source: chosen by hand."""

MARK_BESIDE_STD_M: Final = 0.15
"""The same of a mark that stands beside a stem, between the front of the stem and its axis or a
little off. Source: chosen by hand, a step to the side that keeps the distance to the camera."""

MARK_SIZE_STD: Final = 0.01
"""Relative standard deviation of the length of a mark: print, plate and tape.
Source: chosen by hand."""

CORNER_STD_PX: Final = 0.7
"""Standard deviation of a marker's side in px: blur rounds its corners.
Source: chosen on 166 markers drawn into simulated frames, 0.2 to 0.7 px by size, 0.1 to 0.4 px
short."""

BAR_END_STD_PX: Final = 1.0
"""Standard deviation of an end of a scale bar in px of 1280, as clicked by hand.
Source: chosen by hand."""

BAR_TURN_STD: Final = 0.03
"""Relative standard deviation of a scale bar's length because it points towards or away from the
camera. Source: chosen, a bar that is turned by 14 degrees is seen 3 % short."""

BAR_LEAN_STD_DEG: Final = 5.0
"""Standard deviation of the angle by which a bar that is seen from above or from a side points
towards or away from the camera, in degrees: the lean of the stem, or of a rule against it.
Source: chosen by hand."""

ASSUMED_FOCAL_SHARE: Final = 0.9
"""Focal length of a camera of which nothing is known, in larger sides of the picture.
Source: chosen, telephones and colour cameras have 0.7 to 1.1."""

ASSUMED_FOCAL_STD: Final = 0.25
"""Its relative standard deviation.
Source: chosen, telephones and colour cameras have 0.7 to 1.1."""

EXIF_FOCAL_STD: Final = 0.04
"""Relative standard deviation of a focal length by a picture's EXIF: the 35 mm equivalent is
rounded, by the width or by the diagonal of the picture, and lenses are nominal.
Source: chosen, width and diagonal differ by 4 % in pictures of 4:3."""

POSE_TURN_STD_DEG: Final = 0.2
"""Standard deviation of a pose's direction from one view of a stem to the next, in degrees.
Source: chosen, wheel odometry and visual odometry drift by about this much over a metre."""

POSE_SCALE_STD: Final = 0.02
"""Relative standard deviation of the distance that poses say the camera has moved.
Source: chosen, odometry of wheels on soft ground slips by 1 to 3 %."""

VIEW_STEP_M: Final = 0.1
"""Views of a stem from places nearer to each other than this count once: they share the errors of
bark and outline. Source: chosen by hand."""

USUAL_DIAMETER_M: Final = 0.3
"""Diameter that tells roughly how far a stem is, to find it again in the next picture. No result
rests on it. Source: chosen by hand."""

USUAL_DIAMETER_STD: Final = 0.5
"""Its relative standard deviation. Source: chosen by hand."""
