"""Export settings: they are checked, and reach graph, manifest and verification."""

import json
import sys
from pathlib import Path
from typing import Any, NamedTuple

import onnx
import pytest
from once import Once
from typer.testing import CliRunner

from basetree.errors import InputError
from edgetree import cli
from edgetree.errors import ModelFileError
from edgetree.export import (
    ExportReport,
    ExportSettings,
    ParityFailed,
    verify_model,
)
from edgetree.export.models import with_settings
from edgetree.model_file.manifest import METADATA_KEY
from edgetree.runtime.detector import TreeDetector
from perceptree.models import load_checkpoint
from perceptree.models.cost import multiply_adds

CHOSEN = ExportSettings(
    height=128,
    width=192,
    batch=2,
    max_detections=7,
    proposals=60,
    score_threshold=0.97,
    opset=18,
    target="openvino",
)


class Chosen(NamedTuple):
    """A file exported with all command line options, and what the command printed."""

    path: Path
    record: dict[str, Any]
    stderr: str


@pytest.fixture(scope="module")
def chosen(rgb_checkpoint: Path, frame_folder: Path, once: Once) -> Chosen:
    def export(folder: Path) -> tuple[Path, Any, str]:
        out = folder / "model.onnx"
        done = CliRunner().invoke(
            cli.app,
            [
                *("export", str(rgb_checkpoint), "--out", str(out), "--data", str(frame_folder)),
                *("--height", "128", "--width", "192", "--batch", "2", "--max-detections", "7"),
                *("--proposals", "60", "--score-threshold", "0.97", "--opset", "18"),
                *("--provider", "openvino", "--json"),
            ],
        )
        assert done.exit_code == 0, done.output
        return out, json.loads(done.stdout), done.stderr

    return Chosen(*once.value("export-chosen", export))


def test_the_libraries_chatter_is_not_shown(chosen: Chosen) -> None:
    assert "arning" not in chosen.stderr
    assert "Attribute type" not in chosen.stderr


def test_settings_reach_the_graph(chosen: Chosen, frame_folder: Path) -> None:
    proto = onnx.load(chosen.path)
    assert {entry.version for entry in proto.opset_import if entry.domain in ("", "ai.onnx")} == {
        18
    }
    shapes = {value.name: _sizes(value) for value in (*proto.graph.input, *proto.graph.output)}
    assert shapes["image"] == [2, 128, 192, 3]
    assert shapes["boxes"] == [2, 7, 4]
    assert shapes["keypoints"] == [2, 7, 5, 3]
    assert shapes["masks"] == [2, 7, 28, 28]
    # The box head pools the proposals of both frames, the other heads as many boxes as there are.
    inferred = onnx.shape_inference.infer_shapes(proto).graph.value_info
    rows = {v.name: v.type.tensor_type.shape.dim[0].dim_value for v in inferred if _sizes(v)}
    pooled = [rows[node.output[0]] for node in proto.graph.node if node.op_type == "RoiAlign"]
    assert sorted(pooled) == [0, 0, 2 * 60]


def _sizes(value: Any) -> list[int]:
    return [size.dim_value for size in value.type.tensor_type.shape.dim]


def test_settings_are_in_the_manifest_and_the_record(
    chosen: Chosen, exported: ExportReport, rgb_checkpoint: Path
) -> None:
    out, record = chosen.path, chosen.record
    manifest = TreeDetector.load(out).manifest
    assert manifest.input.size_text == "192x128"
    assert manifest.input.batch_sizes == (2,)
    assert {output.shape[1] for output in manifest.outputs[:-1]} == {7}
    assert manifest.proposals == 60
    assert manifest.thresholds.score == 0.97
    assert (manifest.opset, manifest.target) == (18, "openvino")
    model = with_settings(load_checkpoint(rgb_checkpoint)[0], CHOSEN)
    assert manifest.multiply_adds == multiply_adds(model) != exported.manifest.multiply_adds
    assert manifest.weights_sha256 == exported.manifest.weights_sha256
    assert record["input_px"] == [192, 128]
    assert (record["batch"], record["proposals"], record["opset"]) == (2, 60, 18)
    assert record["provider"] == "openvino"
    assert record["multiply_adds"] == manifest.multiply_adds
    assert record["parameters"] == manifest.parameters


def test_no_score_is_below_the_threshold(
    chosen: Chosen, exported: ExportReport, frame_folder: Path
) -> None:
    from edgetree.frames.images import read_image

    image = read_image(frame_folder / "images" / "000000.png")
    every = TreeDetector.load(exported.path, score_threshold=0.0).detect(image)
    assert float(every.scores.min()) < 0.97
    found = TreeDetector.load(chosen.path, score_threshold=0.0).detect(image)
    assert len(found.scores) > 0
    assert float(found.scores.min()) > 0.97


