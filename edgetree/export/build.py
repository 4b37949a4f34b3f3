"""Build the ONNX graph of a model, and the manifest that describes it."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from basetree.arrays import UInt8
from basetree.counts import counted
from basetree.program.python import installed_version
from edgetree.export.float16 import to_float16
from edgetree.export.frames import frames_sha256
from edgetree.export.quantise import quantise, weight_bits
from edgetree.export.quiet import quiet
from edgetree.export.rewrites import rewrite_for_export
from edgetree.export.settings import EVERY_ROW_TARGETS, OPSET, PRECISIONS, ExportSettings
from edgetree.model_file.inputs_outputs import (
    InputSpec,
    standard_input,
    standard_inputs,
    standard_outputs,
)
from edgetree.model_file.manifest import (
    METADATA_KEY,
    SCORE_INPUT,
    ClassifierCost,
    Manifest,
    ResizeRule,
    Thresholds,
    UsualRange,
)
from edgetree.runtime.session import InferenceSession, OrtSession

if TYPE_CHECKING:
    from perceptree.models import ModelSpec, TreeRCNN


@dataclass(frozen=True, eq=False)
class ExportSource:
    """What an ONNX file is built from.

    Attributes:
        model: The model, with the input size and thresholds of the file.
        training_data: id of the data that it was trained on.
        calibration_frames: (N, H, W, 3) or (N, H, W) uint8 prepared frames for the ranges of
            activations, (N, H, W, 4) of colour and depth. Needed unless the precision is `fp32`.
        training_pictures: How the pictures of that data look; empty if it is not known.
        reach_m: How far the trees of that data are labelled, m; None if it is not known.
    """

    model: TreeRCNN
    training_data: str
    calibration_frames: UInt8 | None = None
    training_pictures: tuple[UsualRange, ...] = ()
    reach_m: float | None = None


@dataclass(frozen=True, eq=False)
class BuiltModel:
    """An ONNX graph and its manifest.

    Attributes:
        proto: An `onnx.ModelProto` without metadata.
        manifest: Description of the graph, without the results of the verification.
    """

    proto: Any
    manifest: Manifest

    def session(self) -> InferenceSession:
        """An inference session of the graph, as a file of it would give."""
        content = with_manifest(self.proto, self.manifest)
        return OrtSession(Path("the exported model"), content=content)


def with_manifest(proto: Any, manifest: Manifest) -> bytes:
    """The bytes of an ONNX file with a manifest as its only metadata.

    Args:
        proto: An `onnx.ModelProto`; its metadata change, nothing else.
        manifest: Description of the graph.
    """
    import onnx

    onnx.helper.set_model_props(proto, {METADATA_KEY: manifest.to_json()})
    content: bytes = proto.SerializeToString()
    return content


def build(source: ExportSource, settings: ExportSettings, say: Callable[[str], None]) -> BuiltModel:
    """Trace a model to ONNX, convert it to the precision of the settings, and describe it.

    Args:
        source: Model and calibration frames.
        settings: Precision, batch size, operator set and target.
        say: Called with progress messages.
    """
    described = describe(source.model, source.training_data, settings)
    manifest = replace(
        described, training_pictures=source.training_pictures, reach_m=source.reach_m
    )
    say("tracing the graph")
    int8 = settings.precision == "int8"
    proto = trace(
        source.model,
        settings.batch,
        settings.opset,
        quantised=int8,
        every_row=settings.target in EVERY_ROW_TARGETS,
    )
    frames = source.calibration_frames
    if settings.precision != "fp32" and frames is not None:
        say(f"calibrating on {counted(len(frames), 'frame')}")
        manifest = replace(manifest, calibration_sha256=frames_sha256(frames))
        if int8:
            symmetric = settings.target == "tensorrt"
            proto = quantise(proto, frames, symmetric=symmetric)
            manifest = replace(manifest, weight_bits=weight_bits(symmetric=symmetric))
        else:
            proto = to_float16(proto, frames)
    if manifest.thresholds.score_input is not None:
        offer_lowest_score(proto)
    _remove_debug_info(proto)
    return BuiltModel(proto, manifest)


def output_names(masks: bool, keypoints: bool) -> tuple[str, ...]:
    """Names of the graph's outputs in their order, without those of missing branches."""
    return tuple(each.name for each in standard_outputs(1, keypoints=keypoints, masks=masks))


