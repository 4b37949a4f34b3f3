"""Assumptions about the keypoints and masks of networks, and about masks that are given."""

from typing import Final

# Edges of masks

EDGE_TOLERANCE: Final = 0.08
"""An edge of a mask agrees with the straight line along it within this share of the half width.
Source: chosen by hand."""

MIN_EDGE_TOLERANCE_PX: Final = 1.0
"""The least of that tolerance. Source: bound, the size of a pixel."""

MIN_CONTRADICTING_SHARE: Final = 0.2
"""Edges at which the depth shows that the stem ends, and that lie inside the line, enlarge the
error from this share of the edges on. Source: chosen by hand, fewer are the foot of a stem."""

MIN_INSET_PX: Final = 2.0
"""A mask is too wide if the stem ends further inside it in the depth, in the median of a side.
Source: bound, matching in a stereo camera moves edges by a pixel."""

MIN_RAMP_CONTRAST: Final = 3.0
"""The ramp of the depth at an edge is measured where the background is so many times as far behind
the stem as its surface may reach. Source: chosen by hand."""

RAMP_END: Final = 0.9
"""The ramp ends at this share of the way to the background.
Source: chosen by hand, noise of the background stays above it."""

MIN_RAMP_PX: Final = 2.5
"""Narrower ramps are no sign of a filter, in px of the image.
Source: bound, pixels that mix stem and background make up to two."""

STATIONS_PER_ERROR: Final = 5.0
"""Neighbouring edges of a mask have correlated errors: so many stations count as one.
Source: fitted (inclination-network)."""

EDGE_SHARE: Final = 0.6
"""Share of the error of a half angle that counts at each height along the stem, since edges at
several stations are averaged. Source: fitted (dbh-network)."""

EDGE_ERROR_M: Final = 2.0
"""Edges within this distance along the stem share one error. Source: fitted (taper-network)."""

MAX_CONVERGENCE: Final = 0.15
"""The edges of a stem converge by less than this, in px of width per px of length.
Source: bound, twice what the thickest butts do."""

MIN_BESIDE: Final = 0.2
"""A mask shows more than the stem where it goes on beside the straight lines along the stem by this
share of the width between them. Source: chosen by hand, above the butt swell of stems."""

NEAR_RAD: Final = 0.15
"""Stems that fill more than this angle are near: nearer than seven diameters. Their pictures end
at breast height or at roots. Source: chosen on simulated frames, where it changes hardly a stem."""

MUCH_LONGER: Final = 1.4
"""Where mask and depth show different straight parts, that of the mask counts if it is so many
times as long as that of the depth. Source: chosen by hand, as depth may be missing on a stem."""

MIN_ON_STEM_SHARE: Final = 0.03
"""Share of the places on a stem that its mask must hold.
Source: bound, below it hardly a reading is left."""

SECTION_QUANTILE: Final = 0.1
"""If the cut is not in the image, the diameter is measured at this quantile of the visible length,
from below. Source: chosen by hand."""

MAX_DISAGREEMENT_STDS: Final = 3.0
"""Keypoints and mask disagree, with a warning, if their diameters differ by more standard
deviations. Source: bound, chance does so once in 370 times."""

GIVEN_MASK_DOUBT: Final = 0.3
"""Share of `outline_doubt` and `readings_doubt` that counts for masks that the caller gives.
Source: chosen by hand, such masks do not depend on a detector."""

MAX_INCOMPLETE_STD: Final = 0.45
"""Largest relative standard deviation by both doubts.
Source: chosen by hand, a little below `MAX_RELATIVE_STD`."""

# Masks that hold more than one stem

SAME_EDGE_SHARE: Final = 0.1
"""Edges of the stem that is meant are within this share of its width of straight lines along it.
Source: chosen by hand, arms of a fork are further off."""

FORK_WIDTH: Final = 1.25
"""Above a fork, a mask with a gap is so many times as wide as at its foot.
Source: chosen by hand, what hides the middle of a stem does not widen it."""

STEP_STD_PX: Final = 1.5
"""Standard deviation of an edge between two stems, which the depth alone shows.
Source: bound, matching in a stereo camera moves edges by a pixel."""

# Sides of the image. Distances in px are of an image of 1280 px width.

GIVEN_BORDER_PX: Final = 1.0
"""Edges of given masks closer to the border of the image are not used, in px of the image.
Source: bound, the size of a pixel."""

NETWORK_BORDER_PX: Final = 9.0
"""The same of a network's masks: they end some pixels before the border that cuts a stem off.
Source: chosen with `edge-n-depth` on 1,700 frames."""

BORDER_MASK_STDS: Final = 2.0
"""Added to both: standard deviations of a mask edge. Source: chosen by hand."""

CLIPPED_GAP_PX: Final = 30.0
"""A side of the image may cut a stem off if its box ends closer to that side, and the keypoint of
the edge there is not seen. Edges closer to it are not used then. Source: chosen with `edge-n-depth`
on 1,700 frames that it was not trained on: 95 % of 254 diameters of such stems hold, without this
limit 86 % of 347, and 157 of 158 whole stems near a side are still measured."""

UNSEEN_SCORE: Final = 0.1
"""A keypoint with a lower score is not seen. Source: chosen on the same frames."""

REACHES_SIDE_SHARE: Final = 0.2
"""A box reaches a side that is less than this share of its width away.
Source: chosen by hand."""

NEAR_SIDE_WIDTHS: Final = 0.4
"""Where the box reaches a side, edge keypoints this near to it, in widths of the section, may be
beyond it: networks then predict a point inside the image. Source: chosen by hand."""

NEAR_SIDE_STD: Final = 0.2
"""Standard deviation of such a keypoint, in widths of the section.
Source: fitted (diameter-network)."""

LOWER_SIDE_PX: Final = 10.0
"""A box reaches the lower side of the image if it ends less than this before it.
Source: chosen by hand."""

MIN_LOWER_SIDE_PX: Final = 7.0
"""The least of that, in px of the image. Source: chosen, boxes of networks end up to six px before
the side of an image of 240 px width that cuts their stem off."""

BORDER_KEYPOINT_STDS: Final = 12.0
"""A keypoint so many standard deviations from the lower side may be below the image.
Source: chosen by hand, networks predict such points far inside."""

SECTION_DOUBTED_M: Final = 0.05
"""Of a stem that the lower side cuts off, networks predict the section near that side. Up to this
distance above it, the section is as likely below the image. Source: chosen on 673 frames."""

SECTION_CERTAIN_M: Final = 0.3
"""From this distance on it never is. Source: chosen on 673 frames."""

MAX_LENS_BEND: Final = 0.01
"""Bend of a straight line along a side of the picture, as a share of the picture's size across it,
from which stems are measured in pinhole views turned towards them.
Source: chosen, an eighth of the width of a stem that is a twelfth of the picture wide; the lenses
of usual depth cameras bend less."""
