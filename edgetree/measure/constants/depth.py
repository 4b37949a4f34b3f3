"""Assumptions about depth cameras, and about readings that are missing or contradict each other."""

from typing import Final

# Readings near the edge of a stem may show the background. Lateral positions are 1 at the edge.

DEPTH_WITHIN: Final = 0.75
"""Depth is read within this share of the half width.
Source: bound, below `MAX_USED_OFFSET`, so that small corrections of the edges lose no readings."""

MAX_USED_OFFSET: Final = 0.8
"""Readings further from the middle are not used.
Source: chosen by hand."""

ROUNDNESS_WITHIN: Final = 0.85
"""The same where one round stem is told from several.
Source: chosen by hand."""

# What is in front of a stem

NEARER_SHARE: Final = 0.98
"""An object is in front of a stem if its depth is below this share of the stem's, by three standard
deviations and `NEARER_M`. Source: chosen by hand."""

NEARER_M: Final = 0.05
"""Depth by which it is nearer at least. Source: bound, bark is less deep."""

SURFACE_STDS: Final = 3.0
"""Readings are on the stem within its radius, this many standard deviations and `SURFACE_M`.
Source: bound, noise exceeds it once in 370 times."""

SURFACE_M: Final = 0.05
"""Depth that bark adds to that. Source: bound, bark is less deep."""

BESIDE_SHARE: Final = 0.2
"""Readings go on beside the stem if this share of the places there is as far away.
Source: chosen on ray-traced scenes; a branch that crosses at one of three stations has a third."""

MIN_OWN_SHARE: Final = 0.08
"""Share of the places on a stem that must have a reading which does not go on beside it, and one
that agrees with the stem fitted.
Source: chosen on ray-traced scenes, so little of a stem shows behind dense netting."""

MIN_OWN_STATIONS: Final = 0.25
"""Share of the length along which such readings must lie: a branch crosses at one place.
Source: chosen on ray-traced scenes."""

FILLED_SHARE: Final = 0.5
"""Readings that all go on beside the stem are those of a stem in a thicket if they fill this share
of its places. Source: chosen by hand, branches and twigs cover less."""

SEEN_THROUGH_SHARE: Final = 0.05
"""Such readings are not a stem's if this share of its places shows something behind them.
Source: chosen, as few readings make no depth of a stem."""

SEVERAL_STEMS_SCORE: Final = 0.4
"""A mask shows several stems from this score on; it is 0 for one round stem and 1 for two equal
ones side by side. Source: chosen by hand."""

SEVERAL_STEMS_STDS: Final = 3.0
"""So many standard deviations the score has to be above 0.
Source: bound, noise exceeds it once in 370 times."""

# Two stems in one mask, by the depth across it

MIN_GAIN: Final = 8.0
"""Two stems explain the depth across a mask if they lower its sum of squares by so much: they have
four unknowns more, and the place of the step is searched for.
Source: chosen on ray-traced scenes, single stems stay below 6."""

SIDE_BY_SIDE_RADII: Final = 1.0
"""Neither of two stems is meant if the axis of one is behind that of the other by less than so many
radii of this. Source: chosen by hand, none hides the other then."""

OVAL_TURN_STD: Final = 0.1
"""Standard deviation of the depth at the edges of a stem from that of a circle, in radii: one edge
of an oval stem may be nearer than the other. Source: bound, axes of 1 to 1.2 seen askew."""

OVAL_DEPTH_STD: Final = 0.3
"""The same of its middle. Source: chosen, depth cameras also flatten stems."""

SHAPE_STD: Final = 0.04
"""Standard deviation of what is left, in half widths of the mask. Source: chosen by hand."""

BARK_STD_M: Final = 0.01
"""Standard deviation of the depth by bark. Source: bound, bark is less deep."""

OUTLIER_STDS: Final = 3.0
"""A larger distance from the shape counts as this.
Source: bound, noise exceeds it once in 370 times."""

# The fit of distance and tilt

NOISE_PRIOR_READINGS: Final = 8.0
"""Weight of the assumed noise when it is adjusted to the scatter, in independent readings.
Source: chosen, so many readings know their scatter to a quarter."""

MIN_READINGS: Final = 4
"""Fewer readings fit no stem. Source: bound, the fit has three unknowns."""

MIN_BEAMS: Final = 5
"""Fewer beams of a laser scanner fit no stem: two more than the fit has unknowns.
Source: chosen."""

MIN_DEPTH_SHARE: Final = 0.05
"""Share of the places on a stem that must have a reading.
Source: bound, of 216 places 10 are left."""

MAX_CURVATURE_STD: Final = 0.3
"""With a larger relative standard deviation the roundness tells nothing of the half angle.
Source: chosen by hand."""

# Readings that are missing or disagree

DISAGREEMENT_STD: Final = 0.5
"""Relative standard deviation of the distance, times the squared share of readings that disagree:
these may show the stem, and the others an object in front of it.
Source: fitted (distance-labels)."""

UNREAD_STD: Final = 0.025
"""The same, times the squared share of samples without a reading on the stem.
Source: chosen on 720 simulated frames."""

AXIS_DOUBT: Final = 2.0
"""The errors of the axis' angles grow with the doubt in the diameter times this, since outlines and
readings are the same. Source: fitted (inclination-network)."""
