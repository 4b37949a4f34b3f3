"""Backbones against torchvision's networks with the same weights: names, strides, groups."""

import pytest
import torch
from torch import Tensor, nn
from torchvision import models as zoo
from torchvision.models.resnet import Bottleneck, ResNet

from basetree.errors import InputError
from perceptree.models import make_spec
from perceptree.models.backbones import Backbone

LEVELS = (2, 3, 4, 5)
STAGES = ("layer1", "layer2", "layer3", "layer4")

ORIGINALS = {
    "resnet18": zoo.resnet18,
    "resnet50": zoo.resnet50,
    "resnext101_32x4d": lambda: ResNet(Bottleneck, [3, 4, 23, 3], groups=32, width_per_group=4),
    "resnext101_32x8d": zoo.resnext101_32x8d,
}


def lively(network: nn.Module) -> nn.Module:
    """Set batch norm statistics and weights to values as after training, not ones and zeros."""
    random = torch.Generator().manual_seed(2)
    for module in network.modules():
        if isinstance(module, nn.BatchNorm2d):
            for value, base in ((module.weight, 0.5), (module.running_var, 1.0)):
                value.data = base + 0.2 * torch.rand(value.shape, generator=random)
            for value in (module.bias, module.running_mean):
                value.data = 0.1 * torch.randn(value.shape, generator=random)
    return network.eval()


def stage_outputs(network: nn.Module, images: Tensor) -> list[Tensor]:
    seen: list[Tensor] = []
    for name in STAGES:
        getattr(network, name).register_forward_hook(lambda _m, _i, out: seen.append(out))
    with torch.inference_mode():
        network(images)
    return seen


def trunk_with(name: str, original: nn.Module, stride_in_1x1: bool = False) -> Backbone:
    with torch.device("meta"):
        trunk = Backbone(name, 3, LEVELS, stride_in_1x1).eval()
    kept = {k: v for k, v in original.state_dict().items() if not k.startswith("fc.")}
    trunk.trunk.load_state_dict(kept, assign=True)
    return trunk


def assert_same_maps(trunk: Backbone, original: nn.Module) -> None:
    images = torch.randn(1, 3, 64, 96, generator=torch.Generator().manual_seed(3))
    with torch.inference_mode():
        ours = trunk(images)
    theirs = stage_outputs(original, images)
    assert [m.shape[1] for m in ours] == list(trunk.channels)
    for level, mine, expected in zip(LEVELS, ours, theirs, strict=True):
        assert mine.shape[2:] == (64 // 2**level, 96 // 2**level)
        scale = float(expected.abs().max())
        assert scale > 0.1
        assert float((mine - expected).abs().max()) < 1e-5 * scale, f"level {level}"


@pytest.mark.parametrize("name", ORIGINALS)
def test_a_trunk_with_torchvisions_weights_gives_its_maps(name: str) -> None:
    torch.manual_seed(0)
    original = lively(ORIGINALS[name]())
    assert_same_maps(trunk_with(name, original), original)


def test_the_stride_in_the_1x1_is_what_moving_it_by_hand_gives() -> None:
    torch.manual_seed(0)
    original = lively(zoo.resnet50())
    trunk = trunk_with("resnet50", original, stride_in_1x1=True)
    for stage in ("layer2", "layer3", "layer4"):
        block = getattr(original, stage)[0]
        assert block.conv2.stride == (2, 2)
        block.conv1.stride, block.conv2.stride = (2, 2), (1, 1)
    assert_same_maps(trunk, original)


@pytest.mark.parametrize("name", ["resnet18", "mobilenetv4_conv_small", "mobilenetv3_large"])
def test_a_network_without_bottlenecks_refuses_the_stride_in_the_1x1(name: str) -> None:
    with pytest.raises(InputError, match=f"stride_in_1x1 is true for {name}, expected a ResNet"):
        Backbone(name, 3, LEVELS, stride_in_1x1=True)


def test_presets_have_the_stride_and_normalisation_of_the_published_configurations() -> None:
    mean, std = (103.53, 116.28, 123.675), (57.375, 57.12, 58.395)
    for preset in ("r50", "r101"):
        spec = make_spec(preset)
        assert (spec.stride_in_1x1, spec.mean, spec.std) == (True, mean, (1.0, 1.0, 1.0))
    for preset in ("x101-32x8d", "x101-32x4d"):
        spec = make_spec(preset)
        assert (spec.stride_in_1x1, spec.mean, spec.std) == (False, mean, std)
        assert spec.backbone == f"resnext101_{preset.split('-')[1]}"
