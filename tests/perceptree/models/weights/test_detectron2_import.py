"""Import of Detectron2 checkpoints: which weights arrive."""

import dataclasses
from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from their_networks import HEAT, SCORE, SHIFT, persons
from torch import Tensor

from perceptree.errors import CheckpointError
from perceptree.models import ModelSpec
from perceptree.models.presets import IMAGENET_MEAN
from perceptree.models.weights import Imported, import_checkpoint
from perceptree.models.weights.detectron2 import their_name

State = dict[str, Tensor]
States = Callable[[], State]
Write = Callable[[object], Path]


@pytest.fixture(scope="module")
def imported(thin_state: States, tmp_path_factory: pytest.TempPathFactory) -> Imported:
    """The narrow network for 64x96 px, imported from a file."""
    counter = {"backbone.bottom_up.stem.conv1.norm.num_batches_tracked": torch.tensor(7)}
    path = tmp_path_factory.mktemp("thin") / "their model.pth"
    torch.save({"model": thin_state() | counter, "iteration": 3}, path)
    return import_checkpoint(path, height=64, width=96)


def test_every_weight_arrives(
    imported: Imported,
    thin_spec: ModelSpec,
    thin_state: States,
    detectron2_state: Callable[..., State],
) -> None:
    state = thin_state()
    assert imported.model.spec == dataclasses.replace(thin_spec, height=64, width=96)
    assert not imported.model.training
    assert imported.preset == "r50"
    found = detectron2_state(imported.model)
    assert found.keys() == state.keys()
    for name, value in state.items():
        assert torch.equal(found[name], value), name
    assert imported.model.get_buffer("backbone.trunk.bn1.num_batches_tracked") == 0
    assert imported.training["data"] == "imported from their model.pth"
    assert imported.training["fresh"] == []
    assert not imported.training["init_only"]
    assert len(imported.training["sha256"]) == 64


def test_half_precision_becomes_float32(thin_state: States, write: Write) -> None:
    state = {name: value.half() for name, value in thin_state().items()}
    imported = import_checkpoint(write(state), modality="depth")
    found = imported.model.backbone.trunk.conv1.weight
    assert found.dtype == torch.float32
    assert torch.equal(found, state["backbone.bottom_up.stem.conv1.weight"].float())


@pytest.mark.parametrize("dtype", [torch.int8, torch.int64, torch.bool])
def test_tensors_of_whole_numbers_are_refused(
    dtype: torch.dtype, thin_state: States, write: Write
) -> None:
    state, name = thin_state(), "backbone.fpn_output3.weight"
    path = write(state | {name: (100 * state[name]).to(dtype)})
    kind = str(dtype).removeprefix("torch.")
    with pytest.raises(CheckpointError) as caught:
        import_checkpoint(path)
    assert str(caught.value) == f"{path}: {name} is {kind}, expected floating-point numbers"


def test_a_weight_with_a_flipped_exponent_bit_is_refused(thin_state: States, write: Write) -> None:
    state, name = thin_state(), "roi_heads.box_head.fc1.weight"
    changed = state[name].clone()
    changed.flatten().view(torch.int32)[0] ^= 1 << 30
    path = write(state | {name: changed})
    with pytest.raises(CheckpointError) as caught:
        import_checkpoint(path)
    assert str(caught.value).startswith(f"{path}: {name} holds ")
    assert "expected -1e+06 to 1e+06; the file may be damaged" in str(caught.value)


def test_a_negative_variance_is_refused(thin_state: States, write: Write) -> None:
    state, name = thin_state(), "backbone.bottom_up.stem.conv1.norm.running_var"
    with pytest.raises(CheckpointError, match=r"running_var holds -1, expected 0 to 1e\+12"):
        import_checkpoint(write(state | {name: -state[name]}))
    path = write(state | {name: 1e7 * state[name]})
    assert import_checkpoint(path, height=64, width=96).preset == "r50"


def test_a_network_that_took_rgb_sees_the_same_in_our_bgr(
    imported: Imported, thin_state: States, write: Write
) -> None:
    state = thin_state()
    stem = "backbone.bottom_up.stem.conv1.weight"
    mean, std = torch.tensor(IMAGENET_MEAN), torch.tensor((1.0, 1.0, 1.0))
    state |= {stem: state[stem].flip(1), "pixel_mean": mean.flip(0), "pixel_std": std}
    turned = import_checkpoint(write(state), height=64, width=96)
    image = torch.randint(0, 256, (1, 64, 96, 3), dtype=torch.uint8)
    with torch.inference_mode():
        expected, found = (one.model.features(image)[0][3] for one in (imported, turned))
    assert torch.allclose(found, expected, atol=1e-5)


