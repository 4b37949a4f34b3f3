"""Starting weights from the libraries that publish them: ImageNet by timm, COCO by torchvision."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any, TypeVar

import timm
import torch
from torch import Tensor
from torchvision.models.detection import KeypointRCNN_ResNet50_FPN_Weights

from perceptree.errors import CheckpointError, SettingsError
from perceptree.models.checkpoint import check_tensors
from perceptree.models.detector import TreeRCNN
from perceptree.models.presets import IMAGENET_STD
from perceptree.models.spec import ModelSpec

# Our backbone -> timm's name and tag, so that every version of timm gives the same weights. All
# may be used commercially, which the tag that timm prefers for resnext101_32x4d may not.
IMAGENET_WEIGHTS = {
    "mobilenetv3_large": "mobilenetv3_large_100.ra_in1k",
    "mobilenetv4_conv_small": "mobilenetv4_conv_small.e2400_r224_in1k",
    "mobilenetv4_conv_medium": "mobilenetv4_conv_medium.e500_r256_in1k",
    "resnet18": "resnet18.tv_in1k",
    "resnet50": "resnet50.tv_in1k",
    "resnet101": "resnet101.tv_in1k",
    "resnext101_32x4d": "resnext101_32x4d.gluon_in1k",
    "resnext101_32x8d": "resnext101_32x8d.tv_in1k",
}

# torchvision's names -> ours. Files of before version 0.11 lack the numbers in brackets.
_COCO_NAMES = (
    (r"backbone\.body\.(.+)", r"backbone.trunk.\1"),
    (r"backbone\.fpn\.inner_blocks\.(\d)(?:\.0)?\.(\w+)", r"pyramid.lateral.\1.\2"),
    (r"backbone\.fpn\.layer_blocks\.(\d)(?:\.0)?\.(\w+)", r"pyramid.output.\1.\2"),
    (r"rpn\.head\.conv(?:\.0\.0)?\.(\w+)", r"proposer.conv.\1"),
    (r"rpn\.head\.cls_logits\.(\w+)", r"proposer.objectness.\1"),
    (r"rpn\.head\.bbox_pred\.(\w+)", r"proposer.shift.\1"),
    (r"roi_heads\.box_head\.fc6\.(\w+)", r"box_head.hidden.0.\1"),
    (r"roi_heads\.box_head\.fc7\.(\w+)", r"box_head.hidden.1.\1"),
)
_COCO_KEYPOINT_CONV = re.compile(r"roi_heads\.keypoint_head\.(\d+)\.(\w+)")
_COUNTER = "num_batches_tracked"
_STEM = "backbone.trunk.conv1.weight"

Fetched = TypeVar("Fetched")


def load_imagenet(model: TreeRCNN) -> None:
    """Give the backbone the weights of an ImageNet classifier; the rest stays as it is.

    On the same picture the backbone's maps equal the classifier's, with two exceptions: one
    channel of depth takes the sum of the three colours' stems, and a network with
    ``stride_in_1x1`` differs until it is trained, as these weights learned with the stride in
    the 3x3. Raises CheckpointError where the weights cannot be fetched.
    """
    spec = model.spec
    name = IMAGENET_WEIGHTS[spec.backbone]
    network: Any = _fetched(
        f"the ImageNet weights {name}",
        "timm",
        lambda: timm.create_model(
            name,
            pretrained=True,
            features_only=True,
            in_chans=3,
            out_indices=tuple(level - 1 for level in spec.backbone_levels),
        ),
    )
    weights: dict[str, Tensor] = network.state_dict()
    stem = network.pretrained_cfg["first_conv"] + ".weight"
    weights[stem] = _stem_for(spec, weights[stem])
    model.backbone.trunk.load_state_dict(weights)


def load_coco(model: TreeRCNN) -> None:
    """Give a ResNet-50 detector torchvision's weights for the keypoints of people in COCO.

    Class, box shift, mask head and the layer that makes the keypoints' maps stay as they are.
    These weights learned with the stride in the 3x3, so that a network with ``stride_in_1x1``
    differs until it is trained. Raises SettingsError for another backbone, CheckpointError where
    the weights cannot be fetched or do not fit.
    """
    spec = model.spec
    if spec.backbone != "resnet50":
        raise SettingsError(
            f"the COCO weights of torchvision are for resnet50, the model has {spec.backbone}: "
            "for that one, make a file of a published checkpoint by perceptree import --as-init "
            "and start from it"
        )
    source = "the COCO weights keypointrcnn_resnet50_fpn"
    weights = KeypointRCNN_ResNet50_FPN_Weights.COCO_V1
    found = _fetched(
        source,
        "torchvision",
        lambda: weights.get_state_dict(check_hash=True, map_location="cpu", weights_only=True),
    )
    taken = {ours: tensor for name, tensor in found.items() if (ours := _name_of_coco(name))}
    if not spec.keypoints:
        taken = {name: t for name, t in taken.items() if not name.startswith("keypoint_head.")}
    own = model.state_dict()
    check_tensors(source, {name: own[name] for name in own if _in_coco(name)}, taken)
    taken[_STEM] = _stem_for(spec, taken[_STEM])
    _take_epsilon_off(model, taken)
    model.load_state_dict(own | taken)


def _fetched(what: str, library: str, fetch: Callable[[], Fetched]) -> Fetched:
    try:
        return fetch()
    except Exception as error:  # which ones depends on what the library loads by
        reason = (str(error).splitlines() or [""])[0] or type(error).__name__
        raise CheckpointError(
            f"{what} could not be fetched by {library} ({reason}): expected a network, the "
            f"weights in {library}'s cache, or a checkpoint file to start from (--init FILE)"
        ) from error


def _stem_for(spec: ModelSpec, stem: Tensor) -> Tensor:
    """A stem (C, 3, k, k) of normalised RGB -> one that takes the input as ``spec`` has it."""
    if spec.channels == 1:
        return stem.sum(dim=1, keepdim=True)
    scale = torch.tensor(spec.std) / torch.tensor(IMAGENET_STD)
    return stem.flip(1) * scale[:, None, None]


def _name_of_coco(name: str) -> str | None:
    """Our name of a tensor of torchvision's detector; None for one that we do not take."""
    if name.endswith(_COUNTER):
        return None
    for pattern, ours in _COCO_NAMES:
        match = re.fullmatch(pattern, name)
        if match:
            return match.expand(ours)
    match = _COCO_KEYPOINT_CONV.fullmatch(name)
    if match:  # every second of its layers is a relu
        return f"keypoint_head.tower.convs.{int(match[1]) // 2}.{match[2]}"
    return None


def _in_coco(name: str) -> bool:
    parts = ("backbone.", "pyramid.", "proposer.", "box_head.hidden.", "keypoint_head.tower.convs.")
    return name.startswith(parts) and not name.endswith(_COUNTER)


def _take_epsilon_off(model: TreeRCNN, weights: dict[str, Tensor]) -> None:
    """Have our batch norms, which add epsilon to the variance, answer as theirs, which do not."""
    for name in [name for name in weights if name.endswith(".running_var")]:
        norm = name.removesuffix(".running_var")
        epsilon = float(model.get_submodule(norm).eps)  # type: ignore[arg-type]
        factor = (1.0 + epsilon / weights[name]).sqrt()
        weights[f"{norm}.weight"] = weights[f"{norm}.weight"] * factor
