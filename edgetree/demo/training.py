"""The training demonstration: simulate, train, evaluate, export and run a small model."""

from __future__ import annotations

import time
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

from basetree.counts import counted
from basetree.errors import MissingPackage, install_hint
from edgetree.demo.held_out import held_out_frames
from edgetree.demo.result import DemoResult, Step
from edgetree.demo.running import Progress, demonstrate
from edgetree.errors import TRAINING_PACKAGES

_NEEDED: Final = (*TRAINING_PACKAGES, "onnxruntime")
_FRAMES: Final = 300
_FRAME_SIZE_PX: Final = (640, 360)
_INPUT_SIZE_PX: Final = (512, 288)
_TRAIN_MINUTES: Final = 5.0
_SHOWN_FRAMES: Final = 6
_SEED: Final = 7


def run_trained(folder: Path, on_progress: Progress) -> DemoResult:
    """Train a depth model from random weights and demonstrate it on held-out simulated scenes.

    The data, checkpoints and model stay in `folder`, as `data`, `training` and `model.onnx`. After
    an interruption, they are used to continue.

    Args:
        folder: An existing folder to work in.
        on_progress: Called with the progress.

    Raises:
        MissingPackage: a package for training is not installed.
        CheckFailed: The exported model's detections differ from the trained model's.
    """
    _require_extras()
    start_s = time.perf_counter()
    chain = _Chain(folder, on_progress)
    chain.simulate()
    checkpoint = chain.train()
    chain.evaluate(checkpoint)
    model = chain.export(checkpoint)
    frames = held_out_frames(chain.data, "test", _SHOWN_FRAMES)
    result = demonstrate([model], frames, chain.progress_within(0.96, 1.0))
    return replace(
        result,
        steps=tuple(chain.steps),
        figures=chain.figures,
        duration_s=time.perf_counter() - start_s,
    )


def _require_extras() -> None:
    missing = [name for name in _NEEDED if find_spec(name) is None]
    if missing:
        raise MissingPackage(
            f"demo --train needs {', '.join(missing)}:"
            f" {install_hint('cpu', 'train', 'export', 'sim')}"
        )


class _Chain:
    """Runs the steps and records their outcomes and times."""

    def __init__(self, folder: Path, on_progress: Progress) -> None:
        self.data = folder / "data"
        self.steps: list[Step] = []
        self.figures: dict[str, Any] = {}
        self._folder = folder
        self._on_progress = on_progress

    def progress_within(self, first: float, last: float) -> Progress:
        """A progress function for a part of the work, from share `first` to `last` of the whole."""

        def tell(share: float, what: str) -> None:
            self._on_progress(first + share * (last - first), what)

        return tell

    def simulate(self) -> None:
        """Simulate a dataset."""
        from perceptree.simulator import PRESETS, generate_dataset, ideal_camera

        start_s = time.perf_counter()
        tell = self.progress_within(0.0, 0.25)
        width, height = _FRAME_SIZE_PX
        plain = PRESETS["plain"].settings
        report = generate_dataset(
            self.data,
            _FRAMES,
            replace(plain, camera=replace(plain.camera, intrinsics=ideal_camera(width, height))),
            seed=_SEED,
            progress=lambda done, total: tell(done / total, "simulating a forest"),
        )
        frames, trees = sum(report.frames.values()), sum(report.trees.values())
        self.figures["frames"] = report.frames
        self._note(
            "simulate", f"{counted(frames, 'frame')}, {counted(trees, 'labelled tree')}", start_s
        )

    def train(self) -> Path:
        """Train a depth model; returns the checkpoint that is best on the val split."""
        from perceptree.models import make_spec
        from perceptree.training import TrainSettings, train

        start_s = time.perf_counter()
        tell = self.progress_within(0.25, 0.9)
        width, height = _INPUT_SIZE_PX
        report = train(
            make_spec("edge-n", "depth", height=height, width=width),
            TrainSettings(minutes=_TRAIN_MINUTES, schedule="cosine"),
            self.data,
            self._folder / "training",
            lambda status: tell(status.done, "training from random weights"),
        )
        self.figures["steps"] = report.steps
        self._note("train", f"{counted(report.steps, 'step')} from random weights", start_s)
        return report.checkpoint

    def evaluate(self, checkpoint: Path) -> None:
        """Compute COCO average precision on the test split, in percent."""
        from perceptree.data import FrameStore, read_split
        from perceptree.evaluation import evaluate, predict_with
        from perceptree.models import load_checkpoint

        start_s = time.perf_counter()
        self.progress_within(0.9, 0.93)(0.0, "evaluating on held-out scenes")
        model, _ = load_checkpoint(checkpoint)
        store = FrameStore(read_split(self.data, "test"), model.spec)
        metrics = evaluate(predict_with(model), store)
        self.figures["test"] = metrics.to_dict()
        kinds = {
            "boxes": metrics.box_ap50,
            "masks": metrics.mask_ap50,
            "keypoints": metrics.keypoint_ap50,
        }
        precision = ", ".join(
            f"{name} {value:.1f}" for name, value in kinds.items() if value is not None
        )
        self._note(
            "evaluate",
            f"AP50 on {counted(metrics.frames, 'frame')} of held-out scenes: {precision}",
            start_s,
        )

    def export(self, checkpoint: Path) -> Path:
        """Export the checkpoint to ONNX, with a parity check; returns the file."""
        from edgetree.export import export_model

        start_s = time.perf_counter()
        tell = self.progress_within(0.93, 0.96)
        report = export_model(
            checkpoint,
            self._folder / "model.onnx",
            data=self.data,
            say=lambda what: tell(0.0, f"exporting: {what}"),
        )
        parity = report.parity.figures()
        self.figures["parity"] = parity
        self._note(
            "export, check parity",
            f"{report.path.name}, {report.file_bytes / 1e6:.1f} MB; on {parity['frames']} frames,"
            f" boxes differ from the checkpoint's by at most {parity['box_px_max']:.2g} px and"
            f" scores by {parity['score_max']:.2g}",
            start_s,
        )
        return report.path

    def _note(self, name: str, outcome: str, start_s: float) -> None:
        duration_s = time.perf_counter() - start_s
        self.steps.append(Step(name, outcome, duration_s))
        self.figures[f"{name.partition(',')[0]}_s"] = round(duration_s, 1)
