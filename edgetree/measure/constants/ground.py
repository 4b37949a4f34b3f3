"""Assumptions about forest ground, about plants on it, and about the vertical."""

from typing import Final

# Where the ground is looked for

SEARCH_RADIUS_M: Final = 1.4
"""Ground is searched for within this distance of the bark.
Source: chosen on 460 simulated frames with exact outlines."""

MAX_ABOVE_CUT_M: Final = 0.6
"""Ground points are at most this far above the felling cut.
Source: chosen on 791 simulated frames."""

MAX_BELOW_CUT_M: Final = 1.5
"""Ground points are at most this far below the felling cut.
Source: bound, ground of 45 degrees within the radius."""

MAX_ABOVE_STEM_M: Final = 0.05
"""The ground lies above no seen part of the stem, but for this much and for its slope across the
stem. Source: chosen by hand."""

MIN_ABOVE_UNSEEN_FOOT_M: Final = 0.15
"""Where the foot is below the image, so is the felling cut. Ground under plants has to lie at least
this far below the lowest part that is seen. Source: chosen on 720 simulated frames, where it
refuses 2 of 145 right planes, and 22 of 31 wrong ones."""

MIN_SHARE_WITHOUT_FOOT: Final = 0.3
"""Where the foot is below the image, branches may be the lowest that is seen: the share of the
points that the plane has to hold then. Source: chosen by hand."""

MAX_SLOPE_WITHOUT_FOOT_DEG: Final = 30.0
"""The steepest plane there. Source: chosen by hand."""

# Its shape

UNEVEN_STD_M: Final = 0.05 / 3
"""Unevenness of ground as a standard deviation; points within three of them are of the plane.
Source: chosen by hand, the simulated ground has bumps of 1 to 3.5 cm."""

DEPARTURE_STD_PER_M: Final = 0.15
"""Standard deviation by which ground leaves its plane at the stem, times the squared distance from
the bark in metres. Source: fitted (cut-height-labels)."""

POINTS_PER_ERROR: Final = 12.0
"""Ground points that share one error. Source: fitted (cut-height-labels)."""

LITTER_STD_M: Final = 0.02
"""Smallest standard deviation of the ground's height: litter, moss and roots.
Source: fitted (cut-height-labels)."""

# Plants on it

OUTLIER_STD_M: Final = 0.15
"""Points off the plane may mean that plants hide the ground: standard deviation of its height,
times the squared share of such points. Source: fitted (cut-height-labels)."""

LIFT: Final = 0.35
"""Low plants pass for ground and lift the plane: by this times the spread of its points, times the
share of points above it. Source: fitted (cut-height-labels)."""

MIN_PLANTS_SHARE: Final = 0.3
"""From this share of points above the plane on, plants hide much of the ground, and a stump that
may be too high has a warning. Source: chosen by hand."""

BESIDE_M: Final = 0.025
"""Roughness compares the depth at a reading with those this far to its left and right.
Source: chosen by hand."""

MIN_BESIDE_PX: Final = 2.0
"""The least distance to them in the image.
Source: bound, neighbouring pixels share the noise of stereo cameras."""

MIN_UNSTEADINESS: Final = 1.35
"""Unsteadiness is the spread of ground readings about their plane plus their roughness, both in
standard deviations. It is about 1 on clean ground and 2 in dense grass. From this value on, plants
may hide the ground. Source: fitted (cut-height-labels), then checked on 480 ray-traced scenes."""

STD_PER_UNSTEADINESS_M: Final = 0.25
"""Standard deviation of the ground's height for each unit of unsteadiness above that.
Source: fitted (cut-height-labels), then checked on 480 ray-traced scenes."""

CLOSED_COVER_SHARE: Final = 0.1
"""Gaps between plants show lower ground, of which readings stand out above the plane. Where fewer
than this share do, an unsteady surface is that of closed plants.
Source: chosen on 1,014 ray-traced scenes of grass."""

CLOSED_COVER_STD_M: Final = 0.065
"""In closed plants, the standard deviation above this value counts more.
Source: chosen on the same scenes."""

CLOSED_COVER_FACTOR: Final = 5.0
"""By how many times it is added, at most. Source: chosen on the same scenes."""

