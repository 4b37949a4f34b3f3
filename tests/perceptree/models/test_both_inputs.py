"""Networks of colour and depth: what they find, from what they are made, and what they become."""

import dataclasses
import json
from pathlib import Path
from typing import Any

import pytest
import torch
from narrow_networks import narrow_spec
from torch import Tensor

from perceptree.models import ModelSpec, SpecError, TreeRCNN, load_checkpoint, save_checkpoint
from perceptree.models.branches import joined_spec, load_branches, pruned
from perceptree.models.cost import multiply_adds, multiply_adds_by_part

BATCH = 3


def network(modality: str, seed: int = 0, **changes: Any) -> TreeRCNN:
    torch.manual_seed(seed)
    return TreeRCNN(narrow_spec(modality, score_threshold=0.0, **changes)).eval()


def both(**changes: Any) -> TreeRCNN:
    """A network whose colour branch has weights."""
    model = network("both", **changes)
    assert model.colour_lateral is not None
    for parameter in model.colour_lateral.parameters():
        torch.nn.init.normal_(parameter, std=0.1)
    return model


def pictures(spec: ModelSpec, seed: int = 0) -> dict[str, Tensor]:
    random = torch.Generator().manual_seed(seed)
    shape = (BATCH, spec.height, spec.width)
    return {
        "colour": torch.randint(1, 256, (*shape, 3), dtype=torch.uint8, generator=random),
        "depth": torch.randint(0, 200, shape, dtype=torch.uint8, generator=random),
    }


def nothing(images: Tensor, value: int) -> Tensor:
    return torch.full_like(images, value)


def maps(model: TreeRCNN, images: Any) -> list[Tensor]:
    return list(model.maps(images).values())


def assert_same(first: list[Tensor], second: list[Tensor], tolerance: float = 1e-4) -> None:
    for one, other in zip(first, second, strict=True):
        torch.testing.assert_close(one, other, atol=tolerance, rtol=tolerance)


@torch.inference_mode()
def test_a_missing_image_and_one_that_shows_nothing_are_the_same() -> None:
    model = both()
    images = pictures(model.spec)
    colour, depth = images["colour"], images["depth"]
    alone = maps(model, {"depth": depth})
    assert_same(maps(model, {"colour": nothing(colour, 0), "depth": depth}), alone)
    of_colour = maps(model, {"colour": colour})
    assert_same(maps(model, {"colour": colour, "depth": nothing(depth, 255)}), of_colour)
    together = maps(model, images)
    assert not torch.allclose(together[0], alone[0])
    assert not torch.allclose(together[0], of_colour[0])
    assert torch.isfinite(model.detect(images).boxes).all()


@torch.inference_mode()
def test_each_image_of_a_batch_is_missing_by_itself() -> None:
    model = both()
    images = pictures(model.spec)
    images["colour"][1] = 0
    images["depth"][2] = 255
    found = maps(model, images)
    for row in range(BATCH):
        one = maps(model, {name: values[row : row + 1] for name, values in images.items()})
        assert_same([each[row : row + 1] for each in found], one)


@torch.inference_mode()
def test_stored_images_have_the_depth_as_the_last_channel() -> None:
    model = both()
    images = pictures(model.spec)
    stored = torch.cat((images["colour"], images["depth"][..., None]), dim=3)
    assert stored.shape[1:] == model.spec.image_shape
    assert_same(maps(model, stored), maps(model, images))


@pytest.mark.parametrize(
    ("images", "reason"),
    [
        ({}, r"images are \[\], expected colour and depth"),
        ({"rgb": torch.zeros(1, 64, 128, 3)}, r"images are \['rgb'\], expected colour and depth"),
        (
            {"colour": torch.zeros(1, 64, 128, dtype=torch.uint8)},
            r"of shape \(1, 64, 128\), expected torch.uint8 of shape \(B, 64, 128, 3\)",
        ),
        (torch.zeros(1, 64, 128, dtype=torch.uint8), r"expected .* \(B, 64, 128, 4\)"),
    ],
)
def test_other_images_are_refused(images: Any, reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        network("both").maps(images)


def test_the_spec_survives_json_and_that_of_one_input_is_as_before(tmp_path: Path) -> None:
    model = both()
    spec = model.spec
    assert ModelSpec.from_dict(json.loads(json.dumps(spec.to_dict()))) == spec
    assert not [name for name in narrow_spec("depth").to_dict() if name.startswith("colour")]
    save_checkpoint(tmp_path / "both.safetensors", model, {})
    loaded, _ = load_checkpoint(tmp_path / "both.safetensors")
    assert loaded.spec == spec
    with torch.inference_mode():
        assert_same(maps(loaded, pictures(spec)), maps(model, pictures(spec)), 0.0)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"colour_backbone": None}, "colour_backbone is None for both, expected one for both"),
        ({"colour_mean": (1.0,)}, "colour_mean and colour_std have 1 and 3 values"),
        ({"colour_std": (1.0, 0.0, 1.0)}, "colour_std is"),
        ({"depth_encoding": None}, "depth_encoding is None for both"),
        ({"modality": "depth"}, "colour_mean and colour_std have 3 and 3 values, expected 0"),
        ({"modality": "stereo"}, "expected 'rgb', 'depth' or 'both'"),
    ],
)
def test_parts_that_do_not_fit_are_refused(changes: dict[str, Any], reason: str) -> None:
    with pytest.raises(SpecError, match=reason):
        dataclasses.replace(narrow_spec("both"), **changes)


