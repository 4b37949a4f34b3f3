"""Records of labelled frames and trees."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from pycocotools import mask as coco_mask

from basetree.arrays import Bool, Float
from perceptree.errors import DatasetError

SPLITS = ("train", "val", "test")


@dataclass(frozen=True, eq=False, slots=True)
class TreeRecord:
    """One labelled tree. Coordinates are continuous px of the source image.

    Attributes:
        number: Annotation id.
        box_px: (4,) x0, y0, x1, y1.
        keypoints: (5, 3) x, y, COCO visibility flag; zeros where there is no label.
        segmentation: COCO polygons or run lengths; None without a mask.
        crowd: Whether the annotation is a group of trees (COCO's iscrowd).
        truth: Metric ground truth by field name, as far as the file has it.
        species: Species, if the file names it.
        marked: Whether the annotation says `ignore`.
        far: Whether the tree is farther away than labels are certain (`--certain`).
        extra: Further fields of a simulated tree as they stand in the file, for its copies.
    """

    number: int
    box_px: Float
    keypoints: Float
    segmentation: Any
    crowd: bool
    truth: dict[str, float]
    species: str | None = None
    marked: bool = False
    far: bool = False
    extra: dict[str, Any] = field(default_factory=dict)

    @property
    def ignored(self) -> bool:
        """Whether the tree counts neither as found nor as missed, nor as background."""
        return self.crowd or self.marked or self.far


@dataclass(frozen=True, eq=False, slots=True)
class FrameRecord:
    """One labelled frame.

    Attributes:
        image_id: Image id in the label file.
        image_path: Colour image.
        depth_path: 16-bit depth image, if any.
        depth8_path: 8-bit depth image, if any.
        width: Image width in px.
        height: Image height in px.
        extra: The fields camera, up_camera, depth_encoding and scene, and those of the simulator
            that copies of the dataset keep, as far as the file has them.
        trees: Labelled trees.
        exact_path: 16-bit exact depth of a simulated frame, if any.
        exact_stride_px: Its file holds every n-th pixel of every n-th row; this is n.
    """

    image_id: int
    image_path: Path
    depth_path: Path | None
    depth8_path: Path | None
    width: int
    height: int
    extra: dict[str, Any]
    trees: tuple[TreeRecord, ...]
    exact_path: Path | None = None
    exact_stride_px: int = 1

    @property
    def has_depth(self) -> bool:
        """Whether there is a depth image of any kind."""
        return any((self.depth_path, self.depth8_path, self.exact_path))

    def reads_exact(self, modality: str) -> bool:
        """Whether a model of `modality` reads the exact depth; see `with_exact_depth`."""
        exact = self.exact_path
        return modality == "depth" and exact is not None and self.depth8_path == exact

    def mask(self, tree: TreeRecord) -> Bool:
        """Decode a tree's mask from polygons or run lengths.

        Returns:
            (H, W) bool, the tree's visible pixels.

        Raises:
            DatasetError: If the tree has no mask, or its run lengths do not fill the frame.
        """
        segmentation = tree.segmentation
        if segmentation is None:
            raise DatasetError(
                f"{self.image_path}: annotation {tree.number} has no mask, expected one"
            )
        try:
            if isinstance(segmentation, list):
                parts = coco_mask.frPyObjects(segmentation, self.height, self.width)
                segmentation = coco_mask.merge(parts)
            elif isinstance(segmentation["counts"], list):
                segmentation = coco_mask.frPyObjects(segmentation, self.height, self.width)
            pixels = np.asarray(coco_mask.decode(segmentation))
        except (ValueError, TypeError, OverflowError) as error:
            self._refuse_runs(tree, error)
        # If the runs end early, the decoder leaves the rest uninitialised.
        if pixels.sum(dtype=np.int64) != coco_mask.area(segmentation):
            self._refuse_runs(tree, None)
        return pixels.astype(bool)

    def _refuse_runs(self, tree: TreeRecord, cause: Exception | None) -> NoReturn:
        raise DatasetError(
            f"{self.image_path}: the segmentation of annotation {tree.number} is broken:"
            f" expected runs that fill {self.width}x{self.height} px"
        ) from cause
