"""`edgetree eval` of a file and `perceptree eval` of its checkpoint give the same report."""

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from calib import CocoLabels
from edgetree import TreeDetector
from edgetree.export import ExportReport, verify_model
from perceptree.cli import main as perceptree_main
from perceptree.keypoints import KEYPOINT_NAMES

Cli = Callable[..., Any]
SHARE_OF_TREES = 0.6


@pytest.fixture(scope="session")
def labelled(exported: ExportReport, frame_folder: Path, tmp_path_factory: Any) -> Path:
    """Frames labelled with some detections of the file, each slightly displaced."""
    folder = tmp_path_factory.mktemp("labelled")
    detector = TreeDetector.load(exported.path, score_threshold=0.05)
    rng = np.random.default_rng(2)
    labels = CocoLabels("tree", KEYPOINT_NAMES)
    for path in sorted((frame_folder / "images").glob("*.png")):
        image = cv2.imread(str(path))
        (folder / "images").mkdir(exist_ok=True)
        cv2.imwrite(str(folder / "images" / path.name), image)
        height, width = image.shape[:2]
        labels.add_image(f"images/{path.name}", width, height)
        trees = detector.detect(np.asarray(image, np.uint8))
        assert trees.masks is not None
        assert trees.keypoints_px is not None
        for index in np.flatnonzero(rng.uniform(size=len(trees)) < SHARE_OF_TREES):
            x0, y0, x1, y1 = trees.boxes_px[index]
            aside = rng.uniform(-0.1, 0.1, 4) * np.tile([x1 - x0, y1 - y0], 2)
            low, high = np.array([x0, y0]) + aside[:2], np.array([x1, y1]) + aside[2:]
            corners = np.clip([low, high], 0, [width, height])
            mask = trees.mask(int(index))
            if mask.sum() > 20:
                points = trees.keypoints_px[index] + rng.normal(0, 3, (5, 3))
                labels.add(corners.ravel(), 1.0, mask, points)
    (folder / "test_RGB.json").write_text(json.dumps(labels.to_dict()))
    return folder


def report_of_checkpoint(
    checkpoint: Path, data: Path, monkeypatch: pytest.MonkeyPatch, capfd: Any
) -> Any:
    arguments = ["perceptree", "eval", str(checkpoint), str(data), "--json"]
    monkeypatch.setattr(sys, "argv", arguments)
    with pytest.raises(SystemExit) as ended:
        perceptree_main()
    assert ended.value.code == 0
    return json.loads(capfd.readouterr().out)


def test_a_checkpoint_and_its_float32_file_score_equal(
    exported: ExportReport,
    rgb_checkpoint: Path,
    labelled: Path,
    run_cli: Cli,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    done = run_cli("eval", exported.path, labelled, "--json")
    assert done.code == 0
    file = json.loads(done.out)
    checkpoint = report_of_checkpoint(rgb_checkpoint, labelled, monkeypatch, capfd)
    assert file.keys() == checkpoint.keys()
    for kind, found in checkpoint["average_precision"].items():
        assert 2 < found["ap"] < 98, kind  # neither perfect nor empty
        for name in ("ap", "ap50", "ap75"):
            theirs = file["average_precision"][kind][name]
            assert theirs == pytest.approx(found[name], abs=0.1), (kind, name)
    assert file["at_score"] == checkpoint["at_score"]
    error = checkpoint["diameter_error_px"]["mean_abs"]
    assert file["diameter_error_px"]["mean_abs"] == pytest.approx(error, abs=0.05)
    assert file["model"]["kind"] == "ONNX file"
    assert file["model"]["weights_sha256"] == exported.manifest.weights_sha256
    assert file["model"]["input_px"] == checkpoint["model"]["input_px"]


def test_labels_give_average_precision_to_the_verification(
    exported: ExportReport, rgb_checkpoint: Path, labelled: Path, tamper: Callable[..., Path]
) -> None:
    file = tamper(exported.path, precision="float16")
    report = verify_model(file, rgb_checkpoint, data=labelled).parity
    assert report.average_precision.keys() == {"box", "mask", "keypoint"}
    assert report.not_checked == ()


def test_the_report_is_a_folder_with_an_html_page(
    exported: ExportReport, labelled: Path, run_cli: Cli, tmp_path: Path
) -> None:
    out = tmp_path / "made" / "report"
    done = run_cli("eval", exported.path, labelled, "--out", out)
    assert done.code == 0
    assert "of" in done.out
    assert f"open: {out / 'report.html'}" in done.err
    figures = json.loads((out / "report.json").read_text())
    assert figures["schema"] == "perceptree.evaluation/1"
    assert f"{figures['at_score']['found']} of {figures['data']['trees']} trees found" in done.out


MISTAKES = {
    "no model": (("none.onnx", "{data}"), "none.onnx"),
    "no data": (("{model}", "{data}/none"), "none"),
    "split": (("{model}", "{data}", "--split", "spring"), "--split is 'spring'"),
    "other inputs": (("{model}", "{data}", "--inputs", "stereo"), "--inputs is 'stereo': expected"),
    "one input": (("{model}", "{data}", "--inputs", "depth"), "takes one image: expected no"),
    "no val": (("{model}", "{data}", "--split", "val"), "val"),
    "out is a file": (("{model}", "{data}", "--out", "{data}/test_RGB.json"), "cannot be written"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_one_line(
    exported: ExportReport, labelled: Path, run_cli: Cli, mistake: str
) -> None:
    arguments, expected = MISTAKES[mistake]
    done = run_cli("eval", *(part.format(model=exported.path, data=labelled) for part in arguments))
    assert (done.code, done.out) == (2, "")
    assert done.err.count("\n") == 1
    assert expected in done.err


def test_without_the_training_setup_it_says_what_to_install(
    exported: ExportReport, labelled: Path, run_cli: Cli, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "perceptree.evaluation", None)
    done = run_cli("eval", exported.path, labelled)
    assert done.code == 2
    assert 'pip install ".[train]"' in done.err
    assert done.err.count("\n") == 1
