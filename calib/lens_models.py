"""Names of the distortion models."""

RADTAN, FISHEYE = "radtan", "fisheye"
