"""Which parts of the picture the views of a board reach."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.floating[Any]]

_CELLS: Final = 12
_LEAST_CELLS: Final = 3
_WELL_COVERED = 1 / 3
_REGIONS: Final = (
    ("top left corner", "top edge", "top right corner"),
    ("left edge", "middle", "right edge"),
    ("bottom left corner", "bottom edge", "bottom right corner"),
)


@dataclass(frozen=True)
class Coverage:
    """``views_per_cell``: rows of about square cells, each with the number of views in it."""

    views_per_cell: tuple[tuple[int, ...], ...]

    @property
    def share(self) -> float:
        """Cells that some view reaches, of all."""
        return float((np.array(self.views_per_cell) > 0).mean())

    def text(self) -> list[str]:
        """A line for every row of cells: a digit each, a dot for none, 9 for nine or more."""
        return [
            "".join(str(min(views, 9)) if views else "." for views in row)
            for row in self.views_per_cell
        ]

    def advice(self) -> list[str]:
        """What to do about each ninth of the picture that lacks views."""
        reached = np.array(self.views_per_cell) > 0
        lines = []
        for names, band in zip(_REGIONS, np.array_split(reached, 3, axis=0), strict=True):
            for name, part in zip(names, np.array_split(band, 3, axis=1), strict=True):
                if part.mean() < _WELL_COVERED:
                    points = "few points" if part.any() else "no points"
                    lines.append(f"the {name} has {points}: hold the board there")
        return lines


def coverage_of(views_px: Sequence[Float], size: tuple[int, int]) -> Coverage:
    """The coverage of an image of ``size`` (width, height) by the (N, 2) corner-based points of
    each view. A view reaches the cells that have one of its points, or their centre among them.
    """
    width, height = size
    cell_px = max(size) / _CELLS
    columns, rows = (max(_LEAST_CELLS, round(side / cell_px)) for side in size)
    counts = np.zeros((rows, columns), int)
    centres = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), -1) + 0.5
    for points_px in views_px:
        cells = np.asarray(points_px) * (columns / width, rows / height)
        hull = cv2.convexHull(cells.astype(np.float32))
        inside = [
            cv2.pointPolygonTest(hull, (float(x), float(y)), False) >= 0
            for x, y in centres.reshape(-1, 2)
        ]
        reached = np.array(inside).reshape(rows, columns)
        column, row = np.floor(cells).astype(int).T
        within = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
        reached[row[within], column[within]] = True
        counts += reached
    return Coverage(tuple(tuple(int(n) for n in row) for row in counts))
