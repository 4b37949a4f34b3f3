"""Time of augmenting a frame, compared with torchvision's v2 transforms.

python -m benchmarks.augment --result benchmarks/results/augment.json

Result: for image and labels, v2 takes as long for mirroring and 1.5 to 30 times as long for all
other changes. Mirroring costs nothing here, as it is part of another step. Training does not use
v2.

One thread; a 640x384 frame with four trees and their boxes, keypoints and masks. Each value is the
mean over random draws of the minimum CPU time of several rounds, in which both implementations
alternate, so that other load on the machine matters little. v2 does not support keypoint flags,
swapping left and right keypoints, or removing trees outside the frame.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import cv2
import numpy as np
import torch
import torchvision
from torchvision import tv_tensors
from torchvision.transforms import v2

from benchmarks.scratch import CANDIDATES
from benchmarks.tools.program import finish, machine, program
from benchmarks.tools.timing import time_ms
from perceptree.data import AugmentSettings, Sample, augment
from perceptree.data.augment import PAPER_AUGMENT
from perceptree.models import make_spec

HEIGHT_PX, WIDTH_PX, TREES = 384, 640, 4
ROUNDS = 8
TARGET_MS = {"depth": 3.0, "rgb": 6.0}
STILL = AugmentSettings(
    flip_share=0,
    scale=(1, 1),
    saturation=0,
    tone_share=0,
    noise_share=0,
    blur_share=0,
    depth_gain=0,
    depth_noise=0,
    holes=0,
)
TONE: dict[str, Any] = {"tone_share": 1, "brightness": 0.3, "contrast": 0.3, "gamma": 0, "tint": 0}
ALL: dict[str, Any] = {
    "flip_share": 0.5,
    "scale": (0.8, 1.4),
    "rotation_deg": 5,
    "perspective": 0.12,
    "perspective_share": 0.2,
    "saturation": 0.5,
    "noise_share": 1,
    "noise": 8,
    **TONE,
}
STRONG, FAULTS = (CANDIDATES[name][1]["augment"] for name in ("colours", "faults"))


@dataclass(frozen=True)
class Pair:
    """The same change of colour frames by this project and by v2."""

    ours: AugmentSettings
    theirs: v2.Transform


def pairs() -> dict[str, Pair]:
    """The compared changes by name; the last one combines all changes that both support."""
    move = v2.RandomAffine(0, translate=(0.2, 0.2), scale=(0.8, 1.4))
    turn = v2.RandomAffine(5, translate=(0.2, 0.2), scale=(0.8, 1.4))
    bend = v2.RandomPerspective(0.24, p=1)
    jitter = v2.ColorJitter(brightness=0.3, contrast=0.3, saturation=0.5)
    noise = v2.Compose(
        [
            v2.ToDtype({tv_tensors.Image: torch.float32, "others": None}, scale=True),
            v2.GaussianNoise(sigma=8 / 255 / 2),
            v2.ToDtype({tv_tensors.Image: torch.uint8, "others": None}, scale=True),
        ]
    )
    everything = v2.Compose(
        [v2.RandomHorizontalFlip(0.5), turn, v2.RandomPerspective(0.24, p=0.2), jitter, noise]
    )
    return {
        "flip": Pair(replace(STILL, flip_share=1), v2.RandomHorizontalFlip(1)),
        "scale and shift": Pair(replace(STILL, scale=(0.8, 1.4)), move),
        "rotation, scale and shift": Pair(replace(STILL, scale=(0.8, 1.4), rotation_deg=5), turn),
        "perspective": Pair(replace(STILL, perspective=0.12), bend),
        "brightness, contrast and saturation": Pair(replace(STILL, saturation=0.5, **TONE), jitter),
        "noise": Pair(replace(STILL, noise_share=1, noise=8), noise),
        "blur": Pair(replace(STILL, blur_share=1, blur_px=2), v2.GaussianBlur(9, (0.2, 2))),
        "JPEG": Pair(replace(STILL, jpeg_share=1), v2.JPEG((30, 95))),
        "all of them but blur and JPEG": Pair(replace(STILL, **ALL), everything),
    }


def frame(modality: str) -> Sample:
    """A frame of uniform noise with four posts as trees."""
    rng = np.random.default_rng(0)
    noise = rng.integers(0, 256, (HEIGHT_PX, WIDTH_PX, 3), dtype=np.uint8)
    image = np.asarray(cv2.GaussianBlur(noise, (9, 9), 3), np.uint8)
    masks = np.zeros((TREES, HEIGHT_PX, WIDTH_PX), bool)
    boxes = np.array([[40.0 + 150 * row, 60, 80 + 150 * row, 330] for row in range(TREES)])
    for mask, (x0, y0, x1, y1) in zip(masks, boxes.astype(int), strict=True):
        mask[y0:y1, x0:x1] = True
    keypoints = np.concatenate(
        [np.tile(boxes[:, None, :2] + 20, (1, 5, 1)), np.full((TREES, 5, 1), 2.0)], -1
    )
    return Sample(image if modality == "rgb" else image[..., 0].copy(), boxes, keypoints, masks)


def for_v2(sample: Sample) -> dict[str, torch.Tensor]:
    """Convert a frame to v2's data types."""
    assert sample.masks is not None
    size = (HEIGHT_PX, WIDTH_PX)
    return {
        "image": tv_tensors.Image(torch.from_numpy(sample.image).permute(2, 0, 1)),
        "boxes": tv_tensors.BoundingBoxes(
            torch.from_numpy(sample.boxes), format="XYXY", canvas_size=size
        ),
        "keypoints": tv_tensors.KeyPoints(
            torch.from_numpy(sample.keypoints[..., :2].reshape(-1, 2)), canvas_size=size
        ),
        "masks": tv_tensors.Mask(torch.from_numpy(sample.masks)),
    }


