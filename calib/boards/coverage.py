"""Coverage of the image by the views of a board."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from basetree.arrays import Float

_CELLS: Final = 12
_MIN_CELLS: Final = 3
_MIN_REGION_SHARE = 1 / 3
_REGIONS: Final = (
    ("top left corner", "top edge", "top right corner"),
    ("left edge", "middle", "right edge"),
    ("bottom left corner", "bottom edge", "bottom right corner"),
)


@dataclass(frozen=True)
class Coverage:
    """Number of views in each cell of a grid over the image.

    Attributes:
        views_per_cell: Rows of roughly square cells, each the number of views that cover it.
    """

    views_per_cell: tuple[tuple[int, ...], ...]

    @property
    def share(self) -> float:
        """Share of the cells that at least one view covers, 0 to 1."""
        return float((np.array(self.views_per_cell) > 0).mean())

    def text(self) -> list[str]:
        """Return a line for each row of cells: one digit per cell, "." for 0, "9" for 9 or more."""
        return [
            "".join(str(min(views, 9)) if views else "." for views in row)
            for row in self.views_per_cell
        ]

    def advice(self) -> list[str]:
        """Return advice for each ninth of the image that few views cover."""
        covered = np.array(self.views_per_cell) > 0
        lines = []
        for names, band in zip(_REGIONS, np.array_split(covered, 3, axis=0), strict=True):
            for name, part in zip(names, np.array_split(band, 3, axis=1), strict=True):
                if part.mean() < _MIN_REGION_SHARE:
                    points = "few points" if part.any() else "no points"
                    lines.append(f"the {name} has {points}: hold the board there")
        return lines


def coverage_of(views_px: Sequence[Float], size: tuple[int, int]) -> Coverage:
    """Compute the coverage of an image.

    A view covers the cells that contain one of its points or whose centre lies in the points'
    convex hull.

    Args:
        views_px: (N, 2) continuous px of the points of each view.
        size: Width and height of the image in px.
    """
    width, height = size
    cell_px = max(size) / _CELLS
    columns, rows = (max(_MIN_CELLS, round(side / cell_px)) for side in size)
    counts = np.zeros((rows, columns), int)
    centres = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), -1) + 0.5
    for points_px in views_px:
        cells = np.asarray(points_px) * (columns / width, rows / height)
        hull = cv2.convexHull(cells.astype(np.float32))
        inside = [
            cv2.pointPolygonTest(hull, (float(x), float(y)), False) >= 0
            for x, y in centres.reshape(-1, 2)
        ]
        covered = np.array(inside).reshape(rows, columns)
        column, row = np.floor(cells).astype(int).T
        within = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
        covered[row[within], column[within]] = True
        counts += covered
    return Coverage(tuple(tuple(int(n) for n in row) for row in counts))
