"""Make what the development environment makes: this project's networks, and torchvision's file.

The weights are untrained and give as many detections as trained ones, as those of `edgetree bench`.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import numpy as np
import torch
from torchvision.models.detection import maskrcnn_resnet50_fpn

from edgetree.export import ExportSettings
from edgetree.export.models import untrained_model
from edgetree.export.quiet import quiet

DETECTIONS = 20  # as many as this project's networks give


def parameters(network: torch.nn.Module) -> int:
    """Number of parameters."""
    return sum(each.numel() for each in network.parameters())


def save_preset(preset: str, path: Path, side_px: int) -> int:
    """Save an untrained network of this project; returns its parameters."""
    model = untrained_model(preset, "rgb", ExportSettings(side_px, side_px))
    torch.save(model, path)
    return parameters(model)


def export_torchvision(path: Path, side_px: int) -> int:
    """Export torchvision's Mask R-CNN by its own exporter; returns its parameters.

    It finds one class, like this project's networks, and no score is too low, so that the untrained
    network gives detections.
    """
    torch.manual_seed(0)
    network = maskrcnn_resnet50_fpn(
        weights=None,
        weights_backbone=None,
        num_classes=2,
        min_size=side_px,
        max_size=side_px,
        box_detections_per_img=DETECTIONS,
        box_score_thresh=0.0,
    ).eval()
    frame = torch.rand(3, side_px, side_px)
    torch.onnx.export(
        network, ([frame],), path, dynamo=False, opset_version=17, input_names=["image"]
    )
    return parameters(network)


def main() -> None:
    """Make a network's file and print its number of parameters."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("network", help="a preset of this project, or maskrcnn-r50-fpn")
    parser.add_argument("folder", type=Path)
    parser.add_argument("frames", type=Path, help="(N, S, S, 3) uint8 BGR, .npy")
    arguments = parser.parse_args()
    side_px = np.load(arguments.frames, mmap_mode="r").shape[1]
    with quiet():
        if arguments.network == "maskrcnn-r50-fpn":
            count = export_torchvision(arguments.folder / "float32.onnx", side_px)
        else:
            count = save_preset(arguments.network, arguments.folder / "network.pt", side_px)
    sys.stdout.write("\n" + json.dumps({"parameters": count}) + "\n")


if __name__ == "__main__":
    main()
