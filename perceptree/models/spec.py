"""The model spec: a validated dataclass that is stored with the weights."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, get_args

from basetree.errors import InputError
from basetree.settings import Settings, limits, names
from calib import DepthEncoding, DepthError

CLASS_NAMES = ("tree",)

MASK_CELLS = 28
HEAT_MAP_CELLS = 56

STRIDE_5 = 32

Modality = Literal["rgb", "depth", "both"]
KeypointGrid = Literal["subcell", "pixels"]

_CHANNELS = {"rgb": (3,), "depth": (1, 3), "both": (1, 3)}
_SMALLEST_PX, _LARGEST_PX = 32, 8192
_LARGEST_FLOAT = sys.float_info.max
_WIDEST_HEAD, _DEEPEST_HEAD, _MOST_ANCHORS = 4096, 64, 16
# Far above any network that is used.
_SMALLEST_ANCHOR_PX, _LARGEST_ANCHOR_PX, _STEEPEST_ANCHOR = 0.01, 65_536.0, 1000.0
_MOST_CELL_ANCHORS = 20_000_000
_LARGEST_MEAN, _STD_RANGE = 1e6, (1e-6, 1e6)
_PROPOSALS = limits(1, 100_000)
_IOU = limits(over=0, most=1)
_SCORE = limits(0, under=1, expected="within [0, 1)")
_REDUCTION = limits(1, 2)
_PLAIN_TYPES: dict[str, tuple[type, ...]] = {
    "str": (str,),
    "int": (int,),
    "bool": (bool,),
    "float": (int, float),
}


class SpecError(InputError):
    """Raised for a model spec with unknown, missing or invalid values."""


@dataclass(frozen=True)
class ModelSpec(Settings, error=SpecError):
    """Everything that is needed to build a network and to prepare its input.

    Channels are in the order of the input, BGR. Pyramid level `n` has stride `2**n`.

    Raises:
        SpecError: If a value is out of range or does not fit the others.
    """

    _before_expected = ", "

    name: str
    """Name of the model."""
    modality: Modality = field(metadata=names(_CHANNELS, "'rgb', 'depth' or 'both'"))
    """Kind of input: `rgb`, `depth` or `both`. Of `both`, what follows is that of the depth; the
    fields whose names begin with `colour` are those of the colour image."""
    height: int
    """Input height, px; the network pads to a multiple of 32 itself."""
    width: int
    """Input width, px."""
    mean: tuple[float, ...]
    """Mean of the input per channel, in 8-bit units: three values for `rgb`, one or three for
    depth. With three the depth channel is repeated, for networks trained on colour."""
    std: tuple[float, ...]
    """Standard deviation of the input per channel, in 8-bit units."""
    pad_value: int = field(metadata=limits(0, 255))
    """Value of the letterbox borders, 0 to 255."""
    anchor_sizes_px: tuple[tuple[float, ...], ...]
    """Square roots of the anchor areas, px: one or several per level."""
    depth_encoding: dict[str, float] | None = None
    """Encoding of metres as 8 bits (`calib.DepthEncoding` as a dict); None for `rgb`."""
    backbone: str = "mobilenetv4_conv_small"
    """A key of `backbones.BACKBONES`."""
    stride_in_1x1: bool = False
    """Whether a ResNet's bottlenecks have their stride in the first 1x1 convolution, not in the
    3x3 one."""
    reduction: int = field(default=1, metadata=_REDUCTION)
    """1, or 2 for a backbone that gets the means of the image's blocks of 2x2 pixels."""
    levels: tuple[int, ...] = (3, 4, 5)
    """Pyramid levels with proposals; level 6 is level 5 subsampled by 2."""
    fpn_width: int = field(default=96, metadata=limits(1, 4096))
    """Channels of the pyramid's maps."""
    fpn_norm: bool = True
    """Batch norm after each of the pyramid's convolutions, in place of a bias."""
    anchor_ratios: tuple[float, ...] = (2.0, 4.5, 10.0)
    """Height over width of the anchors."""
    anchor_offset: float = field(default=0.5, metadata=limits(0, 1))
    """Position of the anchor centres in their cell, 0 (its corner) to 1."""
    separable_proposals: bool = False
    """Whether the proposal network has a depthwise 5x5 and a 1x1 convolution in place of a 3x3 one;
    in 8 bits they take about two fifths of its time."""
    proposals_per_level: int = field(default=100, metadata=_PROPOSALS)
    """Proposals kept per level before non-maximum suppression."""
    proposals: int = field(default=100, metadata=_PROPOSALS)
    """Proposals kept per image after non-maximum suppression."""
    proposal_nms_iou: float = field(default=0.7, metadata=_IOU)
    """Overlap above which a proposal is suppressed."""
    roi_levels: tuple[int, ...] = (3,)
    """Levels that the heads pool from; with several, the size of a box decides its level."""
    roi_samples: int = field(default=2, metadata=limits(0, 64))
    """RoIAlign samples per cell and axis; 0 takes one per covered map cell."""
    box_head_width: int = field(default=256, metadata=limits(1, 16_384))
    """Width of the box head's two hidden layers."""
    mask_head_widths: tuple[int, ...] = (64, 64)
    """Channels of the mask head's 3x3 convolutions."""
    keypoint_head_widths: tuple[int, ...] = (64, 64, 64, 64)
    """Channels of the keypoint head's 3x3 convolutions."""
    masks: bool = True
    """Whether there is a mask head."""
    keypoints: bool = True
    """Whether there is a keypoint head."""
    keypoint_box_scale: float = field(default=1.25, metadata=limits(1, 100))
    """The keypoint head uses the box enlarged by this factor, so that a felling cut hidden below
    the visible stem is still inside."""
    keypoint_grid: KeypointGrid = field(
        default="subcell", metadata=names(get_args(KeypointGrid), "'subcell' or 'pixels'")
    )
    """Possible keypoint positions: `subcell` is 1/8 heat map cell refined with a parabola,
    `pixels` the centres of the box's pixels as in Detectron2."""
    detections: int = field(default=20, metadata=limits(1, 10_000))
    """Rows of every output, the maximum number of trees per image; at most as many as
    proposals."""
    score_threshold: float = field(default=0.01, metadata=_SCORE)
    """Detections with a lower score are dropped."""
    nms_iou: float = field(default=0.5, metadata=_IOU)
    """Overlap above which a detection is suppressed."""
    box_voting: bool = False
    """Whether the box of a detection is averaged over those that it suppresses, see
    `boxes.vote_boxes`."""
    mask_score_weight: float = field(default=0.0, metadata=limits(0, 10))
    """How much the certainty of its mask counts in the score of a tree, see `scores.joint_scores`;
    0 leaves the score of the box. `perceptree calibrate-scores` fits it."""
    colour_backbone: str | None = None
    """A key of `backbones.BACKBONES`, for the colour image of `both`; None for the others."""
    colour_mean: tuple[float, ...] = ()
    """Mean of the colour image per channel, three values; empty but for `both`."""
    colour_std: tuple[float, ...] = ()
    """Standard deviation of the colour image per channel, three values; empty but for `both`."""
    colour_pad_value: int = field(default=114, metadata=limits(0, 255))
    """Value of the letterbox borders of the colour image of `both`, 0 to 255."""
    colour_reduction: int = field(default=1, metadata=_REDUCTION)
    """`reduction` of the colour image of `both`; 1 for the others."""

    def __post_init__(self) -> None:
        self._check_types()
        for entry in dataclasses.fields(self):  # whole numbers of a file would become int tensors
            if str(entry.type).startswith(("float", "tuple[float", "tuple[tuple[float")):
                object.__setattr__(self, entry.name, _as_floats(getattr(self, entry.name)))
        super().__post_init__()

    def _check_together(self) -> None:
        self._check_input()
        self._check_levels()
        self._check_anchors()
        if self.detections > (most := self._most_proposals):
            self._refuse(
                f"detections is {self.detections} with {most} proposals", f"at most {most}"
            )
        if self.mask_score_weight and not self.masks:
            found = f"mask_score_weight is {self.mask_score_weight} without masks"
            self._refuse(found, "0, or masks")
        for name in ("mask_head_widths", "keypoint_head_widths"):
            widths = getattr(self, name)
            in_range = all(1 <= width <= _WIDEST_HEAD for width in widths)
            if not 1 <= len(widths) <= _DEEPEST_HEAD or not in_range:
                expected = f"1 to {_DEEPEST_HEAD} of 1 to {_WIDEST_HEAD}"
                self._refuse(f"{name} are {widths}", expected)

    def _check_types(self) -> None:
        """Check that numbers are finite numbers of the right kind, also those in tuples."""
        for entry in dataclasses.fields(self):
            kind = str(entry.type).removeprefix("tuple[").removeprefix("tuple[").split(",")[0]
            if kind not in _PLAIN_TYPES:
                continue
            value = getattr(self, entry.name)
            depth = str(entry.type).count("tuple[")
            if not all(_is(item, kind) for item in _flat(value, depth)):
                expected = f"{'tuples of ' * (depth > 0)}{kind}{', finite' * (kind == 'float')}"
                self._refuse(f"{entry.name} is {str(value)[:200]}", expected)

    def _check_input(self) -> None:
        self._check_normalisation("", _CHANNELS[self.modality])
        self._check_normalisation("colour_", (3,) if self.modality == "both" else (0,))
        if (self.modality == "both") != isinstance(self.colour_backbone, str):
            found = f"colour_backbone is {self.colour_backbone!r:.200} for {self.modality}"
            self._refuse(found, "one for both and None for rgb and depth")
        if (self.depth_encoding is None) != (self.modality == "rgb"):
            found = f"depth_encoding is {self.depth_encoding} for {self.modality}"
            self._refuse(found, "one for depth and both, and None for rgb")
        if self.depth_encoding is not None:
            try:
                DepthEncoding.from_dict(self.depth_encoding)
            except DepthError as error:
                raise SpecError(f"depth_encoding: {error}") from error
        if not all(_SMALLEST_PX <= side <= _LARGEST_PX for side in (self.height, self.width)):
            found = f"the input is {self.height}x{self.width}"
            self._refuse(found, f"{_SMALLEST_PX} to {_LARGEST_PX} px each way")

    def _check_normalisation(self, branch: str, allowed: tuple[int, ...]) -> None:
        """Check the fields `mean` and `std` of a branch, which have so many values."""
        mean, std = (getattr(self, f"{branch}{name}") for name in ("mean", "std"))
        if len(mean) not in allowed or len(std) != len(mean):
            self._refuse(
                f"{branch}mean and {branch}std have {len(mean)} and {len(std)} values",
                f"{' or '.join(map(str, allowed))} for {self.modality}",
            )
        least, most = _STD_RANGE
        if not all(least <= value <= most for value in std):
            self._refuse(f"{branch}std is {std}", f"values of {least:g} to {most:g}")
        if not all(abs(value) <= _LARGEST_MEAN for value in mean):
            self._refuse(f"{branch}mean is {mean}", f"values of at most {_LARGEST_MEAN:g}")

    def _check_levels(self) -> None:
        first = self.levels[0] if self.levels else 0
        counted = tuple(range(first, first + len(self.levels)))
        if not 2 <= first <= 6 or self.levels != counted:
            self._refuse(f"levels are {self.levels}", "consecutive levels, at least 2")
        if not 5 <= self.levels[-1] <= 6:
            self._refuse(f"levels are {self.levels}", "level 5 or 6 as the last")
        allowed = set(self.levels) - {6}
        pooled = tuple(sorted(set(self.roi_levels) & allowed))
        consecutive = bool(pooled) and pooled[-1] - pooled[0] == len(pooled) - 1
        if not consecutive or self.roi_levels != pooled:
            self._refuse(
                f"roi_levels are {self.roi_levels}",
                f"consecutive levels of {self.levels}, at most 5",
            )

    def _check_anchors(self) -> None:
        counts = {len(sizes) for sizes in self.anchor_sizes_px}
        if len(self.anchor_sizes_px) != len(self.levels) or len(counts) != 1 or 0 in counts:
            self._refuse(
                f"anchor_sizes_px are {self.anchor_sizes_px}",
                f"{len(self.levels)} groups (one per level) with the same number of sizes",
            )
        if max(counts) > _MOST_ANCHORS or len(self.anchor_ratios) > _MOST_ANCHORS:
            self._refuse(
                f"there are {max(counts)} anchor sizes and {len(self.anchor_ratios)} ratios per"
                " level",
                f"at most {_MOST_ANCHORS} each",
            )
        ratios, sizes_px = self.anchor_ratios, [s for group in self.anchor_sizes_px for s in group]
        if not ratios or not all(1 / _STEEPEST_ANCHOR <= r <= _STEEPEST_ANCHOR for r in ratios):
            expected = f"at least one, {1 / _STEEPEST_ANCHOR:g} to {_STEEPEST_ANCHOR:g}"
            self._refuse(f"anchor_ratios are {ratios}", expected)
        if not all(_SMALLEST_ANCHOR_PX <= size <= _LARGEST_ANCHOR_PX for size in sizes_px):
            expected = f"{_SMALLEST_ANCHOR_PX:g} to {_LARGEST_ANCHOR_PX:g} px"
            self._refuse(f"anchor_sizes_px are {self.anchor_sizes_px}", expected)
        cells = sum(rows * columns for rows, columns in map(self.map_size, self.levels))
        if cells * self.anchors_per_cell > _MOST_CELL_ANCHORS:
            self._refuse(
                f"an input of {self.height}x{self.width} px has {cells * self.anchors_per_cell}"
                " anchors",
                f"at most {_MOST_CELL_ANCHORS}",
            )

    @property
    def backbone_levels(self) -> tuple[int, ...]:
        """The backbone's levels that the pyramid gets, see `_levels_of`."""
        return self._levels_of(self.reduction)

    @property
    def colour_backbone_levels(self) -> tuple[int, ...]:
        """Those of the colour backbone of `both`."""
        return self._levels_of(self.colour_reduction)

    def _levels_of(self, reduction: int) -> tuple[int, ...]:
        """Levels of a backbone, counted from its own image, which is smaller by `reduction`.

        Level 6 is not among them: it is made from level 5.
        """
        finer = reduction.bit_length() - 1
        return tuple(level - finer for level in self.levels if level <= 5)

    @property
    def anchors_per_cell(self) -> int:
        """Number of anchors per cell: sizes times ratios."""
        return len(self.anchor_sizes_px[0]) * len(self.anchor_ratios)

    @property
    def _most_proposals(self) -> int:
        """Proposals kept per image; a small input may have fewer anchors."""
        cells = (rows * columns for rows, columns in map(self.map_size, self.levels))
        kept = (min(self.proposals_per_level, n * self.anchors_per_cell) for n in cells)
        return min(self.proposals, sum(kept))

    def map_size(self, level: int) -> tuple[int, int]:
        """Rows and columns of a level's map, for the input padded to a multiple of 32 px."""
        cells = (-(-side // STRIDE_5) * STRIDE_5 for side in (self.height, self.width))
        rows, columns = (-(-side // 2**level) for side in cells)
        return rows, columns

    @property
    def channels(self) -> int:
        """Input channels of `backbone`."""
        return len(self.mean)

    @property
    def image_shape(self) -> tuple[int, ...]:
        """Shape of an image as it is stored: (H, W, 3), (H, W), or (H, W, 4) of `both`.

        Of `both` the first three channels are the colour image and the last one is the depth.
        """
        channels = {"rgb": (3,), "depth": (), "both": (4,)}[self.modality]
        return (self.height, self.width, *channels)

    @property
    def pad_values(self) -> int | tuple[int, ...]:
        """Value of the letterbox borders of a stored image; of `both` that of each channel."""
        if self.modality != "both":
            return self.pad_value
        return (*(self.colour_pad_value,) * 3, self.pad_value)

    def to_dict(self) -> dict[str, Any]:
        """Convert to values that JSON can hold, without the colour fields but for `both`."""
        values = dataclasses.asdict(self)
        if self.modality == "both":
            return values
        return {name: value for name, value in values.items() if not name.startswith("colour_")}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> ModelSpec:
        """Make a spec from the result of `to_dict`, possibly read from JSON.

        Raises:
            SpecError: If fields are unknown, missing or out of range.
        """
        known = {entry.name for entry in dataclasses.fields(cls)}
        surplus = sorted(set(values) - known)
        if surplus:
            raise SpecError(f"unknown model spec fields: {', '.join(surplus)}")
        try:
            return cls(**{name: _as_tuples(value) for name, value in values.items()})
        except (TypeError, RecursionError) as error:
            raise SpecError(f"invalid model spec: {error}") from error


def _flat(value: Any, depth: int) -> list[Any]:
    """Return the items of nested tuples, in a list; None stands for what is no tuple."""
    items = [value]
    for _ in range(depth):
        items = [
            item for group in items for item in (group if isinstance(group, tuple) else (None,))
        ]
    return items


def _is(value: Any, kind: str) -> bool:
    """Return whether a value has a plain type; bools are no numbers, floats must be finite."""
    if not isinstance(value, _PLAIN_TYPES[kind]) or (isinstance(value, bool) and kind != "bool"):
        return False
    return not isinstance(value, int | float) or kind != "float" or abs(value) <= _LARGEST_FLOAT


def _as_floats(value: Any) -> Any:
    return tuple(map(_as_floats, value)) if isinstance(value, tuple) else float(value)


def _as_tuples(value: Any) -> Any:
    return tuple(_as_tuples(item) for item in value) if isinstance(value, list) else value
