"""Who takes part: this project's files, and the peers with what each gives, needs and lacks."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from benchmarks.peers.environments import DEVELOPMENT
from edgetree.model_file.manifest import Manifest
from edgetree.runtime.detector import DISPLAY_THRESHOLD

SIDE_PX: Final = 800
BARE, WHOLE = "bare run", "frame to trees"

_NO_MANIFEST: Final = "a description of input and outputs that a program can check"
_NO_KEYPOINTS: Final = "keypoints"
_NO_MASKS: Final = "masks"
_MASKS_LATER: Final = "whole masks in the file: prototypes are combined afterwards"
_NMS_LATER: Final = "non-maximum suppression in the file"


@dataclass(frozen=True)
class Contestant:
    """A network in a runtime.

    Attributes:
        name: Name in the table.
        environment: Environment that runs it, see `environments.py`.
        worker: Program in `workers`.
        file: The network's file; relative paths are in the folder of prepared networks.
        gives: Of boxes, masks and keypoints, what one pass gives.
        precision: Of weights and activations.
        licence: Of the network's code, as an SPDX name.
        lacks: What this project's files have and this one does not.
        timed: `BARE` or `WHOLE`.
        layout: Layout of the input, see `workers/stopwatch.py`.
        side_px: Side of the letterboxed frames; None for frames as they come.
        options: Further options of the worker.
        depth: Whether it takes depth images, not colour.
    """

    name: str
    environment: str
    worker: str
    file: str
    gives: tuple[str, ...]
    precision: str
    licence: str
    lacks: tuple[str, ...] = ()
    timed: str = BARE
    layout: str = "planes"
    side_px: int | None = SIDE_PX
    options: tuple[str, ...] = ()
    depth: bool = False

    @property
    def network(self) -> str | None:
        """The prepared network that the file belongs to; None for a file given by its path."""
        return None if Path(self.file).is_absolute() else Path(self.file).parts[0]


@dataclass(frozen=True)
class Network:
    """A network to prepare: its files are made by a program in `exporters`."""

    name: str
    environment: str
    exporter: str
    side_px: int = SIDE_PX


_ALL: Final = ("boxes", "masks", "keypoints")
_OURS: Final = "Apache-2.0"
_YOLO: Final = ("yolo11n-seg", "yolo11n-pose", "yolo26n-seg", "yolo26n-pose")
_RF_DETR_SEG_SIDE_PX: Final = 792  # a multiple of its patches of 12 px

NETWORKS: Final = {
    network.name: network
    for network in (
        Network("edge-n", DEVELOPMENT, "export_ours.py"),
        Network("r50", DEVELOPMENT, "export_ours.py"),
        Network("maskrcnn-r50-fpn", DEVELOPMENT, "export_ours.py"),
        Network("mask-keypoint-rcnn-r50-fpn", DEVELOPMENT, "export_ours.py"),
        *(Network(name, "ultralytics", "export_ultralytics.py") for name in _YOLO),
        Network("rf-detr-nano", "rfdetr", "export_rfdetr.py"),
        Network("rf-detr-seg-nano", "rfdetr", "export_rfdetr.py", _RF_DETR_SEG_SIDE_PX),
        Network("deimv2-atto", "libreyolo", "export_libreyolo.py"),
    )
}


ABSENT: Final = {
    "Detectron2": "not on PyPI",
    "RF-DETR in int8": "its package quantises for TensorFlow Lite only",
    "DEIMv2 in int8": "LibreYOLO does not quantise it",
}
"""Who cannot take part, and why."""


def ours(name: str, file: Path, manifest: Manifest) -> list[Contestant]:
    """A file of this project: its bare run, the whole detection, and its run in OpenVINO."""
    takes_scores = manifest.thresholds.score_input is not None
    bare = Contestant(
        name,
        DEVELOPMENT,
        "run_onnxruntime.py",
        str(file.absolute()),
        _ALL,
        manifest.precision,
        _OURS,
        layout="bytes",
        options=("--lowest-score", str(DISPLAY_THRESHOLD)) if takes_scores else (),
        depth=manifest.takes_depth,
    )
    whole = replace(
        bare,
        name=f"{name}, whole",
        worker="run_edgetree.py",
        timed=WHOLE,
        layout="image",
        side_px=None,
        options=(),
    )
    return [bare, whole, _in_openvino(bare, str(file.absolute()))]


def _in_openvino(contestant: Contestant, file: str) -> Contestant:
    return replace(
        contestant,
        name=f"{contestant.name}, OpenVINO",
        environment="openvino",
        worker="run_openvino.py",
        file=file,
        options=(),
    )


def _in_pytorch(preset: str) -> list[Contestant]:
    """A network of this project without export."""
    eager = Contestant(
        f"{preset}, PyTorch eager",
        DEVELOPMENT,
        "run_pytorch.py",
        f"{preset}/network.pt",
        _ALL,
        "float32",
        _OURS,
        (_NO_MANIFEST, "a file that runs without PyTorch"),
        layout="bytes",
    )
    compiled = replace(eager, name=f"{preset}, PyTorch compiled", options=("--compile",))
    return [eager, compiled]


def _torchvision() -> list[Contestant]:
    """torchvision's networks: two by its own exporter, and the one with all heads in PyTorch."""
    masks = Contestant(
        "torchvision Mask R-CNN R50-FPN",
        DEVELOPMENT,
        "run_onnxruntime.py",
        "maskrcnn-r50-fpn/float32.onnx",
        ("boxes", "masks"),
        "float32",
        "BSD-3-Clause",
        (_NO_KEYPOINTS, _NO_MANIFEST),
        layout="plane",
    )
    whole = replace(
        masks,
        name="torchvision Mask and Keypoint R-CNN R50-FPN",
        file="mask-keypoint-rcnn-r50-fpn/float32.onnx",
        gives=_ALL,
        lacks=(_NO_MANIFEST,),
    )
    eager = replace(
        whole,
        name=f"{whole.name}, PyTorch eager",
        worker="run_pytorch.py",
        file="mask-keypoint-rcnn-r50-fpn/network.pt",
        options=("--list",),
    )
    return [masks, whole, eager]


