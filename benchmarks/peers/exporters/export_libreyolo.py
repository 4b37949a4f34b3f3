"""Make the file of DEIMv2's smallest network, as LibreYOLO builds it, with untrained weights."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import numpy as np
import torch
from libreyolo.models.deimv2 import nn

SIZE = "atto"


def main() -> None:
    """Make the file and print the network's number of parameters."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("network", choices=[f"deimv2-{SIZE}"])
    parser.add_argument("folder", type=Path)
    parser.add_argument("frames", type=Path, help="(N, S, S, 3) uint8 BGR, .npy")
    arguments = parser.parse_args()
    side_px = np.load(arguments.frames, mmap_mode="r").shape[1]
    nn.SIZE_CONFIGS[SIZE]["decoder"]["eval_spatial_size"] = [side_px, side_px]
    torch.manual_seed(0)
    network = nn.LibreDEIMv2Model(SIZE)
    count = sum(each.numel() for each in network.parameters())
    torch.onnx.export(
        nn.DEIMv2ExportWrapper(network.eval()),
        (torch.rand(1, 3, side_px, side_px),),
        arguments.folder / "float32.onnx",
        dynamo=False,
        opset_version=17,
        input_names=["image"],
    )
    sys.stdout.write("\n" + json.dumps({"parameters": count}) + "\n")


if __name__ == "__main__":
    main()
