"""Load the model to export: from a checkpoint, or a preset with untrained weights."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from basetree.arrays import UInt8
from basetree.errors import InputError, MissingPackage, install_hint
from basetree.files.json import build
from calib.picture_statistics import DEPTH_STATISTICS
from edgetree.export.frames import sample_inputs
from edgetree.export.settings import PRECISIONS, ExportSettings
from edgetree.model_file.manifest import UsualRange

if TYPE_CHECKING:
    from torch import Tensor

    from edgetree.model_file.manifest import Manifest
    from perceptree.models import TreeRCNN
    from perceptree.models.branches import Inputs

UNTRAINED = "untrained"
"""Id of the training data of a model without training."""

# Standard deviation of the logits of an untrained network, about that of a trained one.
_LOGIT_STD = 2.0


def load_model(checkpoint: Path) -> tuple[TreeRCNN, str, tuple[UsualRange, ...], float | None]:
    """Load a checkpoint.

    Args:
        checkpoint: a perceptree checkpoint.

    Returns:
        The model, the id of the data that it was trained on, how their pictures look, and how far
        their trees are labelled, m; nothing of that from checkpoints of older versions.

    Raises:
        MissingPackage: a package that exporting needs is not installed.
        CheckpointError: The checkpoint cannot be read.
        InputError: What it tells of its training pictures is no range of numbers, or the reach of
            its labels is no distance.
    """
    _require_packages()
    from perceptree.models import load_checkpoint

    model, record = load_checkpoint(checkpoint)
    training = record.get("training", {})
    usual = _usual_ranges(training.get("pictures", {}), f"{checkpoint}: training pictures")
    reach_m = _reach_m(training.get("reach_m"), f"{checkpoint}: reach_m of the training")
    return model, str(training.get("data", "unknown")), usual, reach_m


def _reach_m(stated: Any, where: str) -> float | None:
    """The reach in a checkpoint's record, checked."""
    if stated is None:
        return None
    is_number = isinstance(stated, int | float) and not isinstance(stated, bool)
    if not (is_number and 0 < stated < math.inf):
        raise InputError(f"{where} is {stated!r:.80}: expected a distance over 0")
    return float(stated)


def _usual_ranges(looks: Any, where: str) -> tuple[UsualRange, ...]:
    """The ranges in a checkpoint's record, checked."""
    try:
        rows = [
            {"statistic": name, "low": low, "high": high} for name, (low, high) in looks.items()
        ]
    except (AttributeError, TypeError, ValueError) as error:
        raise InputError(f"{where} are {looks!r:.80}: expected two numbers by statistic") from error
    return tuple(build(UsualRange, row, where) for row in rows)


def _require_packages() -> None:
    try:
        import onnx  # noqa: F401
        import onnxscript  # noqa: F401

        import perceptree.models  # noqa: F401
    except ImportError as error:
        raise MissingPackage(
            f"{error.name} is not installed: {install_hint('cpu', 'train', 'export')}"
        ) from error


def with_settings(model: TreeRCNN, settings: ExportSettings) -> TreeRCNN:
    """A model with the same weights and other settings.

    Args:
        model: The model; it is not changed.
        settings: Inputs, input size, numbers of detections and proposals, and score threshold.
            Those that are None stay as they are.

    Raises:
        SpecError: The network does not support the input size, does not have the inputs, or has
            fewer proposals than detections.
    """
    from perceptree.models import TreeRCNN
    from perceptree.models.branches import pruned

    if settings.inputs is not None:
        model = pruned(model, cast("Inputs", settings.inputs))
    changes: dict[str, Any] = {
        "height": settings.height,
        "width": settings.width,
        "detections": settings.max_detections,
        "proposals": settings.proposals,
        "score_threshold": settings.score_threshold,
    }
    changes = {name: value for name, value in changes.items() if value is not None}
    spec = replace(model.spec, **changes)
    if spec == model.spec:
        return model
    changed = TreeRCNN(spec)
    changed.load_state_dict(model.state_dict())
    return changed.eval()


def settings_from_manifest(manifest: Manifest) -> ExportSettings:
    """The export settings of an existing file."""
    names = {precision: name for name, precision in PRECISIONS.items()}
    rows = next(output.shape[1] for output in manifest.outputs if output.name == "boxes")
    return ExportSettings(
        height=manifest.input.height,
        width=manifest.input.width,
        batch=manifest.input.batch_sizes[0],
        max_detections=int(rows),
        proposals=manifest.proposals,
        precision=names.get(manifest.precision, manifest.precision),
        score_threshold=manifest.thresholds.score,
        opset=manifest.opset,
        target=manifest.target,
        inputs="colour" if manifest.modality == "rgb" else manifest.modality,
    )


def pictures_of(model: TreeRCNN, usual: tuple[UsualRange, ...]) -> tuple[UsualRange, ...]:
    """The ranges of the statistics of the images that a model takes."""
    kinds = {"rgb": (False,), "depth": (True,), "both": (False, True)}[model.spec.modality]
    return tuple(each for each in usual if (each.statistic in DEPTH_STATISTICS) in kinds)


def untrained_model(preset: str, modality: str, settings: ExportSettings) -> TreeRCNN:
    """A preset with random weights.

    It takes as much computation as the trained network, but its detections are meaningless. The
    batch norms take their statistics from the sample frames of the package, and the last layers
    are scaled on one of them, so that scores vary as much as those of a trained network.

    Args:
        preset: Name of the preset.
        modality: `rgb`, `depth` or `both`.
        settings: Input size and other options.

    Raises:
        SpecError: The preset is unknown.
        MissingPackage: a package that exporting needs is not installed.
    """
    _require_packages()
    import torch

    from perceptree.models import TreeRCNN, make_spec

    torch.manual_seed(0)
    spec = make_spec(preset, modality, settings.height, settings.width)  # type: ignore[arg-type]
    model = with_settings(TreeRCNN(spec), settings)
    images = sample_inputs(model.spec)
    with torch.no_grad():
        _fit_batch_norms(model, images)
        _scale_last_layers(model, images[:1])
    return model


def _fit_batch_norms(model: TreeRCNN, images: UInt8) -> None:
    import torch
    from torch import nn

    for norm in model.modules():
        if isinstance(norm, nn.BatchNorm2d):
            norm.momentum = None  # use the mean over all frames
    model.train()
    for image in images:
        model.features(torch.from_numpy(image[None]))
    model.eval()


def _scale_last_layers(model: TreeRCNN, image: UInt8) -> None:
    """Scale the weights of the last layers to outputs of the standard deviation `_LOGIT_STD`.

    Each layer is scaled when the model first calls it, so that later layers get scaled inputs.
    """
    import torch

    layers: list[Any] = [model.proposer.objectness, model.box_head.score]
    if model.mask_head is not None:
        layers.append(model.mask_head.score)
    if model.keypoint_head is not None:
        layers.append(model.keypoint_head.tower.up)

    def scale(layer: Any, _: Any, output: Tensor) -> Tensor:
        handles.pop(layer).remove()
        gain = _LOGIT_STD / output.std().clamp(min=1e-6)
        layer.weight.mul_(gain)
        return output * gain

    handles = {layer: layer.register_forward_hook(scale) for layer in layers}
    model.detect(torch.from_numpy(image))
