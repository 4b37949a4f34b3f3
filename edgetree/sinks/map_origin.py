"""Georeferencing: from the map's local metres to WGS 84."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from basetree.errors import InputError

# WGS 84: semi-major axis in metres and squared eccentricity.
_AXIS_M: Final = 6_378_137.0
_ECCENTRICITY2: Final = 6.694379990141316e-3

_Float = NDArray[np.floating[Any]]


@dataclass(frozen=True)
class MapOrigin:
    """Where the map's origin is on the earth, and how the map is turned.

    Attributes:
        latitude_deg: Geodetic latitude of the map's origin in WGS 84, -89 to 89.
        longitude_deg: Its longitude, -180 to 180.
        height_m: Its height above the ellipsoid.
        heading_deg: Direction of the map's y axis, clockwise from north. With 0, x points east and
            y north.

    Raises:
        InputError: a value is not finite or out of its range.
    """

    latitude_deg: float
    longitude_deg: float
    height_m: float = 0.0
    heading_deg: float = 0.0

    def __post_init__(self) -> None:
        limits = {
            "latitude_deg": 89.0,
            "longitude_deg": 180.0,
            "height_m": 1e5,
            "heading_deg": 360.0,
        }
        for name, limit in limits.items():
            value = getattr(self, name)
            if not abs(value) <= limit:
                raise InputError(f"{name} is {value:g}: expected -{limit:g} to {limit:g}")

    def geodetic(self, xyz_m: _Float) -> tuple[float, float, float]:
        """Longitude and latitude in degrees, and height in metres, of a point of the map.

        The map is the plane that touches the ellipsoid at the origin; the conversion is exact, by
        way of earth-centred coordinates.

        Args:
            xyz_m: (3,) point in the map.
        """
        heading = math.radians(self.heading_deg)
        x, y, up = (float(value) for value in xyz_m)
        east = x * math.cos(heading) + y * math.sin(heading)
        north = y * math.cos(heading) - x * math.sin(heading)
        return _to_geodetic(self._origin() + self._axes() @ np.array([east, north, up]))

    def _origin(self) -> _Float:
        latitude, longitude = math.radians(self.latitude_deg), math.radians(self.longitude_deg)
        normal_m = _normal_m(latitude)
        level_m = (normal_m + self.height_m) * math.cos(latitude)
        return np.array(
            [
                level_m * math.cos(longitude),
                level_m * math.sin(longitude),
                (normal_m * (1 - _ECCENTRICITY2) + self.height_m) * math.sin(latitude),
            ]
        )

    def _axes(self) -> _Float:
        """(3, 3) columns: east, north and up in earth-centred coordinates."""
        latitude, longitude = math.radians(self.latitude_deg), math.radians(self.longitude_deg)
        sin_lat, cos_lat = math.sin(latitude), math.cos(latitude)
        sin_lon, cos_lon = math.sin(longitude), math.cos(longitude)
        return np.array(
            [
                [-sin_lon, -sin_lat * cos_lon, cos_lat * cos_lon],
                [cos_lon, -sin_lat * sin_lon, cos_lat * sin_lon],
                [0.0, cos_lat, sin_lat],
            ]
        )


def _normal_m(latitude: float) -> float:
    """Radius of curvature in the prime vertical."""
    return _AXIS_M / math.sqrt(1 - _ECCENTRICITY2 * math.sin(latitude) ** 2)


def _to_geodetic(xyz_m: _Float) -> tuple[float, float, float]:
    """Longitude, latitude and height of an earth-centred point, by fixed-point iteration."""
    x, y, z = (float(value) for value in xyz_m)
    level_m = math.hypot(x, y)
    latitude, height_m = math.atan2(z, level_m * (1 - _ECCENTRICITY2)), 0.0
    for _ in range(6):
        normal_m = _normal_m(latitude)
        height_m = level_m / math.cos(latitude) - normal_m
        share = _ECCENTRICITY2 * normal_m / (normal_m + height_m)
        latitude = math.atan2(z, level_m * (1 - share))
    return math.degrees(math.atan2(y, x)), math.degrees(latitude), height_m
