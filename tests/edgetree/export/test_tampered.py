"""Files with a tampered mask or keypoint head are refused, with and without labels."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest

from edgetree import default_model
from edgetree.export import ExportReport, ParityFailed, verify_model
from edgetree.samples import sample_frames

Cli = Callable[..., Any]
Tamper = Callable[..., Path]

DEPTH_CHECKPOINT = Path(__file__).parents[3] / "checkpoints" / "edge-n-depth.safetensors"
KEYPOINT_LAYER, MASK_LAYER = "model.keypoint_head.tower.up", "model.mask_head.score"
HEADS = {
    "keypoints zeroed": ({KEYPOINT_LAYER: np.zeros_like}, "keypoint_shift_median is"),
    "mask inverted": ({MASK_LAYER: np.negative}, "mask_iou_median is"),
}
NO_LABELS = "average precision not measured: no labelled frames; give --data"


@pytest.fixture(scope="module")
def sample_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The package's depth frames of the preset `paper`, without labels.

    The two of the preset `field` show so many trees at the edge of being found that the 8-bit file
    and its checkpoint differ in more of them than over a whole set.
    """
    folder = tmp_path_factory.mktemp("samples")
    for sample in list(sample_frames())[:4]:
        shutil.copy(sample.depth_path, folder)
    return folder


def test_the_embedded_int8_file_passes_on_unlabelled_frames(sample_folder: Path) -> None:
    report = verify_model(default_model("depth"), DEPTH_CHECKPOINT, data=sample_folder).parity
    assert report.trees >= 40
    (missing,) = report.figures()["not_checked"]
    assert missing.startswith(NO_LABELS)


@pytest.mark.parametrize("head", HEADS)
def test_a_tampered_int8_file_is_refused_without_labels(
    head: str, sample_folder: Path, tamper: Tamper
) -> None:
    changes, message = HEADS[head]
    file = tamper(default_model("depth"), changes)
    with pytest.raises(ParityFailed, match=message):
        verify_model(file, DEPTH_CHECKPOINT, data=sample_folder)


def test_a_file_cannot_escape_the_limits_by_claiming_to_be_untrained(
    sample_folder: Path, tamper: Tamper
) -> None:
    changes, message = HEADS["keypoints zeroed"]
    file = tamper(default_model("depth"), changes, training_data="untrained")
    with pytest.raises(ParityFailed, match=message):
        verify_model(file, DEPTH_CHECKPOINT, data=sample_folder)


@pytest.mark.parametrize("head", HEADS)
def test_a_tampered_float16_file_is_refused_without_labels(
    head: str, exported: ExportReport, rgb_checkpoint: Path, frame_folder: Path, tamper: Tamper
) -> None:
    changes, message = HEADS[head]
    file = tamper(exported.path, changes, precision="float16")
    with pytest.raises(ParityFailed, match=message):
        verify_model(file, rgb_checkpoint, data=frame_folder)


def test_a_slightly_steeper_mask_is_refused_in_float32(
    exported: ExportReport, rgb_checkpoint: Path, frame_folder: Path, tamper: Tamper
) -> None:
    """Its binary masks are the same."""
    file = tamper(exported.path, {MASK_LAYER: lambda values: values * 1.05})
    with pytest.raises(ParityFailed, match="mask_probability differs by") as failed:
        verify_model(file, rgb_checkpoint, data=frame_folder)
    assert failed.value.report.figures()["mask_iou_min"] > 0.98


def test_a_file_that_leaves_an_output_out_is_refused(
    exported: ExportReport, rgb_checkpoint: Path, frame_folder: Path, tamper: Tamper, tmp_path: Path
) -> None:
    outputs = [
        output
        for output in json.loads(exported.manifest.to_json())["outputs"]
        if output["name"] != "masks"
    ]
    file = tamper(exported.path, outputs=outputs)
    proto = onnx.load(file)
    kept = [output for output in proto.graph.output if output.name != "masks"]
    del proto.graph.output[:]
    proto.graph.output.extend(kept)
    onnx.save(proto, file)
    with pytest.raises(ParityFailed, match="masks is missing"):
        verify_model(file, rgb_checkpoint, data=frame_folder)


def test_the_command_says_that_average_precision_was_not_measured(
    exported: ExportReport,
    rgb_checkpoint: Path,
    frame_folder: Path,
    tamper: Tamper,
    run_cli: Cli,
) -> None:
    file = tamper(exported.path, precision="float16")
    done = run_cli("verify", file, rgb_checkpoint, "--data", frame_folder)
    assert done.code == 0
    assert NO_LABELS in done.out
    assert "keypoint shift median: 0.0000, limit 0.005" in done.out
    done = run_cli("verify", file, rgb_checkpoint, "--data", frame_folder, "--json")
    parity = json.loads(done.out)["parity"]
    assert parity["average_precision"] == {}
    assert [line.startswith(NO_LABELS) for line in parity["not_checked"]] == [True]
    assert exported.parity.figures()["not_checked"] == []  # float32 needs no labels


def test_the_differences_are_a_table_with_a_line_for_each_frame(
    sample_folder: Path, tamper: Tamper, run_cli: Cli
) -> None:
    file = tamper(default_model("depth"), HEADS["keypoints zeroed"][0])
    done = run_cli("verify", file, DEPTH_CHECKPOINT, "--data", sample_folder)
    assert done.code == 1
    lines = done.err.splitlines()
    head = next(number for number, line in enumerate(lines) if line.startswith("frame "))
    named = [line.split()[0] for line in lines[head + 1 : head + 5]]
    assert named == sorted(path.stem[:15] for path in sample_folder.iterdir())
    assert all(
        len(line.split()) == len(lines[head + 1].split()) for line in lines[head + 1 : head + 5]
    )
