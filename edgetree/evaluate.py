"""Evaluate a model file on labelled frames, with perceptree's metrics."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, cast

import numpy as np

from basetree.arrays import Float, UInt8
from basetree.counts import counted
from basetree.errors import InputError, MissingPackage, install_hint
from calib import CameraError, PinholeCamera, read_depth
from edgetree.model_file.inputs_outputs import COLOUR, DEPTH
from edgetree.model_file.manifest import Manifest
from edgetree.runtime.detector import TreeDetector
from edgetree.runtime.input_images import by_input
from edgetree.runtime.reach import reach_chances
from edgetree.runtime.session import InferenceSession

BOTH: Final = "both"

if TYPE_CHECKING:
    from perceptree.data import FrameRecord, FrameStore
    from perceptree.evaluation import Chances, Predict, RawDetections, Report
    from perceptree.models.spec import Modality


def evaluate_file(
    detector: TreeDetector,
    about: dict[str, Any],
    data: Path,
    split: str,
    fold: int | None = None,
    entire_tree: bool = False,
    inputs: str = BOTH,
    progress: Callable[[int, int], None] = lambda done, frames: None,
) -> Report:
    """Evaluate a model file with the code that evaluates checkpoints.

    Trees beyond the reach of the model's labels count as `TreeDetector.detect` counts them with a
    camera, in frames with depth in metres and a camera.

    Args:
        detector: The model. Its score threshold is not applied.
        about: JSON-ready description of the model for the report.
        data: Folder of a dataset.
        split: "train", "val" or "test".
        fold: Number of the fold, for datasets with several.
        entire_tree: Use the labels of entire trees, for datasets that have both kinds.
        inputs: Which images a model of colour and depth is shown: `both`, `colour` or `depth`.
        progress: Called with the number of frames done since the last call and the total.

    Returns:
        The report with all metrics.

    Raises:
        InputError: `split` or `inputs` is not one of the above, or `inputs` is given for a model
            of one image.
        MissingPackage: Torch or another package for training is not installed.
        perceptree.errors.DatasetError: The dataset is missing, broken or has no trees.
    """
    _need_training_setup()
    from perceptree.data import SPLITS, read_dataset
    from perceptree.evaluation import About, make_report

    if split not in SPLITS:
        raise InputError(f"--split is {split!r}: expected one of {', '.join(SPLITS)}")
    manifest = detector.manifest
    if inputs not in (BOTH, COLOUR, DEPTH):
        raise InputError(f"--inputs is {inputs!r}: expected {BOTH}, {COLOUR} or {DEPTH}")
    if inputs != BOTH and not manifest.takes_both:
        raise InputError(
            f"--inputs is {inputs!r}, but {manifest.name} takes one image: expected no --inputs"
        )
    dataset = read_dataset(data, split, fold, entire_tree)
    store = frames_for(manifest, dataset.frames)
    shown = manifest.shown(None if inputs == BOTH else inputs)
    chances, said = chances_within_reach(manifest, dataset.frames, inputs)
    return make_report(
        predict_with_file(detector.session, manifest, inputs),
        store,
        About(_about(shown, about), str(data), split, dataset.notes + said),
        manifest.input.batch_sizes[0],
        lambda done: progress(done, len(store)),
        chances,
    )


def chances_within_reach(
    manifest: Manifest, frames: Sequence[FrameRecord], inputs: str = BOTH
) -> tuple[Chances | None, tuple[str, ...]]:
    """What depth and camera tell of the trees that a model finds in labelled frames.

    Args:
        manifest: The model's manifest.
        frames: The frames.
        inputs: As for `evaluate_file`.

    Returns:
        The factors of the scores for `make_report`, and notes on them; None and no notes where the
        model has no reach or is not shown depth, or no frame has depth in metres and a camera.
    """
    shown = manifest.shown(None if inputs == BOTH else inputs)
    reach_m = shown.reach_m
    if reach_m is None or inputs == COLOUR or shown.modality == "rgb":
        return None, ()
    known = {
        number: (frame, frame.depth_path, camera)
        for number, frame in enumerate(frames)
        if frame.depth_path is not None and (camera := _camera_of(frame)) is not None
    }

    def chances(number: int, boxes_px: Float, masks: Float) -> Float:
        if number not in known:
            return np.ones(len(boxes_px))
        frame, depth_path, camera = known[number]
        depth_m = read_depth(depth_path)
        if depth_m.shape != (frame.height, frame.width):
            raise InputError(
                f"{depth_path}: is {depth_m.shape[1]}x{depth_m.shape[0]} px, expected"
                f" {frame.width}x{frame.height}, the size of {frame.image_path.name}"
            )
        return reach_chances(boxes_px, masks, depth_m, camera, reach_m)

    if not known:
        return None, ()
    which = f"{len(known)} of {counted(len(frames), 'frame')}"
    return chances, (f"scores of trees beyond {reach_m:g} m are lowered, by the depth of {which}",)


def _camera_of(frame: FrameRecord) -> PinholeCamera | None:
    """The camera in a frame's labels; None if there is none of the frame's size."""
    stated = frame.extra.get("camera")
    if not isinstance(stated, dict):
        return None
    try:
        camera = PinholeCamera.from_dict(stated)
    except CameraError:
        return None
    return camera if (camera.width, camera.height) == (frame.width, frame.height) else None


def predict_with_file(session: InferenceSession, manifest: Manifest, inputs: str = BOTH) -> Predict:
    """A prediction function for perceptree's metrics.

    Args:
        session: The session of the model file.
        manifest: The model's manifest.
        inputs: As for `evaluate_file`.

    Returns:
        A function from uint8 images, at most the file's batch size, to raw detections; of a model
        of both inputs from (B, H, W, 4).
    """
    from perceptree.evaluation import RawDetections

    batch = manifest.input.batch_sizes[0]
    hidden = [
        kind for kind in manifest.graph_inputs if manifest.takes_both and inputs not in (BOTH, kind)
    ]

    def predict(images: UInt8) -> RawDetections:
        filled = np.concatenate([images, images[:1].repeat(batch - len(images), axis=0)])
        shown = by_input(filled, manifest)
        for kind in hidden:
            shown[kind] = np.full_like(shown[kind], manifest.graph_inputs[kind].nothing)
        found = session.run(shown)
        kept = {name: values[: len(images)] for name, values in found.items()}
        return RawDetections(
            kept["boxes"],
            kept["scores"],
            kept.get("keypoints"),
            kept.get("masks"),
            kept["num_detections"],
        )

    return predict


def summary_of(report: Report) -> list[str]:
    """The report's summary as lines of text."""
    from perceptree.evaluation import summary_lines

    return list(summary_lines(report.figures))


