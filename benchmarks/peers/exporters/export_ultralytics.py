"""Make the files of one YOLO network by its package's own exports, with untrained weights.

Runs in the environment of the package, which is under AGPL-3.0. The INT8 files come from the
package's own quantisation, calibrated on the frames. YOLO26 is exported with its head that needs no
non-maximum suppression.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np
from ultralytics import YOLO

CLASSES, KEYPOINTS = 80, 17  # of the package's networks
FILES = {
    "float32.onnx": ("onnx", 32),
    "int8.onnx": ("onnx", 8),
    "float32.xml": ("openvino", 32),
    "int8.xml": ("openvino", 8),
}


def write_dataset(frames: Path, folder: Path) -> Path:
    """Write frames as a dataset without labels; returns the file that describes it."""
    (folder / "images").mkdir()
    for index, frame in enumerate(np.load(frames)):
        encoded = cv2.imencode(".png", frame)[1]
        (folder / "images" / f"{index}.png").write_bytes(encoded.tobytes())
    described = {
        "path": str(folder),
        "train": "images",
        "val": "images",
        "names": {index: str(index) for index in range(CLASSES)},
        "kpt_shape": [KEYPOINTS, 3],
    }
    path = folder / "data.yaml"
    path.write_text(json.dumps(described), encoding="utf-8")  # JSON is YAML too
    return path


def export(name: str, file: Path, side_px: int, data: Path) -> int:
    """Make one file of a network; returns the network's parameters."""
    kind, bits = FILES[file.name]
    model = YOLO(f"{name}.yaml")
    parameters: int = sum(each.numel() for each in model.model.parameters())
    nms = False if name.startswith("yolo26") else None  # False: the head without suppression
    made = model.export(
        format=kind, imgsz=side_px, quantize=bits, data=str(data), nms=nms, device="cpu"
    )
    if kind == "onnx":
        Path(made).rename(file)
        return parameters
    for suffix in (".xml", ".bin"):
        next(Path(made).glob(f"*{suffix}")).rename(file.with_suffix(suffix))
    return parameters


def main() -> None:
    """Make all files of a network and print its number of parameters."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("network", help="such as yolo11n-seg")
    parser.add_argument("folder", type=Path)
    parser.add_argument("frames", type=Path, help="(N, S, S, 3) uint8 BGR, .npy")
    arguments = parser.parse_args()
    folder, frames = arguments.folder.absolute(), arguments.frames.absolute()
    side_px = np.load(frames, mmap_mode="r").shape[1]
    parameters = 0
    with tempfile.TemporaryDirectory() as scratch:
        os.chdir(scratch)  # where the package writes
        data = write_dataset(frames, Path(scratch))
        for name in FILES:
            parameters = export(arguments.network, folder / name, side_px, data)
    sys.stdout.write("\n" + json.dumps({"parameters": parameters}) + "\n")


if __name__ == "__main__":
    main()
