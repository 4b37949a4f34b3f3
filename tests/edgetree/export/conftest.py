"""A small network whose answers are lively without training, and frames for it."""

import dataclasses
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from calib import write_depth
from perceptree.models import TreeRCNN, make_spec, save_checkpoint

HEIGHT, WIDTH = 96, 160


def lively_model(modality: str = "rgb", **changes: object) -> TreeRCNN:
    """Random weights, the last layers so strong that scores and heat maps have clear peaks."""
    torch.manual_seed(1)
    spec = make_spec("edge-n", modality, HEIGHT, WIDTH)  # type: ignore[arg-type]
    model = TreeRCNN(dataclasses.replace(spec, fpn_width=32, **changes))  # type: ignore[arg-type]
    shape = (8, *((HEIGHT, WIDTH, 3) if modality == "rgb" else (HEIGHT, WIDTH)))
    with torch.no_grad():
        for _ in range(30):  # gives batch norm the statistics that training would
            model.features(torch.randint(0, 256, shape, dtype=torch.uint8))
        model.proposer.objectness.weight.mul_(100)
        model.box_head.score.weight.mul_(10)
        if model.keypoint_head is not None:
            model.keypoint_head.tower.up.weight.mul_(100)
        if model.mask_head is not None:
            model.mask_head.score.weight.mul_(20)
    return model.eval()


@pytest.fixture(scope="session")
def rgb_checkpoint(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("checkpoints") / "rgb.safetensors"
    save_checkpoint(path, lively_model("rgb"), {"data": "random numbers"})
    return path


@pytest.fixture(scope="session")
def depth_checkpoint(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("checkpoints") / "depth.safetensors"
    save_checkpoint(path, lively_model("depth", masks=False), {"data": "random numbers"})
    return path


@pytest.fixture(scope="session")
def frame_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Like a data set's folder: images and metric depth, larger than the input."""
    folder = tmp_path_factory.mktemp("frames")
    random = np.random.default_rng(3)
    (folder / "images").mkdir()
    (folder / "depth").mkdir()
    for number in range(6):
        coarse = random.integers(0, 256, (9, 16, 3), dtype=np.uint8)
        image = cv2.resize(coarse, (320, 180), interpolation=cv2.INTER_CUBIC)
        cv2.imwrite(str(folder / "images" / f"{number:06d}.png"), image)
        depth_m = image[..., 0].astype(np.float32) / 20
        write_depth(folder / "depth" / f"{number:06d}.png", depth_m)
    return folder
