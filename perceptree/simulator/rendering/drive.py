"""A machine's drive: the poses of its camera, and the measurements of an IMU on the camera."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from basetree.arrays import Float
from perceptree.simulator.rendering.view import Pose, View, look_from
from perceptree.simulator.scene.circuit import Circuit
from perceptree.simulator.scene.terrain import Terrain
from perceptree.simulator.settings import CameraSettings, DriveSettings
from perceptree.simulator.vectors import UP

IMU_HZ = 200
GRAVITY_M_PER_S2 = 9.81

_WHEELBASE_S = 0.8  # smoothing of the terrain by the machine's length
_TRACK_M = 1.4  # half the width over which the machine's roll follows the terrain
_STOP_S = (1.0, 4.0)  # range of the duration of a stop
_SLEW_PERIOD_S = (6.0, 20.0)  # range of the period of the crane's slewing
_SWAY_HZ = (0.4, 1.8)  # range of the frequency of pitch and roll
_MARGIN_S = 2.0  # simulated before and after the drive, against effects of the smoothing


@dataclass(frozen=True)
class Drive:
    """Camera motion of a drive, sampled at IMU_HZ from the time of the first frame on.

    Attributes:
        rate_hz: Frame rate.
        origin_m: (n, 3) camera positions in the world, m.
        rotation: (n, 3, 3) camera axes in the world; the rows are right, down and forward.
        gyro_rad_per_s: (n, 3) turn rates in camera axes, as an ideal IMU measures them.
        accel_m_per_s2: (n, 3) specific force in camera axes, as an ideal IMU measures it: at rest
            it is 9.81 m/s² upwards.
        poses: Pose of each frame.
        settings: The camera.
    """

    rate_hz: float
    origin_m: Float
    rotation: Float
    gyro_rad_per_s: Float
    accel_m_per_s2: Float
    poses: list[Pose]
    settings: CameraSettings

    def time_s(self, number: int) -> float:
        """Time of a frame since the first frame, s: that of the IMU sample whose pose it has."""
        return self.sample(number) / IMU_HZ

    def sample(self, number: int) -> int:
        """Index of the IMU sample of a frame: the nearest one at the frame rate."""
        return round(number / self.rate_hz * IMU_HZ)

    def view(self, number: int) -> View:
        """The view of a frame."""
        index = self.sample(number)
        return View(
            self.settings.intrinsics, self.origin_m[index], self.rotation[index], self.poses[number]
        )


def make_drive(
    rng: np.random.Generator,
    settings: DriveSettings,
    camera: CameraSettings,
    terrain: Terrain,
    circuit: Circuit,
    frames: int,
) -> Drive:
    """Simulate a drive around a closed path.

    Args:
        rng: Source of random numbers.
        settings: Frame rate, speed, stops, sway and slewing of the crane.
        camera: Intrinsics and mounting of the camera.
        terrain: The ground.
        circuit: The closed path.
        frames: Number of frames.
    """
    margin = round(_MARGIN_S * IMU_HZ)
    count = round((frames - 1) / settings.rate_hz * IMU_HZ) + 1 + 2 * margin
    time_s = np.arange(count) / IMU_HZ
    path_m = rng.uniform(0, circuit.length_m) + np.cumsum(_speed(rng, settings, count)) / IMU_HZ
    position = np.stack([_smooth(column, 0.3) for column in circuit.points_at(path_m).T], -1)
    ahead = circuit.points_at(path_m + 0.5) - circuit.points_at(path_m - 0.5)
    heading = _smooth(np.unwrap(np.arctan2(ahead[:, 1], ahead[:, 0])), 0.5)
    ranges = camera.mast
    height_m = terrain.height_m(*position.T) + rng.uniform(*ranges.height_m)
    side = _TRACK_M * np.stack([-np.sin(heading), np.cos(heading)], -1)
    front = 1.5 * np.stack([np.cos(heading), np.sin(heading)], -1)
    climb = terrain.height_m(*(position + front).T) - terrain.height_m(*(position - front).T)
    tilt = terrain.height_m(*(position + side).T) - terrain.height_m(*(position - side).T)
    sway_deg = rng.uniform(*settings.sway_deg)
    slew_deg = rng.uniform(*settings.slew_deg)
    yaw_deg = np.degrees(heading) + slew_deg * _wave(rng, time_s, 1 / rng.uniform(*_SLEW_PERIOD_S))
    slew_rad = np.radians(yaw_deg) - heading
    climb_rad, tilt_rad = np.arctan2(climb, 3.0), np.arctan2(tilt, 2 * _TRACK_M)
    pitch = climb_rad * np.cos(slew_rad) - tilt_rad * np.sin(slew_rad)
    roll = tilt_rad * np.cos(slew_rad) + climb_rad * np.sin(slew_rad)
    pitch_deg = rng.uniform(*ranges.pitch_deg) + 0.5 * np.degrees(_smooth(pitch, _WHEELBASE_S))
    roll_deg = 0.5 * np.degrees(_smooth(roll, _WHEELBASE_S))
    pitch_deg = pitch_deg + sway_deg * _wave(rng, time_s, rng.uniform(*_SWAY_HZ))
    roll_deg = roll_deg + sway_deg * _wave(rng, time_s, rng.uniform(*_SWAY_HZ))
    origin = np.column_stack([position, _smooth(height_m, _WHEELBASE_S)])
    rotation = _rotations(camera, yaw_deg, pitch_deg, roll_deg)
    gyro, accel = _imu(origin, rotation)
    kept = slice(margin, count - margin)
    poses = [
        Pose(
            "drive",
            float(origin[n, 2] - terrain.height_m(*position[n])),
            float(pitch_deg[n]),
            float(roll_deg[n]),
            float(yaw_deg[n] % 360),
        )
        for n in (margin + round(k / settings.rate_hz * IMU_HZ) for k in range(frames))
    ]
    return Drive(
        settings.rate_hz, origin[kept], rotation[kept], gyro[kept], accel[kept], poses, camera
    )


def _speed(rng: np.random.Generator, settings: DriveSettings, count: int) -> Float:
    """(n,) speed with stops, m/s."""
    speed = np.full(count, rng.uniform(*settings.speed_m_per_s))
    for _ in range(rng.poisson(settings.stops_per_minute * count / IMU_HZ / 60)):
        start = int(rng.integers(count))
        speed[start : start + round(rng.uniform(*_STOP_S) * IMU_HZ)] = 0
    return _smooth(speed, 0.4)


def _wave(rng: np.random.Generator, time_s: Float, hertz: float) -> Float:
    """(n,) irregular oscillation with amplitude at most 1: the mean of three sine waves."""
    total = np.zeros_like(time_s)
    for factor in (1.0, 1.37, 0.61):
        total += np.sin(2 * np.pi * hertz * factor * time_s + rng.uniform(0, 2 * np.pi))
    return total / 3


def _smooth(values: Float, deviation_s: float) -> Float:
    """Smooth values over time by a Gaussian with a standard deviation of `deviation_s`."""
    reach = round(3 * deviation_s * IMU_HZ)
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / (deviation_s * IMU_HZ)) ** 2)
    padded = np.pad(values, reach, "reflect", reflect_type="odd")
    return np.convolve(padded, weights / weights.sum(), "valid")


def _rotations(camera: CameraSettings, yaw: Float, pitch: Float, roll: Float) -> Float:
    origin = np.zeros(3)
    return np.stack(
        [
            look_from(
                camera.intrinsics, origin, Pose("drive", 0.0, float(p), float(r), float(y))
            ).rotation
            for y, p, r in zip(yaw, pitch, roll, strict=True)
        ]
    )


def _imu(origin_m: Float, rotation: Float) -> tuple[Float, Float]:
    """Turn rates and specific force in camera axes, by central differences."""
    step = np.gradient(rotation, 1 / IMU_HZ, axis=0)
    skew = -step @ rotation.transpose(0, 2, 1)
    gyro = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], -1)
    velocity = np.gradient(origin_m, 1 / IMU_HZ, axis=0)
    force = np.gradient(velocity, 1 / IMU_HZ, axis=0) + GRAVITY_M_PER_S2 * UP
    return gyro, np.einsum("nij,nj->ni", rotation, force)
