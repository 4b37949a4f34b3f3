"""Combine model files of colour and depth, of colour, and of depth into one.

Shown only one of the two images, a model of colour and depth finds less than a model that was
trained for that image. A combined file holds the graphs of three files. Operators `If` run the one
for the images that show anything, so that a frame takes no longer than with that file.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from basetree.errors import CheckFailed, InputError, MissingPackage, install_hint
from basetree.files.regular import read_regular
from basetree.files.writing import write_whole
from calib import DepthEncoding, Letterbox
from edgetree.catalogue import find_model
from edgetree.errors import ModelFileError
from edgetree.export.build import with_manifest
from edgetree.model_file.inputs_outputs import COLOUR, DEPTH
from edgetree.model_file.manifest import SCORE_INPUT, Manifest
from edgetree.model_file.safety_check import check_content
from edgetree.runtime.alone_session import AloneSession
from edgetree.runtime.detector import TreeDetector
from edgetree.runtime.input_images import to_bytes
from edgetree.runtime.session import InferenceSession, OrtSession
from edgetree.samples import sample_frames

BOTH: Final = "both"
_SHOWS: Final = {COLOUR: ("ReduceMax", "Greater"), DEPTH: ("ReduceMin", "Less")}

_NEEDED: Final = {
    BOTH: ("both", "colour and depth"),
    COLOUR: ("rgb", "colour"),
    DEPTH: ("depth", "depth"),
}

Say = Callable[[str], None]


@dataclass(frozen=True)
class CombinedModel:
    """A combined file that was written.

    Attributes:
        path: The file.
        manifest: Its manifest.
        frames: Number of frames on which it found exactly what each of the files finds.
        file_bytes: Size of the file.
    """

    path: Path
    manifest: Manifest
    frames: int
    file_bytes: int


def combine_models(
    both: Path | str, colour: Path | str, depth: Path | str, out: Path, say: Say
) -> CombinedModel:
    """Write a file that holds three models, and check that it finds what each of them finds.

    Args:
        both: A model of colour and depth, a file or a name.
        colour: A model of colour, for frames whose depth is missing or shows nothing.
        depth: A model of depth, for frames whose colour is missing or shows nothing.
        out: The file to write. It is not changed unless the check passes.
        say: Called with progress messages.

    Raises:
        InputError: `out` does not end in .onnx.
        ModelFileError: a file cannot be opened, is combined already, or is unlike the one of both
            images in input size, padding, outputs, lowest score, precision or batch size.
        CheckFailed: The combined file finds something else than one of the three.
        MissingPackage: The package onnx is not installed.
    """
    try:
        import onnx
    except ImportError as error:
        hint = install_hint("cpu", "export")
        raise MissingPackage(f"{error.name} is not installed: {hint}") from error

    if out.suffix.lower() != ".onnx":
        raise InputError(f"the file to write is {out}: expected a name that ends in .onnx")
    say("reading the files")
    paths = {BOTH: find_model(both), COLOUR: find_model(colour), DEPTH: find_model(depth)}
    detectors = {kind: TreeDetector(OrtSession(path)) for kind, path in paths.items()}
    manifests = {kind: detector.manifest for kind, detector in detectors.items()}
    for kind, (modality, words) in _NEEDED.items():
        found = manifests[kind]
        if found.modality != modality or found.alone:
            what = "is combined already" if found.alone else f"takes {found.images}"
            raise ModelFileError(f"model {paths[kind]} {what}: expected one that takes {words}")
    alone = {kind: manifests[kind] for kind in (COLOUR, DEPTH)}
    for kind, found in alone.items():
        own, most = found.thresholds.mask_overlap, manifests[BOTH].thresholds.mask_overlap
        if own != most:  # trees are chosen by it after the graph, which does not say what ran
            raise ModelFileError(
                f"model {paths[kind]} has a mask_overlap of {own}: expected {most}, that of"
                f" {paths[BOTH]}"
            )
    parameters = sum(each.parameters for each in manifests.values())
    try:
        manifest = replace(manifests[BOTH], name=out.stem, parameters=parameters, alone=alone)
    except ModelFileError as error:
        raise ModelFileError(f"{paths[BOTH]} cannot be combined: {error}") from error
    say("joining the graphs")
    protos = {kind: onnx.load_model_from_string(read_regular(paths[kind])) for kind in paths}
    content = with_manifest(_joined(protos, manifest), manifest)
    try:
        check_content(content, out)
    except ModelFileError as error:
        raise ModelFileError(f"the three files are too large together: {error}") from error
    say("comparing with the files")
    sessions = {kind: detector.session for kind, detector in detectors.items()}
    frames = _compare(OrtSession(out, content=content), manifest, sessions)
    write_whole(out, content)
    return CombinedModel(out, manifest, frames, len(content))


def _joined(protos: Mapping[str, Any], manifest: Manifest) -> Any:
    """The combined `onnx.ModelProto`, without metadata."""
    from onnx import TensorProto, helper

    both = protos[BOTH].graph
    outputs = [output.name for output in both.output]
    inner = [f"{name}@colour_given" for name in outputs]
    branches = {kind: _branch(proto.graph, kind, manifest) for kind, proto in protos.items()}
    nodes, constants = [], []
    for kind, (reduce, compare) in _SHOWS.items():
        value = manifest.graph_inputs[kind].nothing
        assert value is not None
        constants.append(helper.make_tensor(f"{kind}_nothing", TensorProto.UINT8, [], [value]))
        nodes += [
            helper.make_node(reduce, [kind], [f"{kind}_most"], keepdims=0),
            helper.make_node(compare, [f"{kind}_most", f"{kind}_nothing"], [f"has_{kind}"]),
        ]
    colour_given = helper.make_graph(
        [_choice("has_depth", inner, branches[BOTH], branches[COLOUR])],
        "colour_given",
        [],
        [_renamed(each, name) for each, name in zip(both.output, inner, strict=True)],
    )
    nodes.append(_choice("has_colour", outputs, colour_given, branches[DEPTH]))
    constants += [each for each in both.initializer if each.name == SCORE_INPUT]
    graph = helper.make_graph(nodes, "combined", both.input, both.output, constants)
    source = protos[BOTH]
    return helper.make_model(graph, opset_imports=source.opset_import, ir_version=source.ir_version)


def _choice(condition: str, outputs: list[str], then: Any, other: Any) -> Any:
    from onnx import helper

    return helper.make_node("If", [condition], outputs, then_branch=then, else_branch=other)


def _renamed(value: Any, name: str) -> Any:
    changed = copy.deepcopy(value)
    changed.name = name
    return changed


def _branch(graph: Any, kind: str, manifest: Manifest) -> Any:
    """A graph as a branch: all names end in its kind, and the inputs are the file's."""
    if kind == BOTH:
        shared = {name: name for name in manifest.graph_inputs}
    else:
        shared = {manifest.alone[kind].input.name: kind}
    shared |= {SCORE_INPUT: SCORE_INPUT, "": ""}
    branch = copy.deepcopy(graph)
    del branch.input[:]
    for node in branch.node:
        node.name = node.name and f"{node.name}@{kind}"
        for names in (node.input, node.output):
            names[:] = [shared.get(name, f"{name}@{kind}") for name in names]
    own = [each for each in branch.initializer if each.name not in shared]
    del branch.initializer[:]
    branch.initializer.extend(own)
    for value in (*branch.initializer, *branch.value_info, *branch.output):
        value.name = f"{value.name}@{kind}"
    branch.name = kind
    return branch


