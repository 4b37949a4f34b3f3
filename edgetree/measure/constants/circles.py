"""Assumptions about slices of point clouds."""

from typing import Final

SLICE_HALF_M: Final = 0.1
"""Half the height of a slice. Source: bound, a stem tapers by less than 3 mm in it."""

SECTORS: Final = 36
"""Number of sectors around a stem: bark is alike within one of them.
Source: chosen, 2 to 4 cm of the girth."""

MIN_SECTOR_POINTS: Final = 3
"""Fewer points are no reading of a sector. Source: bound, their mean is still robust."""

MIN_SECTORS: Final = 9
"""Fewer sectors fit no circle: the least arc is 90 degrees. Source: chosen."""

LEAST_SCATTER_M: Final = 0.002
"""Least scatter of a surface. Source: bound, that of the best scanners."""

UNSEEN_SHAPE_STD: Final = 0.1
"""Relative standard deviation of the diameter by the shape of a stem of which hardly any sector is
seen, less with every sector: the arc of an oval is not that of its mean circle.
Source: chosen on simulated scans."""

MAX_APART_STDS: Final = 3.0
"""A circle and an outline further apart give a warning.
Source: bound, noise exceeds it once in 370 times."""