def frames_for(manifest: Manifest, frames: list[Any]) -> FrameStore:
    """The frames, prepared for the model's input as in training."""
    from perceptree.data import FrameStore
    from perceptree.models import make_spec

    spec = make_spec(
        "edge-n",
        cast("Modality", manifest.modality),
        height=manifest.input.height,
        width=manifest.input.width,
    )
    encoding = manifest.depth_encoding
    if manifest.takes_both:
        pad = manifest.pad_value_of(manifest.graph_inputs[COLOUR])
        spec = dataclasses.replace(spec, colour_pad_value=pad)
    spec = dataclasses.replace(
        spec,
        pad_value=manifest.resize.pad_value,
        depth_encoding=None if encoding is None else dict(encoding),
    )
    return FrameStore(frames, spec)


def _about(manifest: Manifest, about: dict[str, Any]) -> dict[str, Any]:
    return {
        **about,
        "kind": "ONNX file",
        "backbone": manifest.backbone,
        "input_px": [manifest.input.width, manifest.input.height],
        "lowest_score": manifest.thresholds.score,
        "weights_sha256": manifest.weights_sha256,
        "training": manifest.training_data,
    }


def check_dataset(data: Path, split: str) -> None:
    """Raise what `evaluate_file` would for a split that is missing or broken."""
    _need_training_setup()
    from perceptree.data import read_dataset

    read_dataset(data, split)


def _need_training_setup() -> None:
    try:
        import perceptree.evaluation  # noqa: F401
    except ImportError as error:
        raise MissingPackage(
            f"{error}: evaluation needs the packages for training, {install_hint('train')}"
        ) from error
