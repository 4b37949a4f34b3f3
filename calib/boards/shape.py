"""Shape of a printed board that is not quite flat or not quite square.

Paper stretches as it is printed, and boards bend. Both give the same pattern of residuals on the
board in all views, so that they are estimated together with the camera, as released targets are
(Strobl and Hirzinger, ICCV Workshops, 2011). Here the shape is a polynomial with a normal prior
about the flat board: a few smooth terms, which many or few views determine.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from basetree.arrays import Float

_BENDS: Final = ((2, 0), (1, 1), (0, 2), (3, 0), (2, 1), (1, 2), (0, 3))
# Standard deviations of the prior: heights as shares of half the board's diagonal (2 mm of a board
# of 25 cm), and the share of a stretch. Chosen wide: most views know the shape ten times better.
_BEND_STD, _STRETCH_STD = 0.015, 0.01
# A shape is told beyond 4 standard deviations and from these sizes on.
_MOST_STDS: Final = 4.0
_LEAST_BEND_M, _LEAST_STRETCH = 2e-4, 1e-3
COUNT: Final = len(_BENDS) + 2
"""Number of terms of a shape."""
PRIOR_STDS: Final = np.array([_BEND_STD] * len(_BENDS) + [_STRETCH_STD] * 2)


@dataclass(frozen=True, eq=False)
class BoardFrame:
    """Place and size of the flat board, on which shapes are defined.

    Attributes:
        points_m: (N, 3) metres on the board of all its points that were seen.
    """

    points_m: Float

    @property
    def centre_m(self) -> Float:
        """(3,) middle of the points' extent in metres."""
        return np.asarray((self.points_m.min(0) + self.points_m.max(0)) / 2)

    @property
    def half_m(self) -> float:
        """Half the diagonal of the points' extent in metres."""
        return float(np.linalg.norm(np.ptp(self.points_m, axis=0)) / 2)

    def basis_m(self, object_m: Float) -> Float:
        """Return how (N, 3) metres on the flat board move by each term of a shape.

        The terms neither shift nor turn the board as a whole, and keep its mean size.

        Returns:
            (N, 3, K) metres per unit: heights of second and third degree, stretch of x against y,
            and skew.
        """
        seen = (self.points_m - self.centre_m) / self.half_m
        at = (object_m - self.centre_m) / self.half_m
        basis = np.zeros((len(at), 3, COUNT))
        level = np.column_stack([np.ones(len(seen)), seen[:, :2]])
        for i, (p, q) in enumerate(_BENDS):
            plane = np.linalg.lstsq(level, seen[:, 0] ** p * seen[:, 1] ** q)[0]
            flat = plane[0] + at[:, :2] @ plane[1:]
            basis[:, 2, i] = at[:, 0] ** p * at[:, 1] ** q - flat
        basis[:, 0, -2], basis[:, 1, -2] = at[:, 0] / 2, -at[:, 1] / 2
        basis[:, 0, -1], basis[:, 1, -1] = at[:, 1] / 2, at[:, 0] / 2
        return basis * self.half_m


def frame_of(points_m: Sequence[Float]) -> BoardFrame:
    """Return the frame of a board from the (N, 3) metres of its points in each view."""
    return BoardFrame(np.unique(np.concatenate(points_m).round(9), axis=0))


def tell_shape(frame: BoardFrame, shape: Float, covariance: Float) -> list[str]:
    """Tell in words how the board differs from a flat and square one.

    Args:
        frame: The board.
        shape: (K,) terms of its shape.
        covariance: (K, K) of their errors.

    Returns:
        A line for a bend and one for a stretch, of those beyond 4 standard deviations.
    """
    lines = []
    heights = frame.basis_m(frame.points_m)[:, 2, : len(_BENDS)]
    bends, spread = shape[: len(_BENDS)], covariance[: len(_BENDS), : len(_BENDS)]
    height_m = heights @ bends
    stds_m = np.sqrt(np.maximum(np.einsum("ni,ij,nj->n", heights, spread, heights), 0))
    size_m = float(np.ptp(height_m))
    sure = (np.abs(height_m) > _MOST_STDS * stds_m).any()
    if sure and size_m > _LEAST_BEND_M:
        lines.append(
            f"the board is bent by {1000 * size_m:.1f} mm over {2000 * frame.half_m:.0f} mm, which"
            " was taken into account: fix it to a flat plate"
        )
    stds = np.sqrt(np.maximum(np.diag(covariance)[-2:], 0))
    for value, std, what in zip(
        shape[-2:], stds, ("stretched along its rows", "skewed"), strict=True
    ):
        if abs(value) > max(_MOST_STDS * std, _LEAST_STRETCH):
            lines.append(
                f"the print is {what} by {value:+.1%} ± {std:.1%}, which was taken into account:"
                " measure its squares both ways"
            )
    return lines
