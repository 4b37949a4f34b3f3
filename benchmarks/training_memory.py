"""Memory of training over an epoch of many frames, which must not grow, and time to start.

python -m benchmarks.training_memory --result FILE.json [--frames 43000]

Makes a dataset of tiny distinct images with two trees each, as many as SynthTree43k has. Trains on
a part of it to make the cache, then opens the finished cache again and reads a whole epoch of
batches as the trainer does.
"""

from __future__ import annotations

import json
import os
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from basetree.files.writing import write_image
from benchmarks.tools.processes import memory_mib
from benchmarks.tools.program import finish, program
from perceptree.keypoints import KEYPOINT_NAMES
from perceptree.models import make_spec
from perceptree.training import DataSource, Engine, Preparing, TrainSettings
from perceptree.training.batches import SlotSampler, TrainingFrames, make_loader
from perceptree.training.source import open_data

WIDTH_PX, HEIGHT_PX = 64, 36
BATCH = 8


def write_split(folder: Path, split: str, first: int, frames: int) -> None:
    """Write a split: images of noise from different seeds, with two boxes each."""
    images: list[dict[str, Any]] = []
    annotations: list[dict[str, Any]] = []
    for number in range(first, first + frames):
        rng = np.random.default_rng(number)
        name = f"depth8/{number:06d}.png"
        write_image(folder / name, rng.integers(0, 256, (HEIGHT_PX, WIDTH_PX), np.uint8))
        images.append(
            {
                "id": number,
                "file_name": name,
                "depth8_file": name,
                "width": WIDTH_PX,
                "height": HEIGHT_PX,
            }
        )
        for left in (8, 40):
            x0, x1, y0, y1 = left, left + 8, 4, 32
            points = [x0 + 4, y1 - 1, x0, y1 - 4, x1, y1 - 4, x0 + 4, y1 - 9, x0 + 4, y0 + 8]
            annotations.append(
                {
                    "id": len(annotations) + 1,
                    "image_id": number,
                    "category_id": 1,
                    "bbox": [x0, y0, x1 - x0, y1 - y0],
                    "iscrowd": 0,
                    "area": (x1 - x0) * (y1 - y0),
                    "segmentation": [[x0, y0, x1, y0, x1, y1, x0, y1]],
                    "keypoints": [
                        v for x, y in zip(points[::2], points[1::2], strict=True) for v in (x, y, 2)
                    ],
                }
            )
    content = {
        "images": images,
        "annotations": annotations,
        "categories": [{"id": 1, "name": "tree", "keypoints": list(KEYPOINT_NAMES)}],
    }
    (folder / f"{split}_RGB.json").write_text(json.dumps(content))


def main() -> None:
    """Run all measurements and write the result."""
    parser = program(__doc__)
    parser.add_argument("--frames", type=int, default=43_000)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "depth8").mkdir()
        write_split(folder, "train", 0, arguments.frames)
        write_split(folder, "val", arguments.frames, 8)
        spec, settings = make_spec("edge-n", "depth", 64, 96), TrainSettings(steps=1, batch=BATCH)
        start_s = time.perf_counter()
        made = open_data(DataSource(folder), spec, Engine(), Preparing())
        making_s = time.perf_counter() - start_s
        del made
        start_s = time.perf_counter()
        data = open_data(DataSource(folder), spec, Engine(), Preparing())
        frames = TrainingFrames(data.frames, spec, settings)
        batches = iter(make_loader(frames, SlotSampler(settings, 0, 0, 1), 0, pinned=False))
        next(batches)
        opening_s = time.perf_counter() - start_s
        steps = arguments.frames // BATCH
        private_mib: dict[str, float] = {}
        for step in range(1, steps):
            next(batches)
            if step % (steps // 10) == 0:
                used_mib = memory_mib("self", "status", "RssAnon")
                private_mib[str(step * BATCH)] = round(used_mib, 1)
        result = {
            "frames": arguments.frames,
            "cores": os.cpu_count(),
            "making_cache_s": round(making_s, 1),
            "start_with_ready_cache_s": round(opening_s, 2),
            "private_memory_mib_by_frames": private_mib,
        }
    finish(result, arguments.result)


if __name__ == "__main__":
    main()
