"""Make what the development environment makes: this project's networks, and torchvision's files.

The weights are untrained and give as many detections as trained ones, as those of `edgetree bench`.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torchvision.models.detection import keypointrcnn_resnet50_fpn, maskrcnn_resnet50_fpn
from torchvision.models.detection.mask_rcnn import MaskRCNNHeads, MaskRCNNPredictor
from torchvision.ops import MultiScaleRoIAlign

from edgetree import KEYPOINT_NAMES
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


def torchvision_network(name: str, side_px: int) -> torch.nn.Module:
    """torchvision's Mask R-CNN, or the same with keypoints.

    It finds one class, like this project's networks, and no score is too low, so that the untrained
    network gives detections.
    """
    torch.manual_seed(0)
    shared: dict[str, Any] = {
        "weights": None,
        "weights_backbone": None,
        "num_classes": 2,
        "min_size": side_px,
        "max_size": side_px,
        "box_detections_per_img": DETECTIONS,
        "box_score_thresh": 0.0,
    }
    if name == "maskrcnn-r50-fpn":
        masks: torch.nn.Module = maskrcnn_resnet50_fpn(**shared)
        return masks.eval()
    network: Any = keypointrcnn_resnet50_fpn(num_keypoints=len(KEYPOINT_NAMES), **shared)
    heads = network.roi_heads
    heads.mask_roi_pool = MultiScaleRoIAlign(["0", "1", "2", "3"], 14, 2)
    heads.mask_head = MaskRCNNHeads(256, (256,) * 4, 1)
    heads.mask_predictor = MaskRCNNPredictor(256, 256, 2)
    whole: torch.nn.Module = network.eval()
    return whole


def export_torchvision(name: str, folder: Path, side_px: int) -> int:
    """Save a network of torchvision, and export it by its own exporter; returns its parameters."""
    network = torchvision_network(name, side_px)
    torch.save(network, folder / "network.pt")
    frame = torch.rand(3, side_px, side_px)
    torch.onnx.export(
        network,
        ([frame],),
        folder / "float32.onnx",
        dynamo=False,
        opset_version=17,
        input_names=["image"],
    )
    return parameters(network)


def main() -> None:
    """Make a network's file and print its number of parameters."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("network", help="a preset of this project, or torchvision's network")
    parser.add_argument("folder", type=Path)
    parser.add_argument("frames", type=Path, help="(N, S, S, 3) uint8 BGR, .npy")
    arguments = parser.parse_args()
    side_px = np.load(arguments.frames, mmap_mode="r").shape[1]
    with quiet():
        if "rcnn" in arguments.network:
            count = export_torchvision(arguments.network, arguments.folder, side_px)
        else:
            count = save_preset(arguments.network, arguments.folder / "network.pt", side_px)
    sys.stdout.write("\n" + json.dumps({"parameters": count}) + "\n")


if __name__ == "__main__":
    main()
