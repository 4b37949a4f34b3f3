"""Assumptions about rigs: the errors of those that state none."""

from typing import Final

DEPTH_SCALE_STD: Final = 0.007
"""Relative standard deviation of the scale of the depth.
Source: chosen, makers of depth cameras promise 1 to 2 % near by, taken as two or three of these."""

PRINCIPAL_STD_SHARE: Final = 0.006
"""Standard deviation of the principal point in x and y, as a share of the width of the image.
Source: chosen, principal points of ten axes of five calibrated cameras lie so far from the middle,
where files without a calibration put them."""

ROTATION_STD_DEG: Final = 2.0
"""Standard deviation of a given vertical and of a mounting about each axis, in degrees.
Source: chosen, makers of accelerometers state zero errors of 20 to 80 mg, which tilt by 1.1 to 4.6
degrees at most."""
