"""Eager CPU inference of the paper's networks compared with torchvision, with a time profile.

python benchmarks/eager.py --result benchmarks/results/eager.json

All networks have random weights and process one 1280x720 frame with 1,000 proposals and 20
detections with masks and keypoints. torchvision's network alternates with each of this project's,
so that the ratio is valid on a machine with other load. Peak memory is measured in a separate
process.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import platform
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
from torchvision.models.detection import keypointrcnn_resnet50_fpn
from torchvision.models.detection.mask_rcnn import MaskRCNNHeads, MaskRCNNPredictor
from torchvision.ops import MultiScaleRoIAlign

from edgetree.bench.speed import peak_memory_mib
from perceptree.models import PAPER_PRESETS, TreeRCNN, make_spec
from perceptree.models.detector import RegionPooler

HEIGHT_PX, WIDTH_PX = 720, 1280
KEYPOINTS, DETECTIONS = 5, 20


def torchvision_network() -> torch.nn.Module:
    """torchvision's Mask and Keypoint R-CNN with an R50-FPN backbone."""
    network = keypointrcnn_resnet50_fpn(
        weights=None,
        weights_backbone=None,
        num_keypoints=KEYPOINTS,
        min_size=HEIGHT_PX,
        max_size=WIDTH_PX,
        box_detections_per_img=DETECTIONS,
        box_score_thresh=0.0,
    )
    heads = network.roi_heads
    heads.mask_roi_pool = MultiScaleRoIAlign(["0", "1", "2", "3"], 14, 2)
    heads.mask_head = MaskRCNNHeads(256, (256,) * 4, 1)
    heads.mask_predictor = MaskRCNNPredictor(256, 256, 2)
    return network.eval()


def seconds(call: Callable[[], object]) -> float:
    """Time of one call, s."""
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


class Watch:
    """Replaces a function or method by one that also sums the time of its calls."""

    def __init__(self, owner: type, name: str) -> None:
        self.total_s = 0.0
        wrapped = getattr(owner, name)

        def timed(*arguments: object, **named: object) -> object:
            start = time.perf_counter()
            try:
                return wrapped(*arguments, **named)
            finally:
                self.total_s += time.perf_counter() - start

        setattr(owner, name, timed)


def compare(preset: str, frame: np.ndarray, rounds: int) -> dict[str, float]:
    """Measure one of this project's networks alternately with torchvision's."""
    torch.manual_seed(0)
    ours = TreeRCNN(make_spec(preset, "rgb", HEIGHT_PX, WIDTH_PX)).eval()
    theirs = torchvision_network()
    batch = torch.from_numpy(frame)[None]
    image = torch.from_numpy(frame).permute(2, 0, 1).float() / 255
    times: dict[str, list[float]] = {"ours": [], "torchvision_r50": []}
    with torch.inference_mode():
        ours.detect(batch)
        theirs([image])
        watches = [Watch(RegionPooler, name) for name in ("__init__", "__call__")]
        watches.append(Watch(type(ours.proposer), "propose"))
        shares = []
        for _ in range(rounds):
            before = sum(watch.total_s for watch in watches)
            times["ours"].append(seconds(lambda: ours.detect(batch)))
            spent = sum(watch.total_s for watch in watches) - before
            shares.append(spent / times["ours"][-1])
            times["torchvision_r50"].append(seconds(lambda: theirs([image])))
    medians = {f"{name}_s": round(statistics.median(values), 3) for name, values in times.items()}
    ratios = [a / b for a, b in zip(times["ours"], times["torchvision_r50"], strict=True)]
    return medians | {
        "ratio": round(statistics.median(ratios), 3),
        "share_in_roi_align_and_proposals": round(statistics.median(shares), 4),
    }


def peak_mib(preset: str) -> float:
    """Peak resident memory of a process that detects on one frame, in MiB."""
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return pool.apply(_detect_once, (preset,))


def _detect_once(preset: str) -> float:
    model = TreeRCNN(make_spec(preset, "rgb", HEIGHT_PX, WIDTH_PX)).eval()
    with torch.inference_mode():
        model.detect(torch.zeros(1, HEIGHT_PX, WIDTH_PX, 3, dtype=torch.uint8))
    peak = peak_memory_mib()
    assert peak is not None
    return round(peak, 1)


def main() -> None:
    """Print the results as JSON, and optionally write them to a file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--presets", default=",".join(PAPER_PRESETS))
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--result", type=Path)
    arguments = parser.parse_args()
    frame = np.random.default_rng(0).integers(0, 256, (HEIGHT_PX, WIDTH_PX, 3), dtype=np.uint8)
    figures = {
        preset: compare(preset, frame, arguments.rounds) | {"peak_mib": peak_mib(preset)}
        for preset in arguments.presets.split(",")
    }
    result = {
        "machine": platform.processor() or platform.machine(),
        "threads": torch.get_num_threads(),
        "input": f"{WIDTH_PX}x{HEIGHT_PX}",
        "presets": figures,
    }
    text = json.dumps(result, indent=2)
    sys.stdout.write(text + "\n")
    if arguments.result:
        arguments.result.write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