def test_verify_uses_the_settings_of_the_file(
    chosen: Chosen, rgb_checkpoint: Path, frame_folder: Path
) -> None:
    report = verify_model(chosen.path, rgb_checkpoint, data=frame_folder)
    figures = report.parity.figures()
    recorded = report.manifest.parity
    assert recorded is not None
    assert figures["trees_compared"] == recorded["trees_compared"] > 10


@pytest.mark.parametrize(
    ("options", "line"),
    [
        (["--precision", "fp4"], "precision is 'fp4': expected one of fp32, fp16, int8"),
        (
            ["--precision", "int8", "--provider", "cuda"],
            "precision is 'int8': expected fp32 or fp16 for the provider cuda",
        ),
        (["--provider", "tpu"], "provider is 'tpu': expected one of cpu, cuda"),
        (["--opset", "7"], "opset is 7: expected 18 to 23"),
        (["--batch", "0"], "batch is 0: expected 1 to 64"),
        (["--proposals", "0"], "proposals is 0: expected 1 to 10000"),
        (["--max-detections", "1001"], "max_detections is 1001: expected 1 to 1000"),
        (["--proposals", "19"], "detections is 20 with 19 proposals, expected at most 19"),
        (["--max-detections", "101"], "detections is 101 with 100 proposals, expected at most 100"),
        (["--score-threshold", "1.5"], "score_threshold is 1.5: expected 0 or more, under 1"),
        (["--height", "8"], "the input is 8x160, expected 32 to 8192 px each way"),
    ],
)
def test_a_wrong_setting_gives_one_line(
    options: list[str],
    line: str,
    rgb_checkpoint: Path,
    frame_folder: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    out = tmp_path / "model.onnx"
    base = ["edgetree", "export", str(rgb_checkpoint), "--out", str(out)]
    monkeypatch.setattr(sys, "argv", [*base, "--data", str(frame_folder), *options])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    message = capfd.readouterr().err.strip()
    assert ended.value.code == 2
    assert line in message
    assert "\n" not in message
    assert list(tmp_path.iterdir()) == []


BROKEN = [
    "model.box_head.hidden.0.weight",
    "model.box_head.score.weight",
    "model.pyramid",
    "model.mask_head.tower.convs.1.weight",
    "model.keypoint_head.tower.convs.2.weight",
]


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_weight_in_the_file_is_refused(
    name: str, exported: ExportReport, rgb_checkpoint: Path, frame_folder: Path, tmp_path: Path
) -> None:
    proto = onnx.load(exported.path)
    weight = next(value for value in proto.graph.initializer if value.name.startswith(name))
    values = onnx.numpy_helper.to_array(weight)
    broken = -values if values.any() else values + 1.0
    weight.CopyFrom(onnx.numpy_helper.from_array(broken.astype(values.dtype), weight.name))
    onnx.save(proto, tmp_path / "broken.onnx")
    with pytest.raises(ParityFailed):
        verify_model(tmp_path / "broken.onnx", rgb_checkpoint, data=frame_folder)


@pytest.mark.parametrize(
    ("name", "field", "wrong"),
    [("coordinate_transformation_mode", "s", b"output_half_pixel"), ("sampling_ratio", "i", 2)],
)
def test_a_wrong_roi_align_attribute_is_refused(
    name: str,
    field: str,
    wrong: object,
    exported: ExportReport,
    rgb_checkpoint: Path,
    frame_folder: Path,
    tmp_path: Path,
) -> None:
    proto = onnx.load(exported.path)
    for node in proto.graph.node:
        for attribute in node.attribute:
            if node.op_type == "RoiAlign" and attribute.name == name:
                assert getattr(attribute, field) != wrong
                setattr(attribute, field, wrong)
    onnx.save(proto, tmp_path / "wrong.onnx")
    with pytest.raises(ParityFailed):
        verify_model(tmp_path / "wrong.onnx", rgb_checkpoint, data=frame_folder)


def test_a_file_of_another_modality_is_refused(
    exported: ExportReport, depth_checkpoint: Path, frame_folder: Path, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match="takes rgb frames: expected depth frames"):
        verify_model(exported.path, depth_checkpoint, data=frame_folder)
    proto = onnx.load(exported.path)
    manifest = json.loads(exported.manifest.to_json())
    manifest["modality"] = "depth"
    onnx.helper.set_model_props(proto, {METADATA_KEY: json.dumps(manifest)})
    onnx.save(proto, tmp_path / "claims.onnx")
    with pytest.raises(ModelFileError, match="manifest: input layout is 'BHWC': expected 'BHW'"):
        verify_model(tmp_path / "claims.onnx", depth_checkpoint, data=frame_folder)
