import dataclasses
import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import onnx
import pytest
import torch
from typer.testing import CliRunner

from basetree.errors import EdgetreeError, InputError
from edgetree.bench.profile import count_multiply_adds
from edgetree.cli import app
from edgetree.export import (
    ExportReport,
    ExportSettings,
    ParityFailed,
    export_model,
    verify_model,
)
from edgetree.export.frames import find_frames
from edgetree.export.models import load_model
from edgetree.runtime.detector import TreeDetector
from perceptree.models import load_checkpoint, save_checkpoint

INT8 = ExportSettings(precision="int8")


def test_file_and_checkpoint_give_the_same_detections(exported: ExportReport) -> None:
    figures = exported.parity.figures()
    assert figures["frames"] == 6 + 3
    assert figures["trees_compared"] > 40
    assert figures["matched_fraction"] == 1.0
    assert figures["box_px_max"] < 0.05
    assert figures["keypoint_score_max"] < 1e-3


def test_the_manifest_describes_the_file(exported: ExportReport, rgb_checkpoint: Path) -> None:
    manifest = TreeDetector.load(exported.path).manifest
    assert manifest == exported.manifest
    assert (manifest.modality, manifest.precision) == ("rgb", "float32")
    assert (manifest.input.height, manifest.input.width) == (96, 160)
    assert manifest.training_data == "random numbers"
    assert manifest.reach_m == 12.0
    usual = {(each.statistic, each.low, each.high) for each in manifest.training_pictures}
    assert usual == {("lightness", 50.0, 190.5), ("contrast", 20.0, 70.0)}
    assert len(manifest.weights_sha256) == 64
    assert manifest.parity is not None
    assert manifest.parity["matched_fraction"] == 1.0
    model, _ = load_checkpoint(rgb_checkpoint)
    assert manifest.parameters == sum(p.numel() for p in model.parameters())
    assert manifest.mean == model.spec.mean


def test_counted_multiply_adds_equal_those_that_torch_counts(exported: ExportReport) -> None:
    model_input = exported.manifest.input
    image = np.zeros((1, *model_input.image_shape), np.uint8)
    counted = count_multiply_adds(exported.path, {model_input.name: image})
    # The graph enlarges the heads' maps in another way, which takes a little more.
    assert counted == pytest.approx(exported.manifest.multiply_adds, rel=0.03)


def test_the_detector_asks_the_file_for_the_trees_that_it_shows_alone(
    exported: ExportReport,
) -> None:
    image = np.random.default_rng(2).integers(0, 256, (90, 150, 3), np.uint8)
    every = TreeDetector.load(exported.path, threads=1, score_threshold=0.01)
    median = float(np.median(every.detect(image).scores))
    few = TreeDetector.load(exported.path, threads=1, score_threshold=median)
    shown, expected = few.detect(image), every.detect(image).above(median)
    assert 0 < len(shown) < len(every.detect(image))
    np.testing.assert_array_equal(shown.boxes_px, expected.boxes_px)
    np.testing.assert_allclose(shown.masks, expected.masks, atol=1e-5)
    pixels = few.prepare(image)[None]
    outputs = few.session.run(few.inputs_of(pixels))
    assert (
        len(shown)
        <= outputs["num_detections"][0]
        < every.session.run(every.inputs_of(pixels))["num_detections"][0]
    )


def test_every_size_is_static_and_every_roi_align_attribute_written(
    exported: ExportReport,
) -> None:
    proto = onnx.load(exported.path)
    for value in (*proto.graph.input, *proto.graph.output):
        sizes = [size.dim_value for size in value.type.tensor_type.shape.dim]
        assert min(sizes) > 0, value.name
    names = {"coordinate_transformation_mode", "mode", "output_height", "output_width"}
    names |= {"sampling_ratio", "spatial_scale"}
    pooling = [node for node in proto.graph.node if node.op_type == "RoiAlign"]
    assert len(pooling) == 3
    for node in pooling:
        assert {attribute.name for attribute in node.attribute} == names


def test_the_file_holds_no_paths_of_this_machine(exported: ExportReport) -> None:
    content = exported.path.read_bytes()
    assert b"site-packages" not in content
    assert b".py:" not in content
    assert b'.py"' not in content
    assert str(Path(__file__).resolve().parents[3]).encode() not in content


@pytest.mark.slow
def test_a_depth_model_without_masks_has_no_such_output(
    depth_checkpoint: Path, frame_folder: Path, tmp_path: Path
) -> None:
    report = export_model(depth_checkpoint, tmp_path / "depth.onnx", data=frame_folder)
    assert report.manifest.output_names == ("boxes", "scores", "keypoints", "num_detections")
    detector = TreeDetector.load(report.path, score_threshold=0.0)
    trees = detector.detect(np.full((180, 320), 5.0, np.float32))
    assert trees.masks is None


def test_verify_passes_the_right_checkpoint_and_refuses_others(
    exported: ExportReport, rgb_checkpoint: Path, frame_folder: Path, tmp_path: Path
) -> None:
    verify_model(exported.path, rgb_checkpoint, data=frame_folder)
    model, _ = load_checkpoint(rgb_checkpoint)
    with torch.no_grad():
        model.box_head.shift.bias.add_(0.5)
    save_checkpoint(tmp_path / "shifted.safetensors", model, {})
    with pytest.raises(ParityFailed, match="box_px differs by"):
        verify_model(exported.path, tmp_path / "shifted.safetensors", data=frame_folder)


