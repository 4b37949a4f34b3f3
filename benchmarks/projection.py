"""Time to project a million points with every lens model, compared with OpenCV.

python -m benchmarks.projection --result benchmarks/results/projection.json

Points and pixels are float64; one thread. Also measured: the rays of all pixels of a 1280x720 image
(computed once per camera and then cached), the points of a depth map of that size, and the
registration of 848x480 depth to it. Each value is the minimum of several rounds, so that other load
on the machine matters little.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np

from benchmarks.tools.program import finish, machine, program
from benchmarks.tools.timing import in_turn
from calib import (
    PinholeCamera,
    RigidTransform,
    depth_to_points,
    pixels_to_rays,
    project_points,
    register_depth,
)

TARGET_MS = 50.0
POINTS = 1_000_000
PLAIN = PinholeCamera(1280, 720, 700.0, 690.0, 640.0, 355.0)
DEPTH = PinholeCamera(848, 480, 420.0, 420.0, 424.0, 240.0)
CAMERAS = {
    "plain": PLAIN,
    "radtan 4": replace(PLAIN, distortion=(-0.3, 0.1, 1e-3, -2e-3)),
    "radtan 5": replace(PLAIN, distortion=(-0.3, 0.1, 1e-3, -2e-3, 0.01)),
    "radtan 8": replace(
        PLAIN, distortion=(0.4457, -2.5378, 8e-4, -4e-4, 1.4556, 0.3218, -2.359, 1.3833)
    ),
    "fisheye": replace(
        PLAIN, distortion=(-0.0347, -0.01, 0.0072, -0.0024), distortion_model="fisheye"
    ),
}


def fastest_ms(call: Callable[[], object], rounds: int) -> float:
    """Minimum time of several calls after a warm-up call, ms."""
    return round(min(in_turn({"call": lambda _: call()}, rounds)["call"]), 2)


def opencv_projection(camera: PinholeCamera, points_m: np.ndarray) -> Callable[[], object]:
    """OpenCV's projection of the same points."""
    matrix = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]])
    still = np.zeros(3)
    if camera.distortion_model == "fisheye":
        terms = np.array(camera.distortion)
        return lambda: cv2.fisheye.projectPoints(points_m[:, None], still, still, matrix, terms)
    terms = np.array(camera.distortion or (0.0,) * 4)
    return lambda: cv2.projectPoints(points_m, still, still, matrix, terms)


def measure(camera: PinholeCamera, points_m: np.ndarray, rounds: int) -> dict[str, float]:
    """Measure one lens model, ms."""
    rows, columns = np.mgrid[0 : camera.height, 0 : camera.width]
    xy_px = np.stack([columns, rows], -1) + 0.5
    depth_m = np.full((camera.height, camera.width), 4.0, np.float32)
    return {
        "project_ms": fastest_ms(lambda: project_points(camera, points_m), rounds),
        "opencv_project_ms": fastest_ms(opencv_projection(camera, points_m), rounds),
        "image_rays_ms": fastest_ms(lambda: pixels_to_rays(camera, xy_px), rounds),
        "depth_to_points_ms": fastest_ms(lambda: depth_to_points(camera, depth_m), rounds),
    }


def measure_registration(rounds: int) -> float:
    """Measure the registration of a slanted, noisy wall to the colour camera, ms."""
    rng = np.random.default_rng(0)
    slant = np.linspace(3, 6, DEPTH.width) + rng.normal(0, 0.005, (DEPTH.height, DEPTH.width))
    aside = RigidTransform.from_euler_deg(1, -2, 1, [0.06, 0.01, 0.0])
    colour = CAMERAS["radtan 5"]
    return fastest_ms(lambda: register_depth(slant, DEPTH, colour, aside), rounds)


def main() -> None:
    """Measure all lens models."""
    parser = program(__doc__)
    parser.add_argument("--rounds", type=int, default=15)
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    points_m = np.random.default_rng(0).uniform([-3, -2, 3], [3, 2, 9], (POINTS, 3))
    models = {name: measure(camera, points_m, arguments.rounds) for name, camera in CAMERAS.items()}
    result = {
        "machine": machine(),
        "numpy": np.__version__,
        "opencv": cv2.__version__,
        "points": POINTS,
        "image": f"{PLAIN.width}x{PLAIN.height}",
        "models": models,
        "register_depth_ms": measure_registration(arguments.rounds),
        "target_ms": TARGET_MS,
        "missed": [name for name, row in models.items() if row["project_ms"] > TARGET_MS],
    }
    finish(result, arguments.result)


if __name__ == "__main__":
    main()
