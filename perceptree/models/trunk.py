"""Backbones and feature pyramid of a network: from images to maps."""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from typing import Self

import torch
from torch import Tensor, nn

from perceptree.models.backbones import Backbone
from perceptree.models.fpn import FeaturePyramid
from perceptree.models.inputs import COLOUR, DEPTH, Images, by_name, normalised, reduced
from perceptree.models.spec import ModelSpec


class Trunk(nn.Module):
    """The part of a network before its heads, with random weights.

    It takes images as uint8 tensors of the spec's size: (B, H, W, 3) BGR, or (B, H, W) encoded
    depth. A network of both inputs takes (B, H, W, 4), or the two by name, of which one may be
    missing (`perceptree.models.inputs`). The maps of its colour backbone are added to those of the
    depth at the pyramid, by `colour_lateral`, whose weights begin at zero. An image that shows
    nothing adds nothing.

    Args:
        spec: Architecture and input of the network.

    Attributes:
        spec: As given.
        mean: (C, 1, 1) mean of the input per channel, in 8-bit units.
        std: (C, 1, 1) standard deviation of the input per channel, in 8-bit units.
        colour_mean: Of the colour image of a network of both inputs, likewise; else empty.
        colour_std: Likewise.

    Raises:
        SpecError: If the spec's backbone cannot be built.
    """

    mean: Tensor
    std: Tensor
    colour_mean: Tensor
    colour_std: Tensor

    def __init__(self, spec: ModelSpec) -> None:
        super().__init__()
        self.spec = spec
        self.backbone = Backbone(
            spec.backbone, spec.channels, spec.backbone_levels, spec.stride_in_1x1
        )
        level_6 = spec.levels[-1] == 6
        self.pyramid = FeaturePyramid(
            self.backbone.channels, spec.fpn_width, spec.fpn_norm, level_6
        )
        self.blend = Blend()
        self.colour_backbone: Backbone | None = None
        self.colour_lateral: nn.ModuleList | None = None
        if spec.colour_backbone is not None:
            self.colour_backbone = Backbone(spec.colour_backbone, 3, spec.colour_backbone_levels)
            self.colour_lateral = _zero_lateral(self.colour_backbone.channels, spec.fpn_width)
        for name in ("mean", "std", "colour_mean", "colour_std"):
            values = torch.tensor(getattr(spec, name))[:, None, None]
            self.register_buffer(name, values, persistent=False)
        self._fixed: list[nn.Module] = []

    @property
    def backbones(self) -> list[Backbone]:
        """The backbone, and the colour backbone where there is one."""
        return [part for part in (self.backbone, self.colour_backbone) if part is not None]

    def normalise(self, images: Tensor) -> Tensor:
        """Prepare the images of `backbone`, see `perceptree.models.inputs.normalised`."""
        std = self.std if _scales(self.spec.std) else None
        return reduced(normalised(images, self.mean, std), self.spec.reduction)

    def normalise_colour(self, images: Tensor) -> Tensor:
        """Prepare the colour images of a network of both inputs."""
        std = self.colour_std if _scales(self.spec.colour_std) else None
        return reduced(normalised(images, self.colour_mean, std), self.spec.colour_reduction)

    def maps(self, images: Images) -> dict[int, Tensor]:
        """Compute the pyramid's maps of uint8 images by level, (B, width, h, w) each.

        Raises:
            ValueError: If the images are not of the spec's kinds, dtype or shape.
        """
        found = by_name(images, self.spec)
        if self.spec.modality == "both":
            maps = self.pyramid(self._blended(found), lateral=True)
        else:
            (values,) = found.values()
            maps = self.pyramid(self.backbone(self.normalise(values)))
        return dict(zip(self.spec.levels, maps, strict=True))

    def _blended(self, images: dict[str, Tensor]) -> list[Tensor]:
        """The lateral maps of the pyramid from colour and depth, or from one of them."""
        assert self.spec.depth_encoding is not None
        nothing = {COLOUR: 0, DEPTH: int(self.spec.depth_encoding["invalid_value"])}
        shown = {name: _shows(values, nothing[name]) for name, values in images.items()}
        parts = [self._lateral_of(name, values, shown[name]) for name, values in images.items()]
        blended: list[Tensor] = self.blend(parts, list(shown.values()))
        return blended

    def _lateral_of(self, name: str, images: Tensor, shown: Tensor) -> list[Tensor]:
        """The lateral maps of one of two inputs.

        In training, images that show nothing have no part in the statistics of batch norms. If none
        shows anything the layers get no image, so that their weights still have gradients.
        """
        if not self.training:
            return self._lateral(name, images)
        (rows,) = shown.nonzero(as_tuple=True)
        maps = self._lateral(name, images[rows])
        return [x.new_zeros(len(images), *x.shape[1:]).index_copy(0, rows, x) for x in maps]

    def _lateral(self, name: str, images: Tensor) -> list[Tensor]:
        """The pyramid's lateral maps of one of two inputs, finest first."""
        if name == DEPTH:
            return self.pyramid.laterals(self.backbone(self.normalise(images)))
        assert self.colour_backbone is not None
        assert self.colour_lateral is not None
        maps = self.colour_backbone(self.normalise_colour(images))
        return [layer(x) for layer, x in zip(self.colour_lateral, maps, strict=True)]

    def freeze(self, level: int = 0, norms: bool = False) -> None:
        """Exclude parts of the backbones from training, in place of those excluded before.

        Args:
            level: Freeze everything up to the maps of stride `2**level`; 0 freezes nothing, 2
                is Detectron2's FREEZE_AT 2.
            norms: Freeze all batch norms of the backbones, as Detectron2 does.
        """
        factors = self.spec.reduction, self.spec.colour_reduction
        stages = [
            part
            for whole, factor in zip(self.backbones, factors, strict=False)
            for reached, part in whole.stages()
            if factor * 2**reached <= 2**level
        ]
        kinds = [
            part
            for whole in self.backbones
            for part in whole.modules()
            if isinstance(part, nn.modules.batchnorm._BatchNorm)
        ]
        for part in self._fixed:
            part.requires_grad_(True)
        self._fixed = [*stages, *(kinds if norms else [])]
        for part in self._fixed:
            part.requires_grad_(False)
        self.train(self.training)

    def train(self, mode: bool = True) -> Self:
        """Set training or eval mode as in torch; frozen parts stay in eval mode."""
        super().train(mode)
        for part in self._fixed:
            part.eval()
        return self


