"""Parameter and multiply-add counts against published values."""

import pytest
import torch
import torchvision.models as zoo

from basetree.errors import InputError
from perceptree.models import TreeRCNN, make_spec
from perceptree.models.backbones import BACKBONES, Backbone, make_timm
from perceptree.models.cost import (
    classifier_cost,
    multiply_adds,
    multiply_adds_by_part,
    parameters,
)


@pytest.mark.parametrize(
    ("backbone", "weights"),
    [
        ("resnet18", zoo.ResNet18_Weights.IMAGENET1K_V1),
        ("resnet50", zoo.ResNet50_Weights.IMAGENET1K_V1),
        ("resnet101", zoo.ResNet101_Weights.IMAGENET1K_V1),
        ("resnext101_32x8d", zoo.ResNeXt101_32X8D_Weights.IMAGENET1K_V1),
        ("mobilenetv3_large", zoo.MobileNet_V3_Large_Weights.IMAGENET1K_V1),
    ],
)
def test_classifiers_cost_what_torchvision_publishes(backbone: str, weights: object) -> None:
    meta = weights.meta  # type: ignore[attr-defined]
    cost = classifier_cost(backbone)
    assert cost.parameters == meta["num_params"]
    assert cost.multiply_adds / 1e9 == pytest.approx(meta["_ops"], abs=6e-4)


# R50 and R101: table 2 of the SENet paper (arXiv 1709.01507), which the percepTree paper's table
# repeats; ResNeXt-101 32x4d: the same table (7.99 G) and table 1 of the ResNeXt paper's sizes.
# MobileNetV4: timm's result tables (3.77 and 9.72 M) and model cards: small 0.2 G at 224 px,
# medium 1.1 G at 256 px, which is 0.84 G at 224 px; small 0.19 G in its paper (arXiv 2404.10518).
# EfficientNet-Lite0: timm's result tables (4.65 M), and its authors' README (407 M multiply-adds,
# with those of the batch norms).
@pytest.mark.parametrize(
    ("backbone", "stride_in_1x1", "million", "giga", "tolerance"),
    [
        ("resnet50", True, 25.6, 3.86, 0.002),
        ("resnet101", True, 44.5, 7.58, 0.002),
        ("resnext101_32x4d", False, 44.2, 7.99, 0.003),
        ("mobilenetv4_conv_small", False, 3.77, 0.19, 0.03),
        ("mobilenetv4_conv_medium", False, 9.72, 0.84, 0.03),
        ("mobilenetv3_large", False, 5.48, 0.22, 0.03),
        ("efficientnet_lite0", False, 4.65, 0.407, 0.06),
    ],
)
def test_classifiers_cost_what_papers_and_model_cards_publish(
    backbone: str, stride_in_1x1: bool, million: float, giga: float, tolerance: float
) -> None:
    cost = classifier_cost(backbone, stride_in_1x1)
    assert cost.parameters / 1e6 == pytest.approx(million, rel=0.003)
    assert cost.multiply_adds / 1e9 == pytest.approx(giga, rel=tolerance)


@pytest.mark.parametrize("backbone", BACKBONES)
def test_a_trunk_is_a_part_of_the_classifier(backbone: str) -> None:
    with torch.device("meta"):
        whole = make_timm(backbone, stride_in_1x1=False).state_dict()
        trunk = Backbone(backbone, 3, (2, 3, 4, 5)).trunk.state_dict()
    assert {name: tuple(whole[name].shape) for name in trunk} == {
        name: tuple(value.shape) for name, value in trunk.items()
    }
    left = {name.split(".")[0] for name in set(whole) - set(trunk)}
    assert left <= {"fc", "classifier", "conv_head", "norm_head", "bn2"}


def test_a_mask_rcnn_costs_what_mmdetection_publishes() -> None:
    # mmdetection's mask_rcnn_r50_fpn: 181 G and 44.2 M at 800x800, with the stride in the 3x3,
    # 1000 proposals, 100 detections and 80 classes; its count excludes the frozen stem and
    # first stage (0.225 M).
    spec = make_spec("r50", "rgb", 800, 800, stride_in_1x1=False, keypoints=False, detections=100)
    model = TreeRCNN(spec)
    cost = multiply_adds_by_part(model)
    assert sum(cost.values()) / 1e9 == pytest.approx(181, rel=0.03)
    # 177 G, counting two operations per multiply-add, measured with torchvision's network.
    assert (cost["backbone"] + cost["pyramid"]) / 1e9 == pytest.approx(177 / 2, rel=0.005)
    more_classes = 79 * (1024 + 1) + 4 * 79 * (1024 + 1) + 79 * (256 + 1)
    assert (parameters(model) + more_classes - 225_344) / 1e6 == pytest.approx(44.2, abs=0.05)


def test_parts_add_up_by_hand() -> None:
    changes = {"proposals": 50, "detections": 7, "box_head_width": 32, "fpn_width": 16}
    spec = make_spec(
        "edge-n", "depth", 90, 150, mask_head_widths=(8,), keypoint_head_widths=(4, 8), **changes
    )
    model = TreeRCNN(spec)
    cost = multiply_adds_by_part(model)
    names = ["backbone", "pyramid", "proposals", "box_head", "mask_head", "keypoint_head"]
    assert list(cost) == names
    assert multiply_adds(model) == sum(cost.values())
    cells = [12 * 20, 6 * 10, 3 * 5]  # of 90x150 px padded to 96x160, at strides 8, 16, 32
    assert cost["proposals"] == sum(cells) * (16 * 16 * 9 + 16 * 3 * 5)
    assert cost["box_head"] == 50 * (16 * 49 * 32 + 32 * 32 + 32 * 2 + 32 * 4)
    assert cost["mask_head"] == 7 * (14**2 * (16 * 8 * 9 + 8 * 8 * 4) + 28**2 * 8)
    assert cost["keypoint_head"] == 7 * 14**2 * (16 * 4 * 9 + 4 * 8 * 9 + 8 * 5 * 16)


def test_an_absent_branch_costs_nothing_and_counting_changes_nothing() -> None:
    spec = make_spec("edge-n", "rgb", 64, 64, masks=False, fpn_width=16)
    model = TreeRCNN(spec).train()
    before = {name: value.clone() for name, value in model.state_dict().items()}
    assert set(multiply_adds_by_part(model)) == {
        "backbone",
        "pyramid",
        "proposals",
        "box_head",
        "keypoint_head",
    }
    assert all(bool((before[name] == value).all()) for name, value in model.state_dict().items())


def test_an_unknown_backbone_is_one_line() -> None:
    with pytest.raises(InputError, match="backbone is 'vgg', expected one of: "):
        classifier_cost("vgg")