def test_tensors_that_do_not_fit_are_named_as_in_the_file(thin_state: States, write: Write) -> None:
    state = thin_state()
    del state["backbone.bottom_up.res3.1.conv2.norm.running_var"]
    state["roi_heads.stranger"] = torch.zeros(1)
    state["backbone.fpn_lateral4.bias"] = torch.zeros(9)
    with pytest.raises(CheckpointError) as caught:
        import_checkpoint(write(state))
    text = str(caught.value)
    assert "backbone.bottom_up.res3.1.conv2.norm.running_var is missing" in text
    assert "roi_heads.stranger is unexpected" in text
    assert "backbone.fpn_lateral4.bias has shape (9,), expected (16,)" in text
    state["another"] = state["one more"] = torch.zeros(1)
    with pytest.raises(CheckpointError, match=r"and 2 more$"):
        import_checkpoint(write(state))


def test_a_width_that_only_one_tensor_claims_takes_no_memory(
    thin_state: States, write: Write
) -> None:
    state = thin_state() | {"backbone.fpn_output2.weight": torch.zeros(500_000, 1, 1, 1)}
    with pytest.raises(CheckpointError, match="fpn_width is 500000, expected 1 to 4096"):
        import_checkpoint(write(state))


def test_starting_weights_leave_what_was_learnt_of_others_fresh(
    thin_spec: ModelSpec, thin_state: States, write: Write, detectron2_state: Callable[..., State]
) -> None:
    state = persons(thin_state())
    fitting = {f"{SCORE}.weight": torch.ones(2, 24), f"{SCORE}.bias": torch.ones(2)}
    state |= fitting  # for another class, although the shape is the same
    path = write({"model": state})
    torch.manual_seed(1)
    first = import_checkpoint(path, as_init=True)
    torch.manual_seed(2)
    rolled = torch.rand(3)
    torch.manual_seed(2)
    second = import_checkpoint(path, as_init=True)
    assert torch.equal(torch.rand(3), rolled)
    assert first.model.spec == thin_spec
    found, again = detectron2_state(first.model), detectron2_state(second.model)
    fresh = {f"{layer}.{kind}" for layer in (SCORE, SHIFT, HEAT) for kind in ("weight", "bias")}
    assert {their_name(name) for name in first.training["fresh"]} == fresh
    assert first.training["init_only"]
    for name, value in found.items():
        assert torch.equal(value, again[name]), name
        assert name in fresh or torch.equal(value, state[name]), name
    assert 0.005 < found[f"{SCORE}.weight"].std() < 0.02


def test_starting_weights_may_lack_branches_or_classes(thin_state: States, write: Write) -> None:
    state = persons(thin_state())
    bare = {k: v for k, v in state.items() if "mask_head" not in k and "keypoint_head" not in k}
    imported = import_checkpoint(write(bare), as_init=True)
    assert imported.model.spec.masks
    assert imported.model.spec.keypoints
    fresh = imported.training["fresh"]
    assert {name.split(".")[0] for name in fresh} == {"box_head", "mask_head", "keypoint_head"}
    assert "mask_head.tower.convs.0.weight" in fresh
    state["roi_heads.mask_head.predictor.weight"] = torch.ones(80, 8, 1, 1)
    state["roi_heads.mask_head.predictor.bias"] = torch.ones(80)
    fresh = import_checkpoint(write(state), as_init=True).training["fresh"]
    assert [name for name in fresh if name.startswith("mask_head")] == [
        "mask_head.score.weight",
        "mask_head.score.bias",
    ]
    fcn1 = "roi_heads.keypoint_head.conv_fcn1.bias"
    with pytest.raises(CheckpointError, match=r"conv_fcn1.bias is missing"):
        import_checkpoint(write({k: v for k, v in state.items() if k != fcn1}), as_init=True)
    del state["backbone.fpn_lateral3.weight"]
    with pytest.raises(CheckpointError, match=r"fpn_lateral3.weight is missing"):
        import_checkpoint(write(state), as_init=True)