class Blend(nn.Module):
    """The sum of the maps of several inputs; images that show nothing add nothing.

    It is a module so that exports know its operators.
    """

    def forward(self, parts: list[list[Tensor]], shown: list[Tensor]) -> list[Tensor]:
        """Add maps.

        Args:
            parts: Of each input, (B, C, h, w) maps by level.
            shown: Of each input, (B,) bool, which images show something.
        """
        factors = [each[:, None, None, None] for each in shown]
        scaled = [
            [x * factor.to(x.dtype) for x in maps]
            for maps, factor in zip(parts, factors, strict=True)
        ]
        return [reduce(torch.add, levels) for levels in zip(*scaled, strict=True)]


def _shows(images: Tensor, nothing: int) -> Tensor:
    """Which images of a uint8 batch hold anything but one value: (B,) bool."""
    flat = images.flatten(1)
    return (flat.amax(1) != nothing) | (flat.amin(1) != nothing)


def _scales(std: Sequence[float]) -> bool:
    return any(each != 1.0 for each in std)


def _zero_lateral(channels: Sequence[int], width: int) -> nn.ModuleList:
    """Convolutions of 1x1 from a backbone's maps to the pyramid, with weights of zero."""
    layers = nn.ModuleList(nn.Conv2d(each, width, 1) for each in channels)
    for parameter in layers.parameters():
        nn.init.zeros_(parameter)
    return layers
