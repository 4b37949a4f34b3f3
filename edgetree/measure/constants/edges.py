"""Assumptions about the edges of stems in depth images."""

from typing import Final

EXACT_STD: Final = 0.1
"""Standard deviation of the end of a surface in exact depth, in readings, the same for all edges
of a frame. Source: chosen on ray-traced cylinders."""

TOF_OUTWARDS: Final = -0.35
"""How far outside of its edge a surface ends in the depth of a time-of-flight camera, in readings:
half of the readings at an edge may be lost. Source: chosen on ray-traced cylinders."""

TOF_STD: Final = 0.2
"""Standard deviation of that between frames. Source: chosen on ray-traced cylinders."""

STEREO_OUTWARDS: Final = 0.8
"""The same in the depth of a stereo camera: windows at an edge mostly take the nearer surface.
Source: chosen on ray-traced cylinders."""

STEREO_STD: Final = 0.2
"""Standard deviation of that between frames and cameras. Source: chosen on ray-traced cylinders."""

FILLED_OUTWARDS: Final = 1.0
"""The same in depth that is filled between readings. Source: chosen, points of a cloud are drawn
up to a reading outside of their outline."""

FILLED_STD: Final = 0.6
"""Standard deviation of that between frames. Source: chosen, that of an even spread from none to
two."""

GROWN_BY_SQUARES: Final = 0.5
"""Readings that fill squares of pixels take the nearest surface of these, which so grows by this
share of the side of a square beyond its first pixel. Source: bound, the mean of edges anywhere in a
square."""

STATIONS_PER_END: Final = 2.0
"""Neighbouring ends of a surface have correlated errors: so many stations count as one.
Source: chosen by hand."""

NETWORK_EDGE_PX: Final = 1.0
"""Least standard deviation of the edges and keypoints of a network, in px of the image: where it
sees an edge depends on how the camera draws it. Source: chosen, on cylinders in front of five
sensors edges were off by up to 2 px of 1280 and 0.6 px of 256."""
