"""Read the depth below the lower ends of masks: ground, or a stem that goes on."""

from __future__ import annotations

import numpy as np

from basetree.arrays import Bool, Float
from calib import project_points
from edgetree.measure.base_ground import StemBases
from edgetree.measure.constants.depth import SURFACE_M, SURFACE_STDS
from edgetree.measure.constants.ground import (
    GOES_ON_MARGIN,
    GOES_ON_SHARE,
    MIN_BELOW_FOOT_SHARE,
)
from edgetree.measure.edge_lines import masked_medians
from edgetree.measure.frame import DepthFrame
from edgetree.measure.regions import SearchRegions

# The ground below the end of a mask is read at these distances, in standard deviations of that end
# but in pixels at least, and at these places across, in half widths of the stem.
_BELOW = np.linspace(2.5, 5.0, 6)
_ACROSS = np.linspace(-0.6, 0.6, 5)
# A stem that goes on is read at these parts of the way from there to the ground, and beside it.
_DOWN = np.linspace(0.1, 0.9, 9)
_BESIDE = np.array([-2.2, -1.5, 1.5, 2.2])


def below_feet(
    frame: DepthFrame,
    regions: SearchRegions,
    shift_px: Float,
    bases: StemBases,
    normals: Float,
    offsets_m: Float,
) -> tuple[Float, Float]:
    """Median heights above the ground and depths (T,) of readings just below the masks.

    Both are NaN where too few places have a reading, or the image ends.

    Args:
        frame: Depth, camera and masks.
        regions: Search regions along T stems.
        shift_px: (T,) how far the depth lies to the right of the picture.
        bases: The lower ends of the stems.
        normals: (T, 3) normals of the ground at each.
        offsets_m: (T,) heights of the camera above the ground there.
    """
    step_px = np.maximum(bases.feet_std_px, 1.0)[:, None]
    down = (_BELOW * step_px)[:, :, None, None] * regions.along[:, None, None]
    across = (_ACROSS * regions.half_px[:, None] + shift_px[:, None])[:, None, :, None]
    xy_px = bases.feet_px[:, None, None] - down + across * regions.across[:, None, None]
    count = len(step_px)
    rays, depth_m = frame.readings(np.where(np.isfinite(xy_px), xy_px, -1.0))
    depth_m = depth_m.reshape(count, -1)
    known: Bool = depth_m > 0
    falls = np.matmul(rays.reshape(count, -1, 3), normals[..., None])[..., 0]
    height_m = masked_medians(falls * depth_m + offsets_m[:, None], known)
    enough = known.mean(1) >= MIN_BELOW_FOOT_SHARE
    behind_m = masked_medians(depth_m, known)
    return np.where(enough, height_m, np.nan), np.where(enough, behind_m, np.nan)


def goes_on_below(
    frame: DepthFrame, regions: SearchRegions, shift_px: Float, bases: StemBases, down_m: Float
) -> Bool:
    """(T,) whether the depth shows stems going on below their masks, down to the ground.

    The bark is read between the end of the mask and the ground, and so is what is beside it. Plants
    before a foot are nearer than the bark or go on beside the stem.

    Args:
        frame: Depth, camera and masks.
        regions: Search regions along T stems.
        shift_px: (T,) how far the depth lies to the right of the picture.
        bases: The lower ends of the stems.
        down_m: (T, 3) way from the lowest seen point of the bark to the ground, down the axis.
    """
    bark = bases.feet[:, None] + _DOWN[:, None] * down_m[:, None]
    known = np.isfinite(bark).all(-1) & (bark[..., 2] > 0.1)
    bark = np.where(known[..., None], bark, (0.0, 0.0, 1.0))
    line_px = project_points(frame.camera, bark)[:, :, None]
    depth_m = bark[..., 2:]
    within_m = SURFACE_STDS * frame.settings.depth_stds_m(depth_m) + SURFACE_M
    shares = []
    for places in (_ACROSS, _BESIDE):
        across_px = (places * regions.half_px[:, None] + shift_px[:, None])[:, None, :, None]
        read_m = frame.depth_at(line_px + across_px * regions.across[:, None, None])
        read = (read_m > 0) & known[..., None]
        alike = read & (np.abs(read_m - depth_m) < within_m)
        shares.append(alike.sum((1, 2)) / np.maximum(read.sum((1, 2)), 1))
    bark_share, beside_share = shares
    alone = beside_share <= bark_share - GOES_ON_MARGIN
    return np.asarray((bark_share >= GOES_ON_SHARE) & alone)
