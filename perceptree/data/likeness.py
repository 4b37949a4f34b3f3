"""Compare simulated with real images by measures of colour, contrast and texture."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from basetree.arrays import Bool, Float, UInt8
from basetree.counts import counted
from basetree.files.names import IMAGE_SUFFIXES
from basetree.files.reading import read_picture
from perceptree.errors import DatasetError

_WIDTH_PX = 640
_MIN_IMAGES = 3


@dataclass(frozen=True)
class Tones:
    """Brightness and colour of an image, each (H, W).

    Attributes:
        grey: Grey levels, 0 to 255.
        chroma: Chroma, the length of (a*, b*) in CIELAB.
        green_red: a* of CIELAB.
        blue_yellow: b* of CIELAB.
    """

    grey: Float
    chroma: Float
    green_red: Float
    blue_yellow: Float


@dataclass(frozen=True)
class Measure:
    """A scalar property of an image.

    Attributes:
        name: Key in JSON.
        title: Description for people.
        of: Computes the value, a number.
    """

    name: str
    title: str
    of: Callable[[Tones], Any]


@dataclass(frozen=True)
class Difference:
    """Values of a measure for the real and the simulated images.

    Attributes:
        measure: The measure.
        real: Values of the real images.
        simulated: Values of the simulated images.
        separation: How well the measure separates the two sets, 0 (not at all) to 1 (perfectly): |2
            AUC - 1| with the area under the ROC curve.
        shift: Simulated median minus real median, in standard deviations of the real values.
    """

    measure: Measure
    real: Float
    simulated: Float
    separation: float
    shift: float


@dataclass(frozen=True)
class Comparison:
    """The result of a comparison.

    Attributes:
        differences: All measures, largest separation first.
        real: Files of the real images.
        simulated: Files of the simulated images.
    """

    differences: list[Difference]
    real: list[Path]
    simulated: list[Path]

    def to_dict(self) -> dict[str, Any]:
        """Return JSON-ready values."""
        return {
            "real": len(self.real),
            "simulated": len(self.simulated),
            "measures": {
                d.measure.name: {
                    "real": _quantiles(d.real),
                    "simulated": _quantiles(d.simulated),
                    "separation": round(d.separation, 3),
                    "shift": round(d.shift, 3),
                }
                for d in self.differences
            },
        }


def find_pictures(folder: Path, limit: int) -> list[Path]:
    """Find images in a folder and its subfolders.

    Of a simulated dataset only the colour images are taken.

    Args:
        folder: The folder.
        limit: Largest number of images; they are chosen at even steps in the order of their names.

    Raises:
        DatasetError: If the folder does not exist or has fewer than three images.
    """
    if not folder.is_dir():
        raise DatasetError(f"{folder}: no such folder, expected a folder with images")
    images = folder / "images"
    inside = images if images.is_dir() and (folder / "scenes").is_dir() else folder
    found = sorted(path for path in inside.rglob("*") if path.suffix.lower() in IMAGE_SUFFIXES)
    if len(found) < _MIN_IMAGES:
        raise DatasetError(
            f"{folder}: holds {counted(len(found), 'image')}, expected at least {_MIN_IMAGES}"
        )
    chosen = np.unique(np.linspace(0, len(found) - 1, min(limit, len(found))).round().astype(int))
    return [found[number] for number in chosen]


def read_small(path: Path) -> UInt8:
    """Read an image as BGR uint8, resized to a width of 640 px.

    Raises:
        DatasetError: If the file cannot be read.
    """
    picture = read_picture(path)
    if picture is None:
        raise DatasetError(f"{path}: not a readable image, expected one")
    image = picture.upright()
    height = round(image.shape[0] * _WIDTH_PX / image.shape[1])
    small = cv2.resize(image, (_WIDTH_PX, height), interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.uint8)


def compare_pictures(
    real: Sequence[Path],
    simulated: Sequence[Path],
    progress: Callable[[int], None] = lambda n: None,
) -> Comparison:
    """Measure all images and sort the measures by separation.

    Args:
        real: Files of the real images, at least one.
        simulated: Files of the simulated images, at least one.
        progress: Called with 1 after each image.

    Raises:
        DatasetError: If an image cannot be read.
    """
    values = []
    for paths in (real, simulated):
        rows = []
        for path in paths:
            tones = _tones(read_small(path))
            rows.append([float(measure.of(tones)) for measure in MEASURES])
            progress(1)
        values.append(np.array(rows))
    differences = [
        _difference(measure, values[0][:, number], values[1][:, number])
        for number, measure in enumerate(MEASURES)
    ]
    differences.sort(key=lambda difference: -difference.separation)
    return Comparison(differences, list(real), list(simulated))


def _difference(measure: Measure, real: Float, simulated: Float) -> Difference:
    above = (simulated[:, None] > real).mean() + 0.5 * (simulated[:, None] == real).mean()
    spread = max(float(real.std()), 1e-9)
    shift = float(np.median(simulated) - np.median(real)) / spread
    return Difference(measure, real, simulated, float(abs(2 * above - 1)), shift)


def _quantiles(values: Float) -> dict[str, float]:
    low, median, high = np.percentile(values, (5, 50, 95))
    return {
        "p5": round(float(low), 4),
        "median": round(float(median), 4),
        "p95": round(float(high), 4),
    }


def _tones(image: UInt8) -> Tones:
    lab: Any = cv2.cvtColor(image.astype(np.float32) / 255, cv2.COLOR_BGR2LAB)
    green_red, blue_yellow = lab[..., 1], lab[..., 2]
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY).astype(np.float32)
    return Tones(grey, np.hypot(green_red, blue_yellow), green_red, blue_yellow)


def _share_of_edges(tones: Tones, upright: bool) -> float:
    """Return the share of gradient energy within 15 degrees of vertical (or horizontal) edges."""
    soft = cv2.GaussianBlur(tones.grey, (0, 0), 1.0)
    across, down = cv2.Sobel(soft, cv2.CV_32F, 1, 0), cv2.Sobel(soft, cv2.CV_32F, 0, 1)
    energy = across**2 + down**2
    main = np.abs(across if upright else down)
    near = main > np.cos(np.radians(15)) * np.sqrt(energy)
    return float(energy[near].sum() / max(float(energy.sum()), 1e-9))


def _texture(tones: Tones, sigma_px: float) -> float:
    """Return the standard deviation of the detail between two blur scales, in grey levels.

    A `sigma_px` of 0 means no blur on the finer scale.
    """
    finer = cv2.GaussianBlur(tones.grey, (0, 0), sigma_px) if sigma_px else tones.grey
    return float((finer - cv2.GaussianBlur(tones.grey, (0, 0), max(2 * sigma_px, 1.0))).std())


def _above_below(tones: Tones) -> float:
    """Return the mean grey level of the upper third minus that of the lower third."""
    third = tones.grey.shape[0] // 3
    return float(tones.grey[:third].mean() - tones.grey[-third:].mean())


def _percent(pixels: Bool) -> float:
    return 100 * float(pixels.mean())


MEASURES: tuple[Measure, ...] = (
    Measure("lightness", "Lightness, mean grey level", lambda tones: tones.grey.mean()),
    Measure("contrast", "Contrast, deviation of grey", lambda tones: tones.grey.std()),
    Measure("blown", "Overexposed, % of pixels over 250", lambda tones: _percent(tones.grey > 250)),
    Measure("black", "Black, % of pixels under 8", lambda tones: _percent(tones.grey < 8)),
    Measure("sky_over_ground", "Upper third minus lower third, grey levels", _above_below),
    Measure("chroma", "Colourfulness, mean chroma", lambda tones: tones.chroma.mean()),
    Measure(
        "chroma_spread",
        "Colour variety, standard deviation of chroma",
        lambda tones: tones.chroma.std(),
    ),
    Measure("green_red", "Red against green, mean a*", lambda tones: tones.green_red.mean()),
    Measure("blue_yellow", "Yellow against blue, mean b*", lambda tones: tones.blue_yellow.mean()),
    Measure("finest", "Finest detail and noise, below 1 px", partial(_texture, sigma_px=0.0)),
    Measure("fine", "Fine texture, 1 to 2 px", partial(_texture, sigma_px=1.0)),
    Measure("medium", "Texture of 4 to 8 px", partial(_texture, sigma_px=4.0)),
    Measure("coarse", "Texture of 16 to 32 px", partial(_texture, sigma_px=16.0)),
    Measure("upright_edges", "Vertical edges, share", partial(_share_of_edges, upright=True)),
    Measure("level_edges", "Horizontal edges, share", partial(_share_of_edges, upright=False)),
)