MIN_COVER_STD_M: Final = 0.08
"""From this standard deviation because of plants on, a stump that may be too high has a warning.
Source: chosen on ray-traced scenes of dense grass and noisy cameras."""

MAX_COVER_STD_M: Final = 0.2
"""From this one on, no cut height is given.
Source: bound, a 95 % interval would be 0.8 m wide."""

GAP_STDS: Final = 4.0
"""Readings this many standard deviations below the plane show deeper ground in gaps.
Source: chosen, one of 30,000 normal errors is as large."""

GAP_WITHIN_M: Final = 0.7
"""They count within this distance of the bark, where ground leaves its plane little.
Source: chosen by hand, half of the search radius."""

MIN_GAP_READINGS: Final = 4
"""Fewer of them may be errors of the sensor. Source: chosen by hand."""

FOOT_STDS: Final = 3.0
"""Bark that is seen this many standard deviations below the plane shows deeper ground.
Source: bound, rarer than 1 in 700 by chance."""

FOOT_DISTANCE_STDS: Final = 2.0
"""A stem so many standard deviations from where its foot meets the ground has a warning.
Source: chosen on simulated frames, where fewer than 1 in 50 stems have one."""

LATE_DEPTH_SHARE: Final = 0.02
"""Probability that the depth of a frame is of an earlier moment than its picture, before its feet
are seen. Source: chosen by hand, so that clean frames are hardly wider."""

LATE_DEPTH_BESIDE_SHARE: Final = 0.3
"""The same where the depth lies beside the picture, as after a turn of the machine or with a wrong
alignment. Source: chosen by hand, neither is much more common."""

LATE_DEPTH_STD_M: Final = 0.4
"""How far a machine drives between the moments of such depth and its picture, as a standard
deviation. Source: chosen, 0.3 s at 1.3 m/s."""

MIN_LATE_SHIFT_M: Final = 0.05
"""From this root mean square of the shift of late depth on, the stems of a frame have a warning.
Source: chosen, about that of a distance without faults."""

MIN_LATE_PROBABILITY: Final = 0.06
"""Less probable shifts of the depth are not looked at, as most frames would be a little wider.
Source: chosen, feet that make one three times as likely, which is hardly worth a mention."""

MOVED_BY_TURN_M: Final = 2.0
"""What is taken for a stem moves its depth by so many metres for each radian by which it turns it.
Source: chosen on scenes of forks and branches, whose stems are seen over some 2 m."""

OTHER_FOOT_SHARE: Final = 0.05
"""Probability that a foot is moved by something else, such as a mask that ends too early. The share
of the points that stand above the ground is added, as plants hide feet.
Source: chosen on simulated frames, some 1 in 20 of a network's masks."""

GOES_ON_SHARE: Final = 0.8
"""A stem goes on below its mask if this share of the readings there is as far away as its bark.
Source: chosen on simulated frames."""

GOES_ON_MARGIN: Final = 0.3
"""The same share beside the stem has to be smaller by this, as plants go on there.
Source: chosen on simulated frames."""

MIN_BELOW_FOOT_SHARE: Final = 0.3
"""The ground below a foot is seen if this share of the places there has a reading.
Source: chosen by hand."""

EVEN_COVER_SHARE: Final = 0.2
"""Probability that plants or snow with an even top hide the soil, before the height of the cut is
seen. Source: chosen on ray-traced scenes of even plants."""

EVEN_COVER_MEAN_M: Final = 0.2
"""Mean height of such a cover, of an exponential distribution. Source: chosen by hand."""

STUMP_MEAN_M: Final = 0.25
"""Mean height of felling cuts above the ground. Source: chosen by hand."""

# The vertical

CAMERA_UP_STD_DEG: Final = 15.0
"""Standard deviation of the camera's own up direction as the vertical.
Source: fitted (inclination-no-vertical)."""

SLOPE_STD_DEG: Final = 12.0
"""Standard deviation of the slope of forest ground, as an error of its normal as the vertical.
Source: fitted (inclination-no-vertical)."""

MIN_STEMS_FOR_VERTICAL: Final = 3
"""Fewer other stems tell no direction of a lean. Source: bound, one or two may all lean."""

OWN_RADII: Final = 1.25
"""Of a stem whose foot is not in the image, readings within so many radii of its axis, and
`SURFACE_M` more, are of the stem itself. Source: chosen, masks of networks end inside the stem."""
