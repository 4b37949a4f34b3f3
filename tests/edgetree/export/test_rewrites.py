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
NETWORKS: dict[str, dict[str, Any]] = {
    "rgb, 3x3 stem, std": {},
    "rgb, 7x7 stem, no std": {"preset": "r50", "std": UNIT},
    "rgb, 7x7 stem, std, 90x150": {
        "preset": "r50",
        "std": (57.4, 57.1, 58.4),
        "height": 90,
        "width": 150,
    },
    "rgb, 3x3 stem, 97x131": {"height": 97, "width": 131},
    "rgb, all means whole": {"mean": (120.0, 120.0, 120.0)},
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
    "both": {"modality": "both"},
    "rgb, means of 2x2 pixels": {"reduction": 2},
    "rgb, 7x7 stem, means of 2x2 pixels, 90x150": {
        "preset": "r50",
        "reduction": 2,
        "height": 90,
        "width": 150,
    },
    "both, 90x150": {"modality": "both", "height": 90, "width": 150},
}
# Channels per pixel that the first convolution reads if quantised.
CHANNELS = {"rgb, all means whole": 3, "depth, one mean, std": 1, "depth, one mean, 90x150": 1}
CHANNELS |= {"both": 1, "both, 90x150": 1}


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
        per_pixel = 4 if model.spec.modality == "rgb" else 2
        stem = first_convolution(changed)
        pixels = (2 * model.spec.reduction) ** 2
        assert stem.in_channels == pixels * CHANNELS.get(name, per_pixel)
        assert stem.stride == (1, 1)
    # No division and no transposed convolution is left.
    assert {*changed.spec.std, *changed.spec.colour_std} == {1.0}
    assert not any(isinstance(part, nn.ConvTranspose2d) for part in changed.modules())


def test_only_the_quantised_network_reads_keypoints_between_pixels(build_model: BuildModel) -> None:
    model = build_model(preset="r50")
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
    model = build_model(masks=masks, keypoints=keypoints)
    assert_same_outputs(model, rewrite_for_export(model, quantised=quantised))


def test_an_unsupported_first_convolution_is_named(build_model: BuildModel) -> None:
    model = build_model()
    first_convolution(model).stride = (1, 1)
    with pytest.raises(ValueError, match="expected stride 2"):
        rewrite_for_export(model, quantised=True)