def _yolo(network: str) -> list[Contestant]:
    """A YOLO network by its package's own exports to onnxruntime and OpenVINO."""
    pose = network.endswith("pose")
    lacks = [_NO_MASKS] if pose else [_NO_KEYPOINTS, _MASKS_LATER]
    lacks += [] if network.startswith("yolo26") else [_NMS_LATER]
    found = []
    for precision in ("float32", "int8"):
        contestant = Contestant(
            f"{network} {precision}",
            "ultralytics",
            "run_onnxruntime.py",
            f"{network}/{precision}.onnx",
            ("boxes", "keypoints" if pose else "masks"),
            precision,
            "AGPL-3.0",
            (*lacks, _NO_MANIFEST),
        )
        found += [contestant, _in_openvino(contestant, f"{network}/{precision}.xml")]
    return found


def _detr(network: str, environment: str, gives: tuple[str, ...]) -> Contestant:
    """A transformer; it needs no non-maximum suppression."""
    lacks = tuple(each for each in (_NO_MASKS, _NO_KEYPOINTS) if each not in gives)
    return Contestant(
        network,
        environment,
        "run_onnxruntime.py",
        f"{network}/float32.onnx",
        gives,
        "float32",
        "Apache-2.0",
        (*lacks, _NO_MANIFEST),
        side_px=NETWORKS[network].side_px,
    )


def peers() -> list[Contestant]:
    """All contestants but this project's files."""
    return [
        *_in_pytorch("edge-n"),
        *_in_pytorch("r50"),
        *_torchvision(),
        *(contestant for network in _YOLO for contestant in _yolo(network)),
        _detr("rf-detr-nano", "rfdetr", ("boxes",)),
        _detr("rf-detr-seg-nano", "rfdetr", ("boxes", "masks")),
        _detr("deimv2-atto", "libreyolo", ("boxes",)),
    ]
