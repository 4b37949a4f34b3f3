"""The model that a file is made of: a checkpoint's, fitted to the settings, or an untrained one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from edgetree.errors import MissingDependency, install_hint
from edgetree.export.frames import InputRules, sample_inputs
from edgetree.export.settings import ExportSettings

if TYPE_CHECKING:
    from torch import Tensor

    from edgetree.model_file.manifest import Manifest
    from perceptree.models import TreeRCNN

__all__ = ["UNTRAINED", "load_model", "settings_of", "untrained_model", "with_settings"]

UNTRAINED = "untrained"
# Spread of an untrained network's last layers: logits as lively as a trained one's.
_LOGIT_SPREAD = 2.0


def load_model(checkpoint: Path) -> tuple[TreeRCNN, str]:
    """The model of a checkpoint, and the id of the data that it was trained on.

    Raises:
        MissingDependency: what exporting needs is not installed.
        CheckpointError: the checkpoint cannot be read.
    """
    _require_training_side()
    from perceptree.models import load_checkpoint

    model, record = load_checkpoint(checkpoint)
    return model, str(record.get("training", {}).get("data", "unknown"))


def _require_training_side() -> None:
    try:
        import onnx  # noqa: F401
        import onnxscript  # noqa: F401

        import perceptree.models  # noqa: F401
    except ImportError as error:
        raise MissingDependency(
            f"{error.name} is not installed: {install_hint('cpu', 'train', 'export')}"
        ) from error


def with_settings(model: TreeRCNN, settings: ExportSettings) -> TreeRCNN:
    """The same weights for another input size, number of rows or proposals, or threshold.

    Raises SpecError for a size that no network takes.
    """
    from perceptree.models import TreeRCNN

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


def settings_of(manifest: Manifest) -> ExportSettings:
    """The settings that make a checkpoint the model of a file."""
    from edgetree.export.settings import PRECISIONS

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
    )


def untrained_model(preset: str, modality: str, settings: ExportSettings) -> TreeRCNN:
    """A preset with random weights that answers as lively as a trained network.

    Its batch norms have the statistics of the package's sample frames, and its last layers are
    scaled on one of them. It costs what the trained network costs and finds nothing.

    Raises SpecError for an unknown preset, MissingDependency where training is not installed.
    """
    _require_training_side()
    import torch

    from perceptree.models import TreeRCNN, make_spec

    torch.manual_seed(0)
    spec = make_spec(preset, modality, settings.height, settings.width)  # type: ignore[arg-type]
    model = with_settings(TreeRCNN(spec), settings)
    images = sample_inputs(InputRules.of(model.spec))
    with torch.no_grad():
        _fit_norms(model, images)
        _scale_last_layers(model, images[:1])
    return model


def _fit_norms(model: TreeRCNN, images: NDArray[np.uint8]) -> None:
    import torch
    from torch import nn

    for norm in model.modules():
        if isinstance(norm, nn.BatchNorm2d):
            norm.momentum = None  # plain means over all frames
    model.train()
    for image in images:
        model.features(torch.from_numpy(image[None]))
    model.eval()


def _scale_last_layers(model: TreeRCNN, image: NDArray[np.uint8]) -> None:
    """Give each last layer its spread when it is first called, the earlier ones first."""
    import torch

    layers: list[Any] = [model.proposer.objectness, model.box_head.score]
    if model.mask_head is not None:
        layers.append(model.mask_head.score)
    if model.keypoint_head is not None:
        layers.append(model.keypoint_head.tower.up)

    def scale(layer: Any, _: Any, output: Tensor) -> Tensor:
        handles.pop(layer).remove()
        gain = _LOGIT_SPREAD / output.std().clamp(min=1e-6)
        layer.weight.mul_(gain)
        return output * gain

    handles = {layer: layer.register_forward_hook(scale) for layer in layers}
    model.detect(torch.from_numpy(image))
