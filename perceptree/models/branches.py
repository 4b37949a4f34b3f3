"""Networks of colour and depth made of two networks of one input, and taken apart again."""

from __future__ import annotations

import dataclasses
from typing import Any, Literal

import torch
from torch import Tensor

from perceptree.models.detector import TreeRCNN
from perceptree.models.presets import COLOUR_REDUCTION
from perceptree.models.spec import ModelSpec, SpecError

Inputs = Literal["both", "depth", "colour"]

_BACKBONE, _COLOUR_BACKBONE = "backbone.", "colour_backbone."
_LATERAL, _COLOUR_LATERAL = "pyramid.lateral.", "colour_lateral."
_COLOUR_FIELDS: dict[str, Any] = {
    entry.name: entry.default
    for entry in dataclasses.fields(ModelSpec)
    if entry.name.startswith("colour_")
}


def joined_spec(
    depth: ModelSpec, colour: ModelSpec, name: str, colour_reduction: int = COLOUR_REDUCTION
) -> ModelSpec:
    """The network of both inputs that a network of depth becomes with a colour backbone.

    Args:
        depth: The network of depth, whose pyramid and heads stay.
        colour: The network of colour, of which the backbone is taken.
        name: Name of the model.
        colour_reduction: As in the spec.

    Raises:
        SpecError: If they are not a network of depth and one of colour, or the colour backbone
            has its strides in 1x1 convolutions.
    """
    if (depth.modality, colour.modality) != ("depth", "rgb"):
        raise SpecError(
            f"the networks are for {depth.modality} and {colour.modality}, expected depth and rgb"
        )
    if colour.stride_in_1x1:
        raise SpecError(f"stride_in_1x1 is true for {colour.name}, expected false for both inputs")
    return dataclasses.replace(
        depth,
        name=name,
        modality="both",
        colour_backbone=colour.backbone,
        colour_mean=colour.mean,
        colour_std=colour.std,
        colour_pad_value=colour.pad_value,
        colour_reduction=colour_reduction,
    )


def load_branches(model: TreeRCNN, depth: TreeRCNN, colour: TreeRCNN) -> None:
    """Load the weights of a network of depth, and the backbone of one of colour.

    The result finds what the network of depth finds, until it is trained.

    Args:
        model: A network of `joined_spec`, which is changed.
        depth: The network of depth.
        colour: The network of colour.
    """
    assert model.colour_backbone is not None
    model.load_state_dict(model.state_dict() | depth.state_dict())
    theirs = colour.backbone.state_dict()
    own = model.colour_backbone.state_dict()
    model.colour_backbone.load_state_dict({name: theirs[name] for name in own})


def pruned(model: TreeRCNN, inputs: Inputs) -> TreeRCNN:
    """The network of one input that a network of both is where the other image shows nothing.

    Args:
        model: A network of both inputs; or of one, which is returned for `both`.
        inputs: What the result takes.

    Raises:
        SpecError: If the network does not have both inputs.
    """
    if inputs == "both" or model.spec.modality == {"depth": "depth", "colour": "rgb"}[inputs]:
        return model
    if model.spec.modality != "both":
        raise SpecError(f"the network takes {model.spec.modality}, expected one of both inputs")
    state = model.state_dict()
    if inputs == "colour":
        state = _as_main_branch(state, model.spec)
    else:
        spec = dataclasses.replace(
            model.spec, name=f"{model.spec.name}-depth", modality="depth", **_COLOUR_FIELDS
        )
        state = {name: x for name, x in state.items() if not name.startswith("colour_")}
    made = TreeRCNN(_colour_spec(model.spec) if inputs == "colour" else spec)
    made.load_state_dict(state)
    return made.train(model.training)


def _colour_spec(spec: ModelSpec) -> ModelSpec:
    assert spec.colour_backbone is not None
    return dataclasses.replace(
        spec,
        name=f"{spec.name}-rgb",
        modality="rgb",
        backbone=spec.colour_backbone,
        mean=spec.colour_mean,
        std=spec.colour_std,
        pad_value=spec.colour_pad_value,
        reduction=spec.colour_reduction,
        depth_encoding=None,
        stride_in_1x1=False,
        **_COLOUR_FIELDS,
    )


def _as_main_branch(state: dict[str, Tensor], spec: ModelSpec) -> dict[str, Tensor]:
    """The weights with the colour branch in the place of the depth's."""
    made = {
        name: x
        for name, x in state.items()
        if not name.startswith((_BACKBONE, "colour_", _LATERAL))
    }
    for name, x in state.items():
        if name.startswith(_COLOUR_BACKBONE):
            made[_BACKBONE + name.removeprefix(_COLOUR_BACKBONE)] = x
    for level in range(len(spec.backbone_levels)):
        weight, bias = (state[f"{_COLOUR_LATERAL}{level}.{part}"] for part in ("weight", "bias"))
        place = f"{_LATERAL}{level}."
        if not spec.fpn_norm:
            made |= {f"{place}weight": weight, f"{place}bias": bias}
            continue
        # The pyramid's convolution has a batch norm in place of a bias: one that only adds it.
        norm = torch.nn.BatchNorm2d(len(bias))
        made[f"{place}0.weight"] = weight
        made |= {f"{place}1.{name}": x for name, x in norm.state_dict().items()}
        made[f"{place}1.weight"] = torch.full_like(bias, (1.0 + norm.eps) ** 0.5)
        made[f"{place}1.bias"] = bias
    return made