def test_swapped_colours_are_refused(
    exported: ExportReport, rgb_checkpoint: Path, frame_folder: Path, tmp_path: Path
) -> None:
    model, _ = load_checkpoint(rgb_checkpoint)
    model.spec = dataclasses.replace(model.spec)
    stem = model.backbone.trunk.conv_stem.weight
    with torch.no_grad():
        stem.copy_(stem.flip(1).clone())
    save_checkpoint(tmp_path / "swapped.safetensors", model, {})
    with pytest.raises(ParityFailed):
        verify_model(exported.path, tmp_path / "swapped.safetensors", data=frame_folder)


@pytest.mark.usefixtures("shared_traces")
def test_int8_that_loses_trees_is_not_written(
    rgb_checkpoint: Path, frame_folder: Path, tmp_path: Path
) -> None:
    out, blank = tmp_path / "out", tmp_path / "blank"
    out.mkdir()
    blank.mkdir()
    cv2.imwrite(str(blank / "0.png"), np.full((96, 160, 3), 114, np.uint8))
    command = ["export", str(rgb_checkpoint), "--out", str(out / "m.onnx")]
    command += ["--data", str(frame_folder), "--precision", "int8", "--calibration", str(blank)]
    result = CliRunner().invoke(app, command)
    assert isinstance(result.exception, ParityFailed)
    assert result.exception.exit_code == 1
    assert "trees matched, limit 95%" in str(result.exception)
    assert "mask IoU" in result.output  # the table
    assert list(out.iterdir()) == []


def test_a_data_set_is_compared_on_its_test_frames(frame_folder: Path, tmp_path: Path) -> None:
    folder = tmp_path / "data"
    shutil.copytree(frame_folder, folder)
    assert len(find_frames(folder, "rgb", 20, test_split=True)) == 6
    split = {"images": [{"file_name": "images/000001.png"}, {"file_name": "images/000004.png"}]}
    (folder / "test_RGB.json").write_text(json.dumps(split))
    for modality in ("rgb", "depth"):
        test_split = find_frames(folder, modality, 20, test_split=True)
        assert [path.stem for path in test_split] == ["000001", "000004"]
        assert len(find_frames(folder, modality, 20)) == 6
    (folder / "test_RGB.json").write_text("[]")
    with pytest.raises(InputError, match=r"test_RGB.json: not a COCO file"):
        find_frames(folder, "rgb", 20, test_split=True)


def test_int8_needs_frames_beside_those_compared_on(
    rgb_checkpoint: Path, frame_folder: Path, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match="has no frames beside those compared on"):
        export_model(rgb_checkpoint, tmp_path / "m.onnx", data=frame_folder, settings=INT8)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("shared_traces")
def test_the_commands_verify_and_print(
    rgb_checkpoint: Path, frame_folder: Path, tmp_path: Path
) -> None:
    out = tmp_path / "model.onnx"
    base = ["--data", str(frame_folder), "--json"]
    made = CliRunner().invoke(app, ["export", str(rgb_checkpoint), "--out", str(out), *base])
    assert made.exit_code == 0, made.output
    record = json.loads(made.stdout)
    assert record["file_bytes"] == out.stat().st_size
    checked = CliRunner().invoke(app, ["verify", str(out), str(rgb_checkpoint), *base])
    assert checked.exit_code == 0, checked.output
    assert json.loads(checked.stdout)["parity"]["matched_fraction"] == 1.0


def test_bad_input_leaves_nothing_behind(
    rgb_checkpoint: Path, frame_folder: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    out.mkdir()
    with pytest.raises(InputError, match="precision is 'fp4': expected one of fp32, fp16, int8"):
        export_model(
            rgb_checkpoint,
            out / "m.onnx",
            data=frame_folder,
            settings=ExportSettings(precision="fp4"),
        )
    with pytest.raises(InputError, match="is no folder: expected one with rgb frames"):
        export_model(rgb_checkpoint, out / "m.onnx", data=tmp_path / "none")
    with pytest.raises(InputError, match="has no rgb frames"):
        export_model(rgb_checkpoint, out / "m.onnx", data=out)
    with pytest.raises(InputError, match=r"m.txt: expected a name that ends in .onnx"):
        export_model(rgb_checkpoint, out / "m.txt", data=frame_folder)
    with pytest.raises(InputError, match="is no folder"):
        export_model(rgb_checkpoint, tmp_path / "made" / "m.onnx", data=tmp_path / "none")
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="cannot be written"):
        export_model(rgb_checkpoint, tmp_path / "file" / "m.onnx", data=frame_folder)
    assert list(out.iterdir()) == []
    assert not (tmp_path / "made").exists()


@pytest.mark.parametrize("reach_m", ["far", -1, True, [10.0]])
def test_an_impossible_reach_is_named(
    rgb_checkpoint: Path, tmp_path: Path, reach_m: object
) -> None:
    model, _ = load_checkpoint(rgb_checkpoint)
    path = tmp_path / "odd.safetensors"
    save_checkpoint(path, model, {"reach_m": reach_m})
    with pytest.raises(EdgetreeError, match=r"odd.safetensors: reach_m of the training is"):
        load_model(path)


@pytest.mark.parametrize("pictures", [3, {"contrast": 20}, {"contrast": [20]}, {"contrast": "ab"}])
def test_impossible_training_pictures_are_named(
    rgb_checkpoint: Path, tmp_path: Path, pictures: object
) -> None:
    model, _ = load_checkpoint(rgb_checkpoint)
    path = tmp_path / "odd.safetensors"
    save_checkpoint(path, model, {"pictures": pictures})
    with pytest.raises(EdgetreeError, match=r"odd.safetensors: training pictures"):
        load_model(path)
