"""The trees detected in one image."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from basetree.counts import counted
from basetree.errors import InputError, MissingPackage
from calib import paste_mask

if TYPE_CHECKING:
    import supervision

KEYPOINT_NAMES: Final = (
    "felling_cut",
    "diameter_left",
    "diameter_right",
    "axis_middle",
    "axis_top",
)
MASK_SIZE: Final = 28
ERROR_FACTORS: Final = (0.1, 10.0)
"""Smallest and largest `TreeDetections.error_factor`."""


@dataclass(frozen=True)
class UnlikeTraining:
    """How an image differs most from those that the model was trained on.

    Attributes:
        statistic: Name of the statistic that is far outside its usual range.
        value: Its value for this image, in `unit`.
        low: Lower end of the usual range.
        high: Upper end of it.
        words: What the statistic is.
        unit: Its unit; empty for shares from 0 to 1.
        advice: What to try: another model, a lower score threshold, fine-tuning; on one line.
    """

    statistic: str
    value: float
    low: float
    high: float
    words: str
    unit: str
    advice: str = ""

    def __str__(self) -> str:
        unit = f" {self.unit}" if self.unit else ""
        return f"{self.words} is {self.value:.3g}{unit}, usually {self.low:.3g} to {self.high:.3g}"


@dataclass(frozen=True)
class OneImage:
    """Which image a model of colour and depth used alone.

    Attributes:
        image: "colour" or "depth"; "neither" where both show nothing.
        reason: Why the other one was left out, or both.
    """

    image: str
    reason: str

    def __str__(self) -> str:
        if self.image == "neither":
            return f"neither image shows anything: {self.reason}"
        return f"found by {self.image} alone: {self.reason}"


_Index: TypeAlias = slice | NDArray[np.bool_] | NDArray[np.integer]


@dataclass(frozen=True, eq=False)
class TreeDetections:
    """The N trees detected in one image.

    Coordinates are continuous pixel coordinates: (0, 0) is the outer corner of the first pixel,
    whose centre is at (0.5, 0.5).

    Attributes:
        boxes_px: (N, 4) float32, x0, y0, x1, y1. Boxes are not clipped to the image, because the
            masks are defined relative to them.
        scores: (N,) float32, probability of being a tree, in [0, 1].
        keypoints_px: (N, 5, 3) float32, x, y, score, in the order of `KEYPOINT_NAMES`. The score is
            the maximum of the softmax over the keypoint's heat map. None if the model has no
            keypoint output.
        masks: (N, 28, 28) float32, probability on a grid over the box. None if the model has no
            mask output. `mask` resamples one of them to the image.
        image_width: Width of the image in pixels.
        image_height: Height of the image in pixels.
        unlike: How the image differs from those that the model was trained on, if it does clearly;
            None for an ordinary image, and if the model file does not say how they look.
        error_factor: Standard deviation of keypoints and mask edges, relative to those that
            `MeasureSettings` states, 0.1 to 10; as the model file says.
        by_network: Whether a network drew masks and keypoints. Its edges are all off alike where a
            camera draws edges in another way than those of its training, so `measure_trees`
            corrects them by the depth. `TreeDetector` sets it.
        alone: Which image a model of colour and depth used alone, and why; None if it used both,
            and of other models.
        keypoint_stds_px: (N, 5, 2) float32, how sure the network is of each keypoint: standard
            deviations of its heat map in x and y, 0 where it says nothing. None if the model does
            not give them.

    Raises:
        InputError: An array does not have the shape given above, contains values that are not
            finite, or a score or the error factor is out of its range.
    """

    boxes_px: NDArray[np.float32]
    scores: NDArray[np.float32]
    keypoints_px: NDArray[np.float32] | None
    masks: NDArray[np.float32] | None
    image_width: int
    image_height: int
    unlike: UnlikeTraining | None = None
    error_factor: float = 1.0
    by_network: bool = False
    alone: OneImage | None = None
    keypoint_stds_px: NDArray[np.float32] | None = None

    def __post_init__(self) -> None:
        count = len(self.scores)
        if self.image_width < 1 or self.image_height < 1:
            size = f"{self.image_width}x{self.image_height}"
            raise InputError(f"image size is {size} px: expected at least 1x1 px")
        self._keep_as_float32("boxes_px", (count, 4))
        self._keep_as_float32("scores", (count,))
        if self.keypoints_px is not None:
            self._keep_as_float32("keypoints_px", (count, len(KEYPOINT_NAMES), 3))
        if self.keypoint_stds_px is not None:
            self._keep_as_float32("keypoint_stds_px", (count, len(KEYPOINT_NAMES), 2))
        if self.masks is not None:
            self._keep_as_float32("masks", (count, MASK_SIZE, MASK_SIZE))
        if count and not (self.scores.min() >= 0 and self.scores.max() <= 1):
            span = f"{self.scores.min():g} to {self.scores.max():g}"
            raise InputError(f"scores are {span}: expected probabilities, 0 to 1")
        if not ERROR_FACTORS[0] <= self.error_factor <= ERROR_FACTORS[1]:
            expected = "{:g} to {:g}".format(*ERROR_FACTORS)
            raise InputError(f"error_factor is {self.error_factor}: expected {expected}")

    def _keep_as_float32(self, name: str, shape: tuple[int, ...]) -> None:
        array = np.asarray(getattr(self, name), dtype=np.float32)
        if array.shape != shape:
            raise InputError(
                f"{name} has shape {array.shape}: expected {shape} for {shape[0]} scores"
            )
        if not np.isfinite(array).all():
            raise InputError(f"{name} has NaN or infinite values: expected finite ones")
        object.__setattr__(self, name, array)

    def __len__(self) -> int:
        return len(self.scores)

    def __repr__(self) -> str:
        span = f", scores {self.scores.min():.2f} to {self.scores.max():.2f}" if len(self) else ""
        parts = ("keypoints", self.keypoints_px), ("masks", self.masks)
        held = " and ".join(name for name, array in parts if array is not None)
        size = f"{self.image_width}x{self.image_height} px"
        return (
            f"<TreeDetections: {counted(len(self), 'tree')} in {size}{span}, with"
            f" {held or 'boxes alone'}>"
        )

    def select(self, index: _Index) -> TreeDetections:
        """The trees selected by a slice, a (N,) bool array or an array of indices."""
        optional = (self.keypoints_px, self.masks, self.keypoint_stds_px)
        keypoints, masks, stds = (each if each is None else each[index] for each in optional)
        return replace(
            self,
            boxes_px=self.boxes_px[index],
            scores=self.scores[index],
            keypoints_px=keypoints,
            masks=masks,
            keypoint_stds_px=stds,
        )

    def above(self, score_threshold: float) -> TreeDetections:
        """The trees whose score is at least `score_threshold`."""
        return self.select(self.scores >= score_threshold)

    def mask(self, index: int) -> NDArray[np.bool_]:
        """The mask of tree `index` at the image's resolution.

        Returns:
            (image_height, image_width) bool, computed on each call.

        Raises:
            InputError: The model has no mask output.
        """
        if self.masks is None:
            raise InputError("these detections have no masks: the model has no mask output")
        return paste_mask(
            self.masks[index], self.boxes_px[index], self.image_width, self.image_height
        )

    def to_rows(self) -> list[dict[str, int | float]]:
        """One dict of plain numbers for each tree, for a table (`pandas.DataFrame(rows)`).

        Returns:
            The number of the tree from 1, `score`, `box_x0_px` to `box_y1_px`, and for each
            keypoint `NAME_x_px`, `NAME_y_px` and `NAME_score`.
        """
        rows: list[dict[str, int | float]] = []
        for index in range(len(self)):
            row: dict[str, int | float] = {"tree": index + 1, "score": float(self.scores[index])}
            for name, value in zip(("x0", "y0", "x1", "y1"), self.boxes_px[index], strict=True):
                row[f"box_{name}_px"] = float(value)
            points = () if self.keypoints_px is None else self.keypoints_px[index].tolist()
            for name, (x, y, score) in zip(KEYPOINT_NAMES, points, strict=False):
                row |= {f"{name}_x_px": x, f"{name}_y_px": y, f"{name}_score": score}
            rows.append(row)
        return rows

    def plot(self, picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Draw the trees on a copy of their picture.

        Args:
            picture: (image_height, image_width, 3) uint8 BGR.

        Returns:
            (image_height, image_width, 3) uint8 BGR.

        Raises:
            InputError: The picture has another size or type.
        """
        from edgetree.drawing import draw_trees

        expected = (self.image_height, self.image_width, 3)
        dtype = getattr(picture, "dtype", type(picture).__name__)
        if np.shape(picture) != expected or dtype != np.uint8:
            found = f"{dtype} {np.shape(picture)}"
            raise InputError(f"picture is {found}: expected uint8 {expected}")
        return draw_trees(picture, self)

    def to_supervision(self) -> supervision.Detections:
        """Hand the trees over to the package supervision, with boxes, masks, scores and names.

        Raises:
            MissingPackage: supervision is not installed.
        """
        try:
            import supervision
        except ImportError as error:
            raise MissingPackage(
                "supervision is not installed: expected it for to_supervision"
                " (pip install supervision)"
            ) from error
        masks = None if self.masks is None else [self.mask(index) for index in range(len(self))]
        empty = np.zeros((0, self.image_height, self.image_width), np.bool_)
        return supervision.Detections(
            xyxy=self.boxes_px.copy(),
            confidence=self.scores.copy(),
            class_id=np.zeros(len(self), np.int64),
            mask=None if masks is None else np.array(masks or empty, np.bool_),
            data={"class_name": np.full(len(self), "tree")},
        )
