"""Make the file of one RF-DETR network by its package's own export, with untrained weights."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import numpy as np
from rfdetr import RFDETRNano, RFDETRSegNano

# With their patch sizes, px. As these differ from DINOv2's 14 px, the package fetches no weights.
NETWORKS = {"rf-detr-nano": (RFDETRNano, 16), "rf-detr-seg-nano": (RFDETRSegNano, 12)}


def main() -> None:
    """Make the file and print the network's number of parameters."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("network", choices=NETWORKS)
    parser.add_argument("folder", type=Path)
    parser.add_argument("frames", type=Path, help="(N, S, S, 3) uint8 BGR, .npy")
    arguments = parser.parse_args()
    side_px = np.load(arguments.frames, mmap_mode="r").shape[1]
    build, patch_px = NETWORKS[arguments.network]
    network = build(
        pretrain_weights=None,
        resolution=side_px,
        positional_encoding_size=side_px // patch_px,
        device="cpu",
    )
    count = sum(each.numel() for each in network.model.model.parameters())
    made = network.export(str(arguments.folder), shape=(side_px, side_px), verbose=False)
    Path(made).rename(arguments.folder / "float32.onnx")
    sys.stdout.write("\n" + json.dumps({"parameters": count}) + "\n")


if __name__ == "__main__":
    main()
