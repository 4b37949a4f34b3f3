"""Exports of networks of colour and depth: of both, and of each alone."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import onnx
import onnxruntime
import pytest
import torch
from once import Once

from basetree.errors import InputError
from calib import write_depth
from edgetree.evaluate import predict_with_file
from edgetree.export import ExportReport, ExportSettings, export_model, verify_model
from edgetree.export.frames import find_views, only, read_frames
from edgetree.export.quantise import quantise
from edgetree.export.settings import OPSET
from edgetree.runtime.detector import TreeDetector
from edgetree.runtime.input_images import by_input
from perceptree.models import SpecError, load_checkpoint
from perceptree.models.branches import pruned

COLOUR_ALONE = ("lightness", "contrast")


@pytest.fixture(scope="module")
def both(both_checkpoint: Path, frame_folder: Path, once: Once) -> ExportReport:
    """The file of both inputs in float32."""
    report: ExportReport = once.value(
        "export-both-float32",
        lambda folder: export_model(both_checkpoint, folder / "both.onnx", data=frame_folder),
    )
    return report


def test_the_file_finds_what_the_checkpoint_finds_also_of_one_alone(both: ExportReport) -> None:
    frames = {frame.name: frame for frame in both.parity.frames}
    for alone in ("colour", "depth"):
        assert frames[f"{alone} alone 0"].trees > 0
    assert both.parity.figures()["matched_fraction"] == 1.0


def test_the_inputs_have_names(both: ExportReport) -> None:
    graph = onnx.load(both.path).graph
    shapes = {
        each.name: [size.dim_value for size in each.type.tensor_type.shape.dim]
        for each in graph.input
    }
    assert shapes == {"colour": [1, 96, 160, 3], "depth": [1, 96, 160], "score_threshold": [1]}
    manifest = TreeDetector.load(both.path).manifest
    assert manifest.modality == "both"
    assert [each.name for each in manifest.inputs] == ["colour", "depth"]
    assert [each.pad_value for each in manifest.inputs] == [114, 255]
    assert [each.nothing for each in manifest.inputs] == [0, 255]
    assert manifest.input == manifest.inputs[1]
    assert {each.statistic for each in manifest.training_pictures} == {*COLOUR_ALONE, "median_m"}


@pytest.mark.parametrize(
    ("inputs", "modality", "looks"),
    [("depth", "depth", {"median_m"}), ("colour", "rgb", set(COLOUR_ALONE))],
)
def test_the_other_branch_is_left_out(
    both_checkpoint: Path,
    frame_folder: Path,
    tmp_path: Path,
    both: ExportReport,
    inputs: str,
    modality: str,
    looks: set[str],
) -> None:
    file = tmp_path / "one.onnx"
    settings = ExportSettings(inputs=inputs)
    report = export_model(both_checkpoint, file, data=frame_folder, settings=settings)
    manifest = TreeDetector.load(file).manifest
    assert (manifest.modality, manifest.inputs, manifest.input.name) == (modality, (), "image")
    assert {each.statistic for each in manifest.training_pictures} == looks
    model, _ = load_checkpoint(both_checkpoint)
    alone = pruned(model, inputs)  # type: ignore[arg-type]
    assert manifest.parameters == sum(each.numel() for each in alone.parameters())
    assert manifest.name == alone.spec.name
    assert report.file_bytes < 0.75 * both.file_bytes
    assert verify_model(file, both_checkpoint, data=frame_folder).parity.faults() == []


def test_an_evaluation_shows_one_of_both(
    both_checkpoint: Path, frame_folder: Path, both: ExportReport
) -> None:
    detector = TreeDetector.load(both.path)
    model, _ = load_checkpoint(both_checkpoint)
    frames = read_frames(find_views(frame_folder, "both", 2), model.spec)[:1]
    scores = {}
    for inputs in ("both", "colour", "depth"):
        found = predict_with_file(detector.session, detector.manifest, inputs)(frames)
        shown = frames if inputs == "both" else only(inputs, frames, model.spec)
        expected = predict_with_file(detector.session, detector.manifest)(shown)
        np.testing.assert_array_equal(found.scores, expected.scores)
        scores[inputs] = found.scores[0, 0]
    assert len(set(scores.values())) == len(scores)


def _of_8_bits(node: Any, makers: dict[str, Any]) -> bool:
    return all(makers.get(n, node).op_type == "DequantizeLinear" for n in node.input)


def test_int8_reads_the_bytes_of_both(
    both_checkpoint: Path, frame_folder: Path, traced: Callable[..., Any], both: ExportReport
) -> None:
    model, _ = load_checkpoint(both_checkpoint)
    frames = read_frames(find_views(frame_folder, "both", 6), model.spec)
    proto = quantise(traced(model, 1, OPSET, quantised=True), frames)
    run = onnxruntime.InferenceSession(proto.SerializeToString()).run
    for alone in ("both", "colour", "depth"):
        shown = frames[:1] if alone == "both" else only(alone, frames[:1], model.spec)
        images = by_input(shown, both.manifest)
        boxes, scores = run(["boxes", "scores"], images)
        with torch.inference_mode():
            expected = model.detect(torch.from_numpy(shown))
        assert np.isfinite(boxes).all()
        assert scores[0, 0] == pytest.approx(float(expected.scores[0, 0]), abs=0.3)
    # Neither image becomes a float: those that begin with 8 bits end with them.
    makers = {output: node for node in proto.graph.node for output in node.output}
    quantised = [node for node in proto.graph.node if node.op_type == "QuantizeLinear"]
    assert not [n for n in quantised if makers.get(n.input[0], n).op_type == "Sub"]
    # Nor do the maps that are blended: each of three levels is scaled by what its image shows.
    scaled = [n for n in proto.graph.node if n.op_type == "Mul" and _of_8_bits(n, makers)]
    assert len(scaled) == 6


def test_a_checkpoint_of_depth_has_no_colour(depth_checkpoint: Path, frame_folder: Path) -> None:
    settings = ExportSettings(inputs="colour")
    with pytest.raises(SpecError, match="takes depth, expected one of both inputs"):
        export_model(depth_checkpoint, Path("x.onnx"), data=frame_folder, settings=settings)


def test_frames_without_a_partner_are_not_compared(tmp_path: Path) -> None:
    for folder in ("images", "depth"):
        (tmp_path / folder).mkdir()
    image, depth_m = np.zeros((40, 60, 3), np.uint8), np.ones((40, 60), np.float32)
    for name in ("a", "b"):
        cv2.imwrite(str(tmp_path / "images" / f"{name}.png"), image)
    for name in ("b", "c"):
        write_depth(tmp_path / "depth" / f"{name}.png", depth_m)
    found = find_views(tmp_path, "both", 5)
    assert [[path.name for path in view] for view in found] == [["b.png", "b.png"]]
    (tmp_path / "images" / "b.png").unlink()
    with pytest.raises(InputError, match="no pairs of colour and depth: expected files of the sam"):
        find_views(tmp_path, "both", 5)


def test_colour_and_depth_of_different_sizes_are_refused(
    tmp_path: Path, both_checkpoint: Path
) -> None:
    for folder in ("images", "depth"):
        (tmp_path / folder).mkdir()
    cv2.imwrite(str(tmp_path / "images/a.png"), np.zeros((40, 60, 3), np.uint8))
    write_depth(tmp_path / "depth/a.png", np.ones((20, 30), np.float32))
    model, _ = load_checkpoint(both_checkpoint)
    with pytest.raises(InputError, match=r"a.png: colour is 60x40 px and depth 30x20 px"):
        read_frames(find_views(tmp_path, "both", 5), model.spec)
