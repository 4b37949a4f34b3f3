"""Assumptions about the shape of stems, and which of their values are given."""

from typing import Final

# Shape

TAPER_PER_M: Final = 0.07
"""Relative decrease of the diameter per metre of a lower stem.
Source: fitted (axis-distance-labels)."""

TAPER_STD_PER_M: Final = 0.02
"""Standard deviation of `TAPER_PER_M` between stems. Source: fitted (axis-distance-labels)."""

TAPER_SPREAD_PER_M: Final = 0.05
"""The same before the edges of a stem are seen, which tell its taper: poles have none.
Source: chosen on simulated frames with exact outlines, and on cylinders."""

STEM_BEND_PER_M: Final = 0.02
"""How far stems bend off a straight axis, and taper: times the squared distance along the stem in
metres. Source: fitted (inclination-labels)."""

SEEN_BEND_SHARE: Final = 0.1
"""Share of `bend_std_deg` that moves the axis between section and camera level: the stem is seen
there as a rule, and the fit follows its bend. Source: chosen on 720 simulated frames."""

UNSEEN_BEND_SHARE: Final = 3.0
"""`SEEN_BEND_SHARE` where the camera's level is below the section: the line is extended below the
ground, from a butt that is more crooked than the stem. Source: chosen on 720 simulated frames."""

SHAPE_STD_PER_M: Final = 0.05
"""Relative standard deviation of a width per metre along the stem from the edges that it is read
from. Source: fitted (diameter-network)."""

BREAST_HEIGHT_SHAPE: Final = 1.4
"""Stems are more irregular along the stem, at branches, than at the section: factor on
`out_of_round_std`. Source: fitted (dbh-labels)."""

CUT_SHAPE: Final = 1.5
"""Displacement of the axis between section and cut by bark, butt swell and bends: standard
deviation in diameters, as a factor on `out_of_round_std`. Source: fitted (distance-labels)."""

COMMON_LEAN_STD_DEG: Final = 2.0
"""Standard deviation of the lean that all stems of a stand share, by wind, snow and light.
Source: fitted (inclination-no-vertical)."""

SHAPE_STDS: Final = 3.0
"""Diameters along a stem that differ from its usual shape by more standard deviations are in doubt.
Source: bound, chance does so once in 370 times."""

MIN_SHAPE: Final = 0.3
"""Least share of the section's diameter that is expected along a stem.
Source: bound, a lower stem is thicker."""

# The butt

SWELL_LENGTH_M: Final = 0.6
"""The butt is wider towards the ground: at the height h above the section, the share
1 - exp(-h / length) of `butt_swell` is gone. Source: fitted (diameter-network)."""

COLLAR_STD: Final = 0.2
"""Relative standard deviation of a diameter at the ground, by the root collar.
Source: fitted (profile-labels)."""

COLLAR_HEIGHT_DIAMETERS: Final = 0.9
"""Height within which `COLLAR_STD` falls by a factor of e, in diameters.
Source: fitted (profile-labels)."""

LOWEST_HEIGHT_DIAMETERS: Final = 0.5
"""No diameters are given below this height above the ground, in diameters.
Source: chosen by hand, above most of the root collar."""

LOWEST_HEIGHT_M: Final = 0.2
"""Nor below this height in metres. Source: chosen by hand, above most of the root collar."""

# Where a cut can be

LOWEST_CUT_M: Final = -0.5
"""Lowest plausible felling cut, along the axis from the diameter's section.
Source: chosen by hand."""

HIGHEST_CUT_M: Final = 0.3
"""Highest plausible felling cut, along the axis from the diameter's section.
Source: chosen by hand, the cut is a little below the section."""

MAX_CUT_BELOW_GROUND_M: Final = 0.1
"""Cuts deeper in the ground than this and two standard deviations are not given.
Source: chosen by hand."""

MAX_CUT_ABOVE_GROUND_M: Final = 0.8
"""Cuts higher above the ground than this and two standard deviations are not given.
Source: chosen by hand, stumps are lower."""

# Which values are given

MIN_DIAMETER_M: Final = 0.02
"""Smaller diameters are failures. Source: bound, these are no stems to fell."""

MAX_RELATIVE_STD: Final = 0.5
"""Diameters with a larger relative standard deviation are not given.
Source: bound, their 95 % intervals reach down to 0."""

MIN_LEAN_STDS: Final = 1.5
"""An inclination of fewer standard deviations has no direction.
Source: chosen, the direction is then known to about 40 degrees."""

MIN_TAPER_M: Final = 0.5
"""Length of the stem that must be seen for a taper.
Source: chosen by hand."""

VISIBLE_WITHIN_M: Final = 0.25
"""A diameter is given at a height if both edges show within this distance along the stem.
Source: chosen by hand."""
