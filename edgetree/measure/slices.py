"""Diameters of measured stems, weighed with circles through the slices of a cloud."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from basetree.arrays import Float
from edgetree.measure.circles import fit_circles
from edgetree.measure.constants.circles import MAX_APART_STDS
from edgetree.measure.estimates import Estimate, TreeMeasurement
from edgetree.measure.profile import StemProfile
from edgetree.measure.settings import MeasureSettings
from edgetree.measure.volume import volume_by_dbh

# Points further from the axis than this are of no stem.
_REACH_M = 1.5


def with_circles(
    trees: Sequence[TreeMeasurement], points_m: Float, settings: MeasureSettings
) -> list[TreeMeasurement]:
    """Weigh the diameters of stems with circles through the slices of a cloud.

    Each circle is a second measurement: the outline comes from a picture, the circle from the
    points around the stem. Both are weighed by their variances; where they are further apart than
    these allow, the deviation grows by Birge's ratio, and from some deviations on there is a
    warning. Errors of the rig are the same in both, and stay as they are. A diameter at the cut
    that is inferred from a section above follows that section. Where the cloud is too thin, nothing
    changes.

    Args:
        trees: Measured stems.
        points_m: (N, 3) points of the cloud in the camera's frame.
        settings: Settings of the measurement.
    """
    return [_with_circles(tree, points_m, settings) for tree in trees]


def _with_circles(
    tree: TreeMeasurement, points_m: Float, settings: MeasureSettings
) -> TreeMeasurement:
    axis = tree.axis
    if not axis:
        return tree
    from_axis = points_m - axis.point_m
    aside = from_axis - (from_axis @ axis.direction)[:, None] * axis.direction
    near_m = points_m[np.vecdot(aside, aside) < _REACH_M**2]
    evidence, warnings = tree.evidence, tree.evidence.warnings
    diameter, dbh, profile = tree.diameter_m, tree.dbh_m, tree.profile
    section = tree.section_m
    if diameter and section:
        circle = _circle(near_m, axis.point_m, axis.direction, section)
        if circle is not None:
            warnings += _warning("the section", section, circle)
            weighed = _weighed(section, circle, tree.rig_std.get("diameter_m", 0.0))
            diameter = _following(diameter, section, weighed)
            evidence = replace(
                evidence,
                method=f"{evidence.method} + circle",
                source_diameters_m={**evidence.source_diameters_m, "circle": circle.value},
                source_std_m={**evidence.source_std_m, "circle": circle.std},
            )
    if profile:
        breast_m = _middle_at(profile, settings.breast_height_m)
        circle = _circle(near_m, breast_m, axis.direction, dbh) if dbh else None
        if dbh and circle is not None:
            warnings += _warning("breast height", dbh, circle)
            dbh = _weighed(dbh, circle, tree.rig_std.get("dbh_m", 0.0))
        rig_share = tree.rig_std.get("diameter_m", 0.0) / section.value if section else 0.0
        profile = _weighed_profile(profile, near_m, axis.direction, rig_share)
    volume = tree.volume_m3
    if settings.species is not None and dbh is not tree.dbh_m:
        volume = volume_by_dbh(settings.species, dbh)
    return replace(
        tree,
        diameter_m=diameter,
        dbh_m=dbh,
        profile=profile,
        volume_m3=volume,
        evidence=replace(evidence, warnings=warnings),
    )


def _circle(points_m: Float, at_m: Float, along: Float, expected: Estimate) -> Estimate | None:
    fit = fit_circles(points_m, at_m[None], along, np.array([expected.value]))
    if not np.isfinite(fit.std_m[0]):
        return None
    return Estimate(float(fit.diameter_m[0]), float(fit.std_m[0]))


def _weighed(outline: Estimate, circle: Estimate, rig_std_m: float) -> Estimate:
    """The mean of two estimates of one diameter.

    Args:
        outline: By the outline, with the rig's errors in its deviation.
        circle: By the circle, without them.
        rig_std_m: The rig's part, which both share.
    """
    values = (*outline, *circle, rig_std_m)
    value, std = _weighed_arrays(*(np.array(each) for each in values))
    return Estimate(float(value), float(std))


def _weighed_arrays(
    first: Float, first_std: Float, second: Float, second_std: Float, shared_std: Float
) -> tuple[Float, Float]:
    """The mean weighed by variances, and its deviation by Birge's ratio.

    `shared_std` is the part of `first_std` that both share; it is added again at the end. What is
    left of `first_std` without it counts as a tenth of it at least.
    """
    own_std = np.sqrt(np.maximum(first_std**2 - shared_std**2, (0.1 * first_std) ** 2))
    weight = np.array([1 / own_std**2, 1 / second_std**2])
    total = weight.sum(0)
    apart = np.abs(first - second) / np.hypot(own_std, second_std)
    value = (weight[0] * first + weight[1] * second) / total
    return value, np.hypot(np.maximum(apart, 1.0) / np.sqrt(total), shared_std)


def _following(diameter: Estimate, section: Estimate, weighed: Estimate) -> Estimate:
    """The diameter at the cut after that of its section was weighed with a circle.

    Args:
        diameter: At the cut, inferred from the section.
        section: Of the section by the outline alone.
        weighed: Of the section by outline and circle.
    """
    growth = diameter.value / section.value
    inferred_var = max(diameter.std**2 - (growth * section.std) ** 2, 0.0)
    std = math.sqrt((growth * weighed.std) ** 2 + inferred_var)
    return Estimate(growth * weighed.value, std)


def _weighed_profile(
    profile: StemProfile, points_m: Float, along: Float, rig_share: float
) -> StemProfile:
    """A profile whose diameters are weighed with circles where there are some."""
    middles_m = profile.edges_m.mean(1)
    circles = fit_circles(points_m, middles_m, along, profile.diameter_m)
    rig_std_m = rig_share * profile.diameter_m
    given = (profile.diameter_m, profile.diameter_std_m, circles.diameter_m, circles.std_m)
    value, std = _weighed_arrays(*given, rig_std_m)
    return replace(profile, diameter_m=value, diameter_std_m=std)


def _middle_at(profile: StemProfile, height_m: float) -> Float:
    """(3,) point between the edges of a profile at a height."""
    middles_m = profile.edges_m.mean(1)
    return np.array([np.interp(height_m, profile.height_m, axis) for axis in middles_m.T])


def _warning(place: str, outline: Estimate, circle: Estimate) -> tuple[str, ...]:
    apart = abs(outline.value - circle.value) / math.hypot(outline.std, circle.std)
    if apart < MAX_APART_STDS:
        return ()
    return (
        f"the cloud's points around {place} lie on a circle of {_cm(circle)}, the outline says"
        f" {_cm(outline)}: {apart:.1f} standard deviations apart; another thing may hide an edge,"
        " or branches are in the slice",
    )


def _cm(diameter: Estimate) -> str:
    return f"{100 * diameter.value:.1f} ± {100 * diameter.std:.1f} cm"
