"""The network rewritten for export gives the same outputs, evaluated in torch."""

import dataclasses
import functools
from collections.abc import Callable
from typing import Any

import pytest
import torch
from torch import nn

from edgetree.export.comparison import compare_frames
from edgetree.export.limits import ParityLimits
from edgetree.export.parity import ParityReport
from edgetree.export.rewrites import rewrite_for_export
from perceptree.models import TreeRCNN

BuildModel = Callable[..., TreeRCNN]

UNIT = (1.0, 1.0, 1.0)
CLOSE = ParityLimits(box_px=0.01, keypoint_px=0.05, score=1e-4, keypoint_score=1e-4, mask_iou=0.999)
# Means of colour that are bytes: around the image they are rounded to bytes if quantised.
MEAN = (104.0, 116.0, 124.0)
NETWORKS: dict[str, dict[str, Any]] = {
    "rgb, 3x3 stem, std": {"mean": MEAN},
    "rgb, 7x7 stem, no std": {"preset": "r50", "mean": MEAN, "std": UNIT},
    "rgb, 7x7 stem, std, 90x150": {
        "preset": "r50",
        "mean": MEAN,
        "std": (57.4, 57.1, 58.4),
        "height": 90,
        "width": 150,
    },
    "rgb, 3x3 stem, 97x131": {"mean": MEAN, "height": 97, "width": 131},
    "rgb, one mean": {"mean": (120.0, 120.0, 120.0)},
    "depth, one mean, std": {"modality": "depth"},
    "depth, one mean, 90x150": {"modality": "depth", "height": 90, "width": 150},
    "depth, one mean that is no byte": {"modality": "depth", "mean": (128.4,)},
    "depth, three means": {"modality": "depth", "preset": "r50"},
    "depth, three means, std, 90x150": {
        "modality": "depth",
        "preset": "r50",
        "std": (57.4, 57.1, 58.4),
        "height": 90,
        "width": 150,
    },
    "both": {"modality": "both", "colour_mean": MEAN},
    "rgb, means of 2x2 pixels": {"mean": MEAN, "reduction": 2},
    "rgb, 7x7 stem, means of 2x2 pixels, 90x150": {
        "preset": "r50",
        "mean": MEAN,
        "reduction": 2,
        "height": 90,
        "width": 150,
    },
    "both, 90x150": {"modality": "both", "colour_mean": MEAN, "height": 90, "width": 150},
}
# Those whose first convolution reads a constant beside each pixel if quantised.
WITH_CONSTANT = {name for name in NETWORKS if "three means" in name or "that is no byte" in name}


@pytest.fixture(scope="module")
def network(build_model: BuildModel) -> Callable[[str], TreeRCNN]:
    """The NETWORKS by name, each built once, with keypoints between pixels."""
    return functools.cache(lambda name: build_model(**NETWORKS[name], keypoint_grid="subcell"))


@pytest.fixture(autouse=True)
def as_when_traced(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.compiler, "is_exporting", lambda: True)


def images_of(model: TreeRCNN) -> torch.Tensor:
    spec = model.spec
    random = torch.Generator().manual_seed(5)
    return torch.randint(0, 256, (2, *spec.image_shape), generator=random, dtype=torch.uint8)


def first_convolution(model: TreeRCNN) -> nn.Conv2d:
    return next(part for part in model.backbone.modules() if isinstance(part, nn.Conv2d))


def assert_same_outputs(model: TreeRCNN, changed: TreeRCNN) -> None:
    """Compare matched trees, since the order of equal scores is undefined."""
    images = images_of(model)
    with torch.inference_mode():
        expected, found = (
            {name: value.numpy() for name, value in network.detect(images)._asdict().items()}
            for network in (model, changed)
        )
    assert int(expected["num_detections"].min()) > 1
    frames = {str(number): image.numpy() for number, image in enumerate(images)}
    compared = compare_frames(
        lambda _: expected, lambda _: found, frames, "float32", model.spec.score_threshold, 2
    )
    report = ParityReport("float32", compared, limits=CLOSE)
    assert report.faults() == []
    assert report.trees > 4


@pytest.mark.parametrize("name", NETWORKS)
@pytest.mark.parametrize("quantised", [False, True])
def test_the_rewritten_network_gives_the_same_detections(
    name: str, quantised: bool, network: Callable[[str], TreeRCNN]
) -> None:
    model = network(name)
    before = {key: value.clone() for key, value in model.state_dict().items()}
    changed = rewrite_for_export(model, quantised=quantised)
    assert_same_outputs(model, changed)
    for key, value in model.state_dict().items():
        assert torch.equal(value, before[key]), f"{key} of the model itself"
    if quantised:
        per_pixel = 3 if model.spec.modality == "rgb" else 1 + (name in WITH_CONSTANT)
        stem, stride = first_convolution(changed), 2 * model.spec.reduction
        assert stem.in_channels == 2 * stride * per_pixel
        assert stem.stride == (stride, 1)
    # No division and no transposed convolution is left.
    assert {*changed.spec.std, *changed.spec.colour_std} == {1.0}
    assert not any(isinstance(part, nn.ConvTranspose2d) for part in changed.modules())


def test_around_a_colour_image_each_mean_is_rounded_to_a_byte(build_model: BuildModel) -> None:
    model = build_model()
    means = model.mean.flatten().round().to(torch.uint8)
    assert not torch.equal(means.float(), model.mean.flatten())
    images = images_of(model)
    batch, high, wide, _ = images.shape
    around = means.expand(batch, high + 64, wide + 64, 3).clone()
    around[:, 32:-32, 32:-32] = images

    def stem(network: TreeRCNN, given: torch.Tensor) -> torch.Tensor:
        seen: list[torch.Tensor] = []
        first = network.backbone.get_submodule("trunk.blocks.0")
        hook = first.register_forward_pre_hook(lambda _, args: seen.append(args[0]))
        with torch.inference_mode():
            network.backbone(network.normalise(given))
        hook.remove()
        return seen[0]

    changed = rewrite_for_export(model, quantised=True)
    expected = stem(model, around)[:, :, 16:-16, 16:-16]
    torch.testing.assert_close(stem(changed, images), expected, atol=1e-4, rtol=1e-4)


def test_only_the_quantised_network_reads_keypoints_between_pixels(build_model: BuildModel) -> None:
    model = build_model(preset="r50", mean=MEAN)
    assert model.spec.keypoint_grid == "pixels"
    float32, int8 = (rewrite_for_export(model, quantised=quantised) for quantised in (False, True))
    assert_same_outputs(model, float32)
    between = rewrite_for_export(model, quantised=False)
    between.spec = dataclasses.replace(between.spec, keypoint_grid="subcell")
    assert_same_outputs(between, int8)
    images = images_of(model)
    with torch.inference_mode():
        pixels, read = (form.detect(images).keypoints for form in (float32, int8))
    assert (pixels - read)[..., :2].abs().max() > 0.05


@pytest.mark.parametrize(("masks", "keypoints"), [(True, False), (False, True), (False, False)])
@pytest.mark.parametrize("quantised", [False, True])
def test_networks_without_some_branches_are_rewritten(
    masks: bool, keypoints: bool, quantised: bool, build_model: BuildModel
) -> None:
    model = build_model(masks=masks, keypoints=keypoints, mean=MEAN)
    assert_same_outputs(model, rewrite_for_export(model, quantised=quantised))


def test_an_unsupported_first_convolution_is_named(build_model: BuildModel) -> None:
    model = build_model()
    first_convolution(model).stride = (1, 1)
    with pytest.raises(ValueError, match="expected stride 2"):
        rewrite_for_export(model, quantised=True)
