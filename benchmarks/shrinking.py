"""Time to shrink images to a model's input by `calib.shrinking`, compared with OpenCV.

python -m benchmarks.shrinking --result benchmarks/results/shrinking.json

Each case is a frame of random pixels and a smaller size of the same shape, with one and two threads
of OpenCV. It tells up to how many rows of a block, and for how many values at once, the matrix
product is faster. Times are medians, taken in turn.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Iterator
from functools import partial
from unittest.mock import patch

import cv2
import numpy as np

from benchmarks.tools.program import finish, machine, program
from benchmarks.tools.timing import in_turn
from calib import shrinking

CASES = (
    ((1280, 720), (800, 450)),
    ((1920, 1080), (800, 450)),
    ((848, 480), (800, 453)),
    ((848, 480), (636, 360)),
    ((1280, 800), (768, 480)),
    ((1024, 768), (640, 480)),
    ((1280, 960), (624, 468)),
    ((1280, 800), (736, 460)),
    ((1280, 1024), (600, 480)),
)
AT_ONCE = (2**17, 2**19, 2**21)


def shrink(image: np.ndarray, size: tuple[int, int], at_once: int, _: int = 0) -> np.ndarray:
    """Shrink by the matrix product, whatever the number of rows of a block."""
    with patch.multiple(shrinking, _MOST_ROWS=len(image), _AT_ONCE=at_once):
        return shrinking.shrink(image, *size)


def measure(image: np.ndarray, size: tuple[int, int], rounds: int) -> dict[str, object]:
    """Time OpenCV and the product on an image; threads are those that OpenCV has.

    Args:
        image: (H, W) or (H, W, 3) uint8.
        size: Width and height of the result in px.
        rounds: Rounds that count.
    """
    ways: dict[str, Callable[[int], np.ndarray]] = {
        f"at_once_{values}_ms": partial(shrink, image, size, values) for values in AT_ONCE
    }
    ways["opencv_ms"] = lambda _: cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    times = in_turn(ways, rounds, warm_up=3)
    off = np.abs(shrink(image, size, AT_ONCE[0]).astype(int) - ways["opencv_ms"](0))
    height, width, *colours = image.shape
    return {
        "case": f"{width}x{height} to {size[0]}x{size[1]}",
        "channels": colours[0] if colours else 1,
        "threads": cv2.getNumThreads(),
        "rows_of_a_block": height // math.gcd(height, size[1]),
        **{name: round(statistics.median(each), 2) for name, each in times.items()},
        "most_levels_off": int(off.max()),
        "share_of_pixels_off": round(float((off > 0).mean()), 5),
    }


def measure_all(rounds: int) -> Iterator[dict[str, object]]:
    """Time all cases, with one thread of OpenCV and with two."""
    rng = np.random.default_rng(0)
    for threads in (1, 2):
        cv2.setNumThreads(threads)
        for (width, height), size in CASES:
            for shape in ((height, width), (height, width, 3)):
                yield measure(rng.integers(0, 256, shape, np.uint8), size, rounds)


def main() -> None:
    """Measure all cases."""
    parser = program(__doc__)
    parser.add_argument("--rounds", type=int, default=40)
    arguments = parser.parse_args()
    result = {
        "machine": machine(),
        "numpy": np.__version__,
        "opencv": cv2.__version__,
        "cases": list(measure_all(arguments.rounds)),
    }
    finish(result, arguments.result)


if __name__ == "__main__":
    main()