def processor_ms(calls: list[Callable[[int], object]], draws: int) -> list[float]:
    """CPU time of each call, ms. The calls alternate, and get the number of the draw."""
    fastest = np.full((len(calls), draws), np.inf)
    for _ in range(ROUNDS):
        for draw in range(draws):
            for row, call in enumerate(calls):
                taken_ms = time_ms(partial(call, draw), time.thread_time)
                fastest[row, draw] = min(fastest[row, draw], taken_ms)
    return [round(statistics.mean(times), 2) for times in fastest.tolist()]


def ours(modality: Any, settings: AugmentSettings) -> Callable[[int], Sample]:
    """Make a call of this project's augmentation."""
    sample, spec = frame(modality), make_spec("edge-n", modality, HEIGHT_PX, WIDTH_PX)
    return lambda draw: augment(np.random.default_rng(draw), sample, spec, settings, lambda: sample)


def compare(pair: Pair, draws: int) -> dict[str, float]:
    """Measure one change by both implementations, ms."""
    inputs = for_v2(frame("rgb"))

    def theirs(draw: int) -> object:
        torch.manual_seed(draw)
        return pair.theirs(inputs)

    own_ms, v2_ms = processor_ms([ours("rgb", pair.ours), theirs], draws)
    return {"ours_ms": own_ms, "v2_ms": v2_ms, "v2_over_ours": round(v2_ms / own_ms, 1)}


def recipes(draws: int) -> dict[str, float]:
    """Measure complete augmentation settings, ms."""
    pasting = replace(AugmentSettings(), copy_paste_share=1)
    chosen = {
        "depth, default": ours("depth", AugmentSettings()),
        "rgb, default": ours("rgb", AugmentSettings()),
        "rgb, paper": ours("rgb", PAPER_AUGMENT),
        "rgb, strong colours": ours("rgb", STRONG),
        "depth, all faults": ours("depth", FAULTS),
        "depth, copy-paste": ours("depth", pasting),
        "rgb, copy-paste": ours("rgb", pasting),
    }
    return {name: processor_ms([call], draws)[0] for name, call in chosen.items()}


def main() -> None:
    """Measure all settings, and all changes beside v2's."""
    parser = program(__doc__)
    parser.add_argument("--draws", type=int, default=40)
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    torch.set_num_threads(1)
    times = recipes(arguments.draws)
    result = {
        "machine": machine(),
        "torchvision": torchvision.__version__,
        "opencv": cv2.__version__,
        "frame": f"{WIDTH_PX}x{HEIGHT_PX}, {TREES} trees",
        "draws": arguments.draws,
        "settings_ms": times,
        "target_ms": {f"{name}, default": limit for name, limit in TARGET_MS.items()},
        "missed": [name for name, limit in TARGET_MS.items() if times[f"{name}, default"] > limit],
        "beside_v2": {name: compare(pair, arguments.draws) for name, pair in pairs().items()},
    }
    finish(result, arguments.result)


if __name__ == "__main__":
    main()