@torch.inference_mode()
def test_a_joined_network_finds_what_the_depth_network_finds() -> None:
    depth, colour = network("depth"), network("rgb", seed=1)
    model = TreeRCNN(joined_spec(depth.spec, colour.spec, "edge-n")).eval()
    load_branches(model, depth, colour)
    images = pictures(model.spec)
    assert_same(maps(model, images), maps(depth, images["depth"]), 0.0)
    assert model.colour_backbone is not None
    theirs = colour.backbone.state_dict()
    assert all(x.equal(theirs[name]) for name, x in model.colour_backbone.state_dict().items())


def test_other_pairs_of_networks_are_not_joined() -> None:
    depth, colour = narrow_spec("depth"), narrow_spec("rgb")
    with pytest.raises(SpecError, match="are for rgb and depth, expected depth and rgb"):
        joined_spec(colour, depth, "edge-n")


@torch.inference_mode()
@pytest.mark.parametrize("norm", [True, False])
def test_a_pruned_network_finds_what_one_image_alone_shows(norm: bool) -> None:
    model = both(fpn_norm=norm)
    images = pictures(model.spec)
    depth, colour = pruned(model, "depth"), pruned(model, "colour")
    assert (depth.spec.modality, colour.spec.modality) == ("depth", "rgb")
    assert (depth.spec.name, colour.spec.name) == ("edge-n-depth", "edge-n-rgb")
    assert_same(maps(depth, images["depth"]), maps(model, {"depth": images["depth"]}), 0.0)
    assert_same(maps(colour, images["colour"]), maps(model, {"colour": images["colour"]}))
    assert pruned(model, "both") is model
    assert pruned(depth, "depth") is depth
    with pytest.raises(SpecError, match="the network takes depth, expected one of both inputs"):
        pruned(depth, "colour")


def test_the_cost_is_that_of_both_branches() -> None:
    model = both()
    parts = multiply_adds_by_part(model)
    branches = [multiply_adds(pruned(model, "depth")), multiply_adds(pruned(model, "colour"))]
    assert multiply_adds(model) == branches[0] + parts["colour"]
    assert max(branches) < multiply_adds(model) < sum(branches)


def test_images_that_show_nothing_leave_the_norms_as_they_are() -> None:
    model = both()
    images = pictures(model.spec)
    stored = torch.cat((images["colour"], images["depth"][..., None]), dim=3)
    stored[0, ..., :3] = 0
    stored[0, ..., 3] = 255
    model.train()
    assert model.colour_backbone is not None
    norms = [model.backbone.trunk.bn1, model.colour_backbone.trunk.bn1]
    for norm in norms:
        norm.momentum = 1.0
    with torch.no_grad():
        model.maps(stored)
        learnt = [norm.running_mean.clone() for norm in norms]
        model.maps(stored[1:])
        for norm, value in zip(norms, learnt, strict=True):
            torch.testing.assert_close(norm.running_mean, value)
        stored[..., :3], stored[..., 3] = 0, 255  # now none shows anything
        found = model.maps(stored)
    for norm, value in zip(norms, learnt, strict=True):
        assert norm.running_mean.equal(value)
    assert all(x.isfinite().all() for x in found.values())


def test_inputs_that_no_image_shows_have_gradients_of_zero() -> None:
    model = both().train()
    images = pictures(model.spec)
    dark = torch.zeros_like(images["colour"])
    found = maps(model, images | {"colour": dark})
    torch.stack([x.sum() for x in found]).sum().backward()  # type: ignore[no-untyped-call]
    assert model.colour_backbone is not None
    assert all(x.grad is not None and not x.grad.any() for x in model.colour_backbone.parameters())
    assert any(x.grad is not None and x.grad.any() for x in model.backbone.parameters())


def test_both_backbones_are_frozen() -> None:
    model = network("both").train()
    model.freeze(5, norms=True)
    for backbone in model.backbones:
        assert not any(parameter.requires_grad for parameter in backbone.parameters())
        assert not any(part.training for _, part in backbone.stages())
    model.freeze(0)
    assert all(parameter.requires_grad for parameter in model.parameters())
