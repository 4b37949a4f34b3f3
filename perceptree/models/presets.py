"""Named model specs: the backbones of Grondin et al. (2022), and light models for edge computers.

"The paper" here and in other modules is Grondin, Fortin, Pomerleau and Giguere (2022), "Tree
detection and diameter estimation based on deep learning".
"""

from __future__ import annotations

from typing import Any

from perceptree.models.spec import Modality, ModelSpec, SpecError

# Mean and standard deviation per channel (BGR) of ImageNet's 8-bit images.
IMAGENET_MEAN = (103.53, 116.28, 123.675)
IMAGENET_STD = (57.375, 57.12, 58.395)
UNIT_STD = (1.0, 1.0, 1.0)

LINEAR_20_M = {
    "near_m": 0.0,
    "far_m": 20.0,
    "near_value": 0,
    "far_value": 255,
    "invalid_value": 255,
}

_STRIDES = (4, 8, 16, 32, 64)
ONE_SIZE_ANCHORS_PX = tuple((8.0 * stride,) for stride in _STRIDES)
"""Layout of Detectron2 and torchvision: one size per level, 32 px at level 2 to 512 px at 6."""
NINE_ANCHORS_PX = tuple(tuple(scale * s for scale in (8.0, 16.0, 32.0)) for s in _STRIDES)
"""Layout that the paper describes: three sizes per level, nine anchors per cell."""

# Detectron2's Mask R-CNN with a keypoint head, common to all backbones.
_PAPER: dict[str, Any] = {
    "levels": (2, 3, 4, 5, 6),
    "fpn_width": 256,
    "fpn_norm": False,
    "anchor_sizes_px": ONE_SIZE_ANCHORS_PX,
    "anchor_ratios": (0.5, 1.0, 2.0),
    "anchor_offset": 0.0,
    "proposals_per_level": 1000,
    "proposals": 1000,
    "roi_levels": (2, 3, 4, 5),
    "roi_samples": 0,
    "box_head_width": 1024,
    "mask_head_widths": (256,) * 4,
    "keypoint_head_widths": (512,) * 8,
    "keypoint_box_scale": 1.0,
    "keypoint_grid": "pixels",
}

PAPER_PRESETS: dict[str, dict[str, Any]] = {
    "r50": {"backbone": "resnet50", "stride_in_1x1": True},
    "r101": {"backbone": "resnet101", "stride_in_1x1": True},
    "x101-32x8d": {"backbone": "resnext101_32x8d"},
    "x101-32x4d": {"backbone": "resnext101_32x4d"},
}

# ``edge-s`` is ``edge-n`` with a larger input, so the weights of either start the other.
# The others are on the accuracy-time front that benchmarks/detectors.py measures.
EDGE_PRESETS: dict[str, dict[str, Any]] = {
    "edge-n": {"backbone": "mobilenetv4_conv_small"},
    "edge-s": {"backbone": "mobilenetv4_conv_small", "height": 480, "width": 800},
    "edge-m": {"backbone": "resnet18"},
    "edge-l": {
        "backbone": "resnet18",
        "levels": (2, 3, 4, 5),
        "roi_levels": (2,),
        "fpn_width": 128,
    },
}

# Their backbone for colour images: its ImageNet weights come in a package, and keep a network good
# on real pictures.
_RGB_BACKBONES = {"edge-n": "efficientnet_lite0", "edge-s": "efficientnet_lite0"}

PRESETS = (*EDGE_PRESETS, *PAPER_PRESETS)

_COLOUR_PAD_VALUE = 114

# Of a network of both inputs: its colour backbone takes a sixth of the time at half the size, and
# the depth image keeps the full one.
COLOUR_REDUCTION = 2

# Default levels of a light model, and its anchor size at stride 1 for an input 640 px wide.
_LIGHT_LEVELS = (3, 4, 5)
_LIGHT_ANCHOR_PX = 5.0


def _given(value: int | None, default: int) -> int:
    return default if value is None else value


def make_spec(
    preset: str,
    modality: Modality = "rgb",
    height: int | None = None,
    width: int | None = None,
    **changes: Any,
) -> ModelSpec:
    """Make the spec of a preset.

    Args:
        preset: A name of `PRESETS`.
        modality: `rgb`, `depth` or `both`; `both` only for light models.
        height: Input height, px; by default 480 for `edge-s`, 384 for the other light models, 720
            for the paper's.
        width: Input width, px; by default 800 for `edge-s`, 640 for the other light models, 1280
            for the paper's. The anchor sizes of light models are proportional to it.
        **changes: Fields of ModelSpec that override the preset.

    Raises:
        SpecError: If the preset is unknown, or a change is no field or out of range.

    Examples:
        >>> from perceptree.models import make_spec
        >>> spec = make_spec("edge-n", "depth")
        >>> (spec.height, spec.width, spec.backbone)
        (384, 640, 'mobilenetv4_conv_small')
    """
    if modality == "both" and preset in PAPER_PRESETS:
        raise SpecError(f"model is {preset} for both: expected one of: {', '.join(EDGE_PRESETS)}")
    if preset in PAPER_PRESETS:
        values = _PAPER | PAPER_PRESETS[preset]
        height, width = _given(height, 720), _given(width, 1280)
        std = UNIT_STD if values.get("stride_in_1x1") else IMAGENET_STD
        values |= {"mean": IMAGENET_MEAN, "std": std}
    elif preset in EDGE_PRESETS:
        values = dict(EDGE_PRESETS[preset])
        if modality == "rgb":
            values["backbone"] = _RGB_BACKBONES.get(preset, values["backbone"])
        size = values.pop("height", 384), values.pop("width", 640)
        height, width = _given(height, size[0]), _given(width, size[1])
        levels = (values | changes).get("levels", _LIGHT_LEVELS)
        # One sample halves the time of pooling, and costs no accuracy once trained with.
        values.setdefault("roi_samples", 1)
        values["box_voting"] = True
        values["anchor_sizes_px"] = tuple(
            (_LIGHT_ANCHOR_PX * 2**n * width / 640.0,) for n in levels
        )
        depth = {"mean": (128.0,), "std": (80.0,)}
        values |= {"mean": IMAGENET_MEAN, "std": IMAGENET_STD} if modality == "rgb" else depth
        if modality == "both":
            values |= {
                "colour_backbone": _RGB_BACKBONES.get(preset, values["backbone"]),
                "colour_mean": IMAGENET_MEAN,
                "colour_std": IMAGENET_STD,
                "colour_pad_value": _COLOUR_PAD_VALUE,
                "colour_reduction": COLOUR_REDUCTION,
            }
    else:
        raise SpecError(f"model is {preset!r}, expected one of: {', '.join(PRESETS)}")
    values |= {
        "pad_value": _COLOUR_PAD_VALUE if modality == "rgb" else 255,
        "depth_encoding": None if modality == "rgb" else dict(LINEAR_20_M),
    }
    try:
        return ModelSpec(
            name=preset if modality == "both" else f"{preset}-{modality}",
            modality=modality,
            height=height,
            width=width,
            **(values | changes),
        )
    except TypeError as error:
        raise SpecError(f"unknown model setting: {error}") from error
