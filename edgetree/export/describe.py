"""The manifest of a file that is about to be written."""

from __future__ import annotations

import hashlib
import importlib.metadata
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from edgetree.export.settings import PRECISIONS, ExportSettings
from edgetree.model_file.manifest import (
    ClassifierCost,
    Manifest,
    ResizeRule,
    Thresholds,
    standard_input,
    standard_outputs,
)

if TYPE_CHECKING:
    from perceptree.models import ModelSpec, TreeRCNN

__all__ = ["describe"]


def describe(model: TreeRCNN, training_data: str, settings: ExportSettings) -> Manifest:
    """What the file of ``model``, made as ``settings`` say, tells about itself."""
    from perceptree.keypoints import KEYPOINT_FLIP_PAIRS, KEYPOINT_NAMES
    from perceptree.models import CLASS_NAMES
    from perceptree.models.cost import classifier_cost, multiply_adds, parameters

    spec: ModelSpec = model.spec
    taken = standard_input(spec.modality, spec.height, spec.width)
    return Manifest(
        name=spec.name,
        backbone=spec.backbone,
        modality=spec.modality,
        input=replace(taken, batch_sizes=(settings.batch,)),
        resize=ResizeRule(pad_value=spec.pad_value),
        mean=spec.mean,
        std=spec.std,
        depth_encoding=spec.depth_encoding,
        outputs=standard_outputs(spec.detections, keypoints=spec.keypoints, masks=spec.masks),
        classes=CLASS_NAMES,
        keypoint_names=KEYPOINT_NAMES if spec.keypoints else (),
        keypoint_flip_pairs=KEYPOINT_FLIP_PAIRS if spec.keypoints else (),
        thresholds=Thresholds(spec.score_threshold, spec.nms_iou),
        precision=PRECISIONS[settings.precision],
        opset=settings.opset,
        parameters=parameters(model),
        weights_sha256=_weights_sha256(model),
        training_data=training_data,
        project_version=_version(),
        proposals=spec.proposals,
        multiply_adds=multiply_adds(model),
        classifier=ClassifierCost(*classifier_cost(spec.backbone, spec.stride_in_1x1)),
        target=settings.target,
    )


def _weights_sha256(model: Any) -> str:
    """Hash of all weights' names and values, whatever their layout in memory."""
    digest = hashlib.sha256()
    for name, value in sorted(model.state_dict().items()):
        digest.update(name.encode())
        digest.update(np.ascontiguousarray(value.numpy()).tobytes())
    return digest.hexdigest()


def _version() -> str:
    try:
        return importlib.metadata.version("edgetree")
    except importlib.metadata.PackageNotFoundError:
        return "unknown"
