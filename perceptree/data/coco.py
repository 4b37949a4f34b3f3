"""What a dataset says of frames and trees, as records."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray
from pycocotools import mask as coco_mask

from perceptree.errors import DatasetError

Float = NDArray[np.floating[Any]]

SPLITS = ("train", "val", "test")
KEYPOINTS = 5


@dataclass(frozen=True, eq=False, slots=True)
class TreeRecord:
    """One labelled tree, in source px with (0, 0) at the outer corner of the first pixel.

    ``box_px`` (4,) xyxy; ``keypoints`` (5, 3) x, y, flag, zeros where there is no label;
    ``segmentation`` as COCO has it, None in a set without masks; ``truth`` the metric truth that
    the file gives, by field name; ``species`` where the file names it.
    """

    number: int
    box_px: Float
    keypoints: Float
    segmentation: Any
    crowd: bool
    truth: dict[str, float]
    species: str | None = None


@dataclass(frozen=True, eq=False, slots=True)
class FrameRecord:
    """One frame: where its files are, its size in px and its trees.

    ``extra`` holds what the file gives of camera, up_camera, depth_encoding and scene.
    """

    image_id: int
    image_path: Path
    depth_path: Path | None
    depth8_path: Path | None
    width: int
    height: int
    extra: dict[str, Any]
    trees: tuple[TreeRecord, ...]

    def mask(self, tree: TreeRecord) -> NDArray[np.bool_]:
        """(H, W) bool visible pixels of a tree, from RLE or polygons.

        Raises DatasetError for a tree without a mask, and for runs that do not fill the frame.
        """
        segmentation = tree.segmentation
        if segmentation is None:
            raise DatasetError(f"{self.image_path}: annotation {tree.number} has no mask")
        try:
            if isinstance(segmentation, list):
                parts = coco_mask.frPyObjects(segmentation, self.height, self.width)
                segmentation = coco_mask.merge(parts)
            elif isinstance(segmentation["counts"], list):
                segmentation = coco_mask.frPyObjects(segmentation, self.height, self.width)
            pixels = np.asarray(coco_mask.decode(segmentation))
        except (ValueError, TypeError, OverflowError) as error:
            self._refuse_runs(tree, error)
        # Runs that end early leave memory as it was, which is no mask.
        if pixels.sum(dtype=np.int64) != coco_mask.area(segmentation):
            self._refuse_runs(tree, None)
        return pixels.astype(bool)

    def _refuse_runs(self, tree: TreeRecord, cause: Exception | None) -> NoReturn:
        raise DatasetError(
            f"{self.image_path}: the segmentation of annotation {tree.number} is broken:"
            f" expected runs that fill {self.width}x{self.height} px"
        ) from cause
