"""Detections as COCO JSON for labelling tools, so that people only have to correct them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from basetree.arrays import Bool, Float
from calib.masks import encode_rle, mask_polygons
from calib.pixels import image_to_opencv

_LABELLED = 2  # COCO's visibility flag: labelled and visible
_CATEGORY_ID = 1


@dataclass
class CocoLabels:
    """Builds a COCO data set of one category from detections.

    Call `add_image` for each image, then `add` for each object in it.

    Attributes:
        category: Name of the category.
        keypoint_names: Names of the category's keypoints, in order.
        skeleton: Pairs of keypoint indices, from 0, to be joined by lines. COCO's begin with 1.
        description: Description of the data set.
        runs: Whether masks are written as exact COCO run lengths. The default is polygons, which
            more tools can edit.
    """

    category: str
    keypoint_names: tuple[str, ...] = ()
    skeleton: tuple[tuple[int, int], ...] = ()
    description: str = ""
    runs: bool = False
    _images: list[dict[str, Any]] = field(default_factory=list, init=False)
    _annotations: list[dict[str, Any]] = field(default_factory=list, init=False)

    def add_image(self, file_name: str, width_px: int, height_px: int) -> None:
        """Start a new image; objects added from now on belong to it."""
        number = len(self._images) + 1
        self._images.append(
            {"id": number, "file_name": file_name, "width": width_px, "height": height_px}
        )

    def add(
        self,
        box_px: Float,
        score: float,
        mask: Bool | None = None,
        keypoints_px: Float | None = None,
    ) -> None:
        """Add an object to the current image.

        In the file, keypoints are pixel indices as in COCO. Keypoints outside the image are not
        labelled.

        Args:
            box_px: (4,) x0, y0, x1, y1 in continuous px.
            score: Detection score, 0 to 1.
            mask: (H, W) bool of the image's size. If it is empty, the box is used as the mask.
            keypoints_px: (K, 2 or more) continuous px; columns after x and y are ignored.
        """
        image = self._images[-1]
        x0, y0, x1, y1 = (round(float(value), 2) for value in box_px)
        annotation: dict[str, Any] = {
            "id": len(self._annotations) + 1,
            "image_id": image["id"],
            "category_id": _CATEGORY_ID,
            "bbox": [x0, y0, round(x1 - x0, 2), round(y1 - y0, 2)],
            "area": round((x1 - x0) * (y1 - y0), 2),
            "iscrowd": 0,
            "score": round(float(score), 4),
            "segmentation": [],
        }
        if mask is not None:
            mask = mask if mask.any() else _box_mask(box_px, mask.shape)
            annotation["area"] = int(mask.sum())
            annotation["segmentation"] = encode_rle(mask) if self.runs else mask_polygons(mask)
        if keypoints_px is not None:
            points = [self._keypoint(point, image) for point in keypoints_px]
            annotation["keypoints"] = [value for point in points for value in point]
            annotation["num_keypoints"] = sum(point[2] > 0 for point in points)
        self._annotations.append(annotation)

    def _keypoint(self, point: Float, image: dict[str, Any]) -> list[float]:
        x, y = float(point[0]), float(point[1])
        if not (0 <= x < image["width"] and 0 <= y < image["height"]):
            return [0, 0, 0]
        on_disk = image_to_opencv(np.array([x, y]))
        return [*(round(float(value), 2) for value in on_disk), _LABELLED]

    def to_dict(self) -> dict[str, Any]:
        """Return the data set as JSON-ready values."""
        category: dict[str, Any] = {"id": _CATEGORY_ID, "name": self.category, "supercategory": ""}
        if self.keypoint_names:
            category["keypoints"] = list(self.keypoint_names)
            category["skeleton"] = [[first + 1, second + 1] for first, second in self.skeleton]
        return {
            "info": {"description": self.description},
            "licenses": [],
            "images": self._images,
            "annotations": self._annotations,
            "categories": [category],
        }


def _box_mask(box_px: Float, shape: tuple[int, ...]) -> Bool:
    """Return the (H, W) mask of all pixels that a box touches."""
    mask = np.zeros(shape, np.bool_)
    (x0, y0), (x1, y1) = np.floor(box_px[:2]).astype(int), np.ceil(box_px[2:]).astype(int)
    mask[max(y0, 0) : y1, max(x0, 0) : x1] = True
    return mask