def _compare(
    combined: InferenceSession, manifest: Manifest, sessions: Mapping[str, InferenceSession]
) -> int:
    """Check that all outputs are the same on the sample frames; returns how many there are.

    Raises:
        CheckFailed: They are not.
    """
    pairs = _sample_pairs(manifest)
    for kind, session in sessions.items():
        part = combined if kind == BOTH else AloneSession(combined, manifest, kind)
        name = "" if kind == BOTH else manifest.alone[kind].input.name
        for number, pair in enumerate(pairs):
            inputs = pair if kind == BOTH else {name: pair[kind]}
            wanted, found = session.run(inputs), part.run(inputs)
            differing = [each for each in wanted if not np.array_equal(wanted[each], found[each])]
            if differing:
                raise CheckFailed(
                    f"the combined file gives other {differing[0]} than {session.name} in sample"
                    f" {number}: expected equal values, so that nothing is written"
                )
    return len(pairs)


def _sample_pairs(manifest: Manifest) -> list[dict[str, NDArray[np.uint8]]]:
    """The sample frames of the package as the inputs of a model of both images."""
    assert manifest.depth_encoding is not None
    encoding = DepthEncoding.from_dict(dict(manifest.depth_encoding))
    pairs = []
    for sample in sample_frames():
        images = {COLOUR: sample.image(), DEPTH: to_bytes(sample.depth_m(), encoding)}
        pair = {}
        for kind, target in manifest.graph_inputs.items():
            height, width = images[kind].shape[:2]
            fit = Letterbox.fit(width, height, target.width, target.height)
            pair[kind] = fit.apply(images[kind], manifest.pad_value_of(target))[None]
        pairs.append(pair)
    return pairs