def trace(
    model: TreeRCNN,
    batch: int,
    opset: int = OPSET,
    *,
    quantised: bool = False,
    every_row: bool = False,
) -> Any:
    """Trace `model.detect` to ONNX with outputs of fixed shapes, in float32.

    The model has no branches that depend on data, so it is traced on zeros.

    Args:
        model: The model.
        batch: Number of frames of one inference.
        opset: ONNX operator set.
        quantised: Whether to rewrite the model for `edgetree.export.quantise`.
        every_row: Whether the shapes within are fixed, too, as in `TreeRCNN.detect`. TensorRT is
            slow with others.

    Returns:
        An `onnx.ModelProto`, whose nodes name the modules that they come from. Unless `every_row`,
        the spec's threshold is its constant `SCORE_INPUT` of shape (1,): boxes with a lower score
        go to no mask or keypoint head.

    Raises:
        RuntimeError: Torch gave no ONNX program.
    """
    import onnx
    import torch

    from perceptree.models.inputs import COLOUR, DEPTH, by_name

    names = output_names(model.spec.masks, model.spec.keypoints)
    rewritten = rewrite_for_export(model, quantised=quantised)
    pictures = (COLOUR, DEPTH) if model.spec.modality == "both" else ("image",)

    class Exported(torch.nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.model = rewritten

        def forward(self, *given: torch.Tensor) -> tuple[torch.Tensor, ...]:
            images = dict(zip(pictures, given, strict=False))
            shown = images if len(pictures) > 1 else given[0]
            found = rewritten.detect(shown, every_row, *given[len(pictures) :])._asdict()
            return tuple(found[name] for name in names)

    blank = torch.zeros(batch, *model.spec.image_shape, dtype=torch.uint8)
    examples = by_name(blank, model.spec).values()
    inputs = {name: each.contiguous() for name, each in zip(pictures, examples, strict=True)}
    if not every_row:
        inputs[SCORE_INPUT] = torch.tensor([model.spec.score_threshold])
    with quiet():
        program = torch.onnx.export(
            Exported().eval(),
            tuple(inputs.values()),
            dynamo=True,
            input_names=list(inputs),
            output_names=list(names),
            opset_version=opset,
            verbose=False,
        )
    if program is None:
        raise RuntimeError("torch.onnx.export returned no program: expected an ONNXProgram")
    proto = program.model_proto
    if not every_row:
        proto.graph.input.pop()
        default = onnx.numpy_helper.from_array(inputs[SCORE_INPUT].numpy(), SCORE_INPUT)
        proto.graph.initializer.append(default)
    return proto


def offer_lowest_score(proto: Any) -> None:
    """Make the constant `SCORE_INPUT` of a traced `onnx.ModelProto` an input with that default.

    In ONNX, a constant that is an input as well is the input's default. Until this is done, the
    libraries that convert a graph need not know it.
    """
    import onnx

    constant = next(each for each in proto.graph.initializer if each.name == SCORE_INPUT)
    value = onnx.helper.make_tensor_value_info(SCORE_INPUT, constant.data_type, constant.dims)
    proto.graph.input.append(value)


def describe(model: TreeRCNN, training_data: str, settings: ExportSettings) -> Manifest:
    """The manifest of the file of a model.

    Args:
        model: The model, with the input size and thresholds of the file.
        training_data: id of the data that it was trained on.
        settings: Precision, batch size, operator set and target.
    """
    from perceptree.keypoints import KEYPOINT_FLIP_PAIRS, KEYPOINT_NAMES
    from perceptree.models import CLASS_NAMES
    from perceptree.models.cost import classifier_cost, multiply_adds, parameters

    spec: ModelSpec = model.spec
    model_input = standard_input(spec.modality, spec.height, spec.width)
    inputs: tuple[InputSpec, ...] = ()
    if spec.modality == "both":
        assert spec.depth_encoding is not None
        pads = spec.colour_pad_value, spec.pad_value
        nothing = int(spec.depth_encoding["invalid_value"])
        pair = standard_inputs(spec.height, spec.width, pad_values=pads, no_depth=nothing)
        inputs = tuple(replace(each, batch_sizes=(settings.batch,)) for each in pair)
        model_input = inputs[-1]
    return Manifest(
        name=spec.name,
        backbone=spec.backbone,
        modality=spec.modality,
        input=replace(model_input, batch_sizes=(settings.batch,)),
        resize=ResizeRule(pad_value=spec.pad_value),
        mean=spec.mean,
        std=spec.std,
        depth_encoding=spec.depth_encoding,
        outputs=standard_outputs(spec.detections, keypoints=spec.keypoints, masks=spec.masks),
        classes=CLASS_NAMES,
        keypoint_names=KEYPOINT_NAMES if spec.keypoints else (),
        keypoint_flip_pairs=KEYPOINT_FLIP_PAIRS if spec.keypoints else (),
        thresholds=Thresholds(
            spec.score_threshold,
            spec.nms_iou,
            score_input=None if settings.target in EVERY_ROW_TARGETS else SCORE_INPUT,
        ),
        precision=PRECISIONS[settings.precision],
        opset=settings.opset,
        parameters=parameters(model),
        weights_sha256=_weights_sha256(model),
        training_data=training_data,
        project_version=installed_version("edgetree") or "unknown",
        proposals=spec.proposals,
        multiply_adds=multiply_adds(model),
        classifier=ClassifierCost(*classifier_cost(spec.backbone, spec.stride_in_1x1)),
        target=settings.target,
        inputs=inputs,
    )


def _weights_sha256(model: Any) -> str:
    """Hash of the names and values of all weights; their memory layout does not matter."""
    digest = hashlib.sha256()
    for name, value in sorted(model.state_dict().items()):
        digest.update(name.encode())
        digest.update(np.ascontiguousarray(value.numpy()).tobytes())
    return digest.hexdigest()


def _remove_debug_info(proto: Any) -> None:
    """Remove the notes of torch's exporter, which include paths of this machine."""
    proto.doc_string = ""
    del proto.metadata_props[:]
    graph = proto.graph
    del graph.metadata_props[:]
    graph.doc_string = ""
    for items in (graph.node, graph.value_info, graph.input, graph.output, graph.initializer):
        for item in items:
            item.doc_string = ""
            del item.metadata_props[:]
