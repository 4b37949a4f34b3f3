"""Simulated frames with the true values of their trees, to fit and test the stated errors on."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from pycocotools import mask as coco_mask

from basetree.arrays import Float
from benchmarks.measure import LABELS, SIMULATED, frames, labelled
from benchmarks.measure_tables import TRUTHS
from calib import PinholeCamera, read_depth
from edgetree import TreeDetections, TreeDetector
from edgetree.demo.matching import match_boxes
from edgetree.measure import EXACT_RIG, StemProfile, TreeMeasurement, measure_trees
from edgetree.measure.cut_diameter import SEEN_PART_WARNING
from perceptree.simulator import PRESETS, generate_dataset
from perceptree.simulator.scene.description import Tree, describe_scene

_VIEWS = 2
_SAME_TREE_M = 0.01
# The axis of a true stem is taken at so many heights.
_AXIS_POINTS = 100


@dataclass(frozen=True)
class Reading:
    """One measured value with its true one.

    Attributes:
        key: What was measured, the same for every value of a constant.
        error: Measured less true value.
        std: Stated standard deviation.
    """

    key: tuple[int, int]
    error: float
    std: float


@dataclass(frozen=True)
class Case:
    """One frame.

    Attributes:
        scene: Number that frames of the same scene share.
        depth_m: (H, W) noisy depth.
        image: Record of the frame.
        trees: Records of the labelled trees.
        stems: Their exact shapes.
        found: What the network detects.
    """

    scene: int
    depth_m: Float
    image: dict[str, Any]
    trees: list[dict[str, Any]]
    stems: list[Tree]
    found: TreeDetections

    @cached_property
    def truth(self) -> TreeDetections:
        """The labelled trees as detections."""
        return labelled(self.image, self.trees)

    @cached_property
    def camera_world_m(self) -> Float | None:
        """(3,) place of the camera in the world, from the trees; None for fewer than two trees."""
        if len(self.trees) < 2:
            return None
        camera, world = (
            np.array([tree[name] for tree in self.trees])
            for name in ("position_m", "position_world_m")
        )
        # The vertical counts as one more point, 10 m above the middle.
        seen = np.vstack([camera - camera.mean(0), 10 * np.array(self.image["up_camera"])])
        placed = np.vstack([world - world.mean(0), [0.0, 0.0, 10.0]])
        left, _, right = np.linalg.svd(placed.T @ seen)
        turn = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
        return np.asarray(world.mean(0) - turn @ camera.mean(0))

    def measured(
        self, source: str, settings: dict[str, Any]
    ) -> Iterator[tuple[int, TreeMeasurement]]:
        """Measure the labelled trees.

        Args:
            source: "labels" for exact keypoints and outlines, "network" for detected ones, and
                "no-vertical" for detected ones without a given vertical.
            settings: Changes of the usual settings.

        Yields:
            The number of a labelled tree, and its measurement.
        """
        camera = PinholeCamera.from_dict(self.image["camera"])
        up = None if source == "no-vertical" else self.image["up_camera"]
        if source == "labels":
            masks = [coco_mask.decode(tree["segmentation"]).astype(bool) for tree in self.trees]
            changed = replace(LABELS, **settings)
            yield from enumerate(
                measure_trees(
                    self.truth,
                    self.depth_m,
                    camera,
                    masks=masks,
                    up_camera=up,
                    settings=changed,
                    rig_uncertainty=EXACT_RIG,
                )
            )
            return
        changed = replace(SIMULATED, **settings)
        results = measure_trees(
            self.found,
            self.depth_m,
            camera,
            up_camera=up,
            settings=changed,
            rig_uncertainty=EXACT_RIG,
        )
        for match in match_boxes(self.found.boxes_px, self.truth.boxes_px):
            yield match.truth, results[match.detection]

    def readings(self, quantity: str, source: str, settings: dict[str, Any]) -> list[Reading]:
        """The measured values of a quantity, such as "dbh_m", or all diameters of "profile"."""
        return [
            reading
            for number, tree in self.measured(source, settings)
            for reading in self.of_tree(quantity, number, tree)
        ]

    def of_tree(self, quantity: str, number: int, tree: TreeMeasurement) -> list[Reading]:
        """The values of a quantity, as of `readings`, that one measurement holds."""
        value = getattr(tree, quantity)
        if not value:
            return []
        if quantity == "diameter_m" and SEEN_PART_WARNING in tree.evidence.warnings:
            # That of another height, which the labels do not hold.
            return []
        if isinstance(value, StemProfile):
            if value.heights_from != "ground":
                return []
            rows = zip(value.height_m, value.diameter_m, value.diameter_std_m, strict=True)
            result = [
                Reading(
                    (number, round(10 * height_m)),
                    float(diameter_m - self._girth_m(number, height_m)),
                    float(std_m),
                )
                for height_m, diameter_m, std_m in rows
            ]
        else:
            true = self._true_value(quantity, number, tree)
            if true is None:
                return []
            result = [Reading((number, 0), value.value - true, value.std)]
        return [each for each in result if np.isfinite(each.error)]

    def _girth_m(self, number: int, height_m: float) -> float:
        stem = self.stems[number]
        return stem.stem.girth_diameter_m(stem.uphill_m + height_m)

    def _true_value(self, quantity: str, number: int, tree: TreeMeasurement) -> float | None:
        if quantity in TRUTHS:
            return float(self.trees[number][TRUTHS[quantity]])
        if quantity == "axis_distance_m":
            return self._axis_distance_m(number)
        if quantity != "taper_cm_per_m" or not isinstance(tree.profile, StemProfile):
            return None
        if tree.profile.heights_from != "ground":
            return None
        height_m = tree.profile.height_m
        true_m = [self._girth_m(number, height) for height in height_m.tolist()]
        return float(-100 * np.polyfit(height_m, true_m, 1)[0])

    def _axis_distance_m(self, number: int) -> float | None:
        if self.camera_world_m is None:
            return None
        tree = self.stems[number]
        heights_m = np.linspace(tree.cut_z_m, tree.top_z_m, _AXIS_POINTS)
        axis_m = np.array([tree.point(height_m) for height_m in heights_m.tolist()])
        nearest = int(np.linalg.norm(axis_m - self.camera_world_m, axis=1).argmin())
        # Real axes bend: the line is that at the camera's level.
        low, high = max(nearest - 1, 0), min(nearest + 1, _AXIS_POINTS - 1)
        along = axis_m[high] - axis_m[low]
        across = np.cross(self.camera_world_m - axis_m[low], along / np.linalg.norm(along))
        return float(np.linalg.norm(across))


def make_frames(data: Path, preset: str, seed: int, count: int) -> Path:
    """The folder of a dataset; what it lacks is simulated."""
    folder = data / f"{preset}-{seed}"
    if not list(folder.glob("*_RGB.json")):  # which are written last
        settings = PRESETS[preset].settings
        if seed != PRESETS[preset].seed:
            settings = replace(settings, views_per_scene=_VIEWS)
        generate_dataset(folder, count, settings, seed, files=PRESETS[preset].files)
    return folder


def read_all(
    data: Path,
    chosen: Iterable[tuple[str, int, int]],
    detector: TreeDetector,
    most: int | None = None,
) -> list[Case]:
    """The cases of several datasets, which are simulated where they are missing.

    Args:
        data: Folder of the datasets.
        chosen: Preset, seed and number of frames of each.
        detector: What detects their trees.
        most: Largest number of frames of each.
    """
    return [
        case
        for preset, seed, count in chosen
        for case in read_cases(
            make_frames(data, preset, seed, count),
            preset,
            count if most is None else min(count, most),
            detector,
            say,
        )
    ]


def say(text: str) -> None:
    """Print a line at once."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def read_cases(
    folder: Path, preset: str, count: int, detector: TreeDetector, progress: Callable[[str], None]
) -> list[Case]:
    """The first frames of a dataset with a labelled tree.

    Raises:
        ValueError: The labels are not those that the preset gives today.
    """
    cases: list[Case] = []
    shapes: dict[int, list[Tree]] = {}
    for image, trees in frames(folder, count):
        if not trees:
            continue
        seed = int(image["scene"]["seed"])
        if seed not in shapes:
            shapes[seed] = describe_scene(PRESETS[preset].settings, seed).near_trees
        depth_m = read_depth(folder / image["depth_file"])
        stems = [_stem(tree, shapes[seed], folder) for tree in trees]
        cases.append(Case(seed, depth_m, image, trees, stems, detector.detect(depth_m)))
    progress(f"{folder}: {len(cases)} frames, {sum(len(case.trees) for case in cases)} trees")
    return cases


def _stem(tree: dict[str, Any], stems: list[Tree], folder: Path) -> Tree:
    """The exact shape of a labelled tree, by the place of its cut."""
    places = np.array([stem.point(stem.cut_z_m) for stem in stems])
    apart_m = np.linalg.norm(places - np.array(tree["position_world_m"]), axis=1)
    if apart_m.min() > _SAME_TREE_M:
        raise ValueError(f"{folder}: expected the trees that the preset gives today")
    return stems[int(apart_m.argmin())]
