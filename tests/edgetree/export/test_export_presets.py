"""Export of presets without training, and their cost in the manifest."""

from pathlib import Path

import onnx
import pytest
import torch

from edgetree.export import ExportReport, ExportSettings, export_preset
from edgetree.export.models import untrained_model
from edgetree.runtime.detector import TreeDetector
from perceptree.models import PRESETS
from perceptree.models.cost import classifier_cost, multiply_adds, parameters

LIGHT = [preset for preset in PRESETS if preset.startswith("edge-")]
PAPER = [preset for preset in PRESETS if preset not in LIGHT]


def assert_verified(report: ExportReport, settings: ExportSettings) -> None:
    figures = report.parity.figures()
    assert report.parity.faults() == []
    assert figures["trees_compared"] > 0
    assert figures["frames"] == 3 + 3
    manifest = TreeDetector.load(report.path).manifest
    assert manifest == report.manifest
    assert manifest.training_data == "untrained"
    image = onnx.load(report.path).graph.input[0]
    sizes = [size.dim_value for size in image.type.tensor_type.shape.dim]
    assert sizes[:3] == [settings.batch, settings.height, settings.width]


@pytest.mark.parametrize(
    ("modality", "batch", "precision"),
    [pytest.param("rgb", 4, "fp32", marks=pytest.mark.slow), ("depth", 1, "int8")],
)
def test_a_light_preset_is_verified_without_training(
    modality: str, batch: int, precision: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    settings = ExportSettings(height=96, width=160, batch=batch, precision=precision)
    out = tmp_path / "model.onnx"
    said: list[str] = []
    report = export_preset("edge-n", out, modality=modality, settings=settings, say=said.append)
    assert_verified(report, settings)
    assert any("trees not compared" in line for line in said) == (precision == "int8")
    assert report.manifest.modality == modality
    assert report.manifest.weight_bits == (7 if precision == "int8" else None)
    assert "score_threshold" not in capfd.readouterr().err  # a warning of onnxruntime


def test_an_untrained_network_has_varied_scores_and_is_reproducible() -> None:
    settings = ExportSettings(height=96, width=160)
    first, second = (untrained_model("edge-n", "rgb", settings) for _ in range(2))
    for mine, theirs in zip(first.parameters(), second.parameters(), strict=True):
        assert torch.equal(mine, theirs)
    images = torch.randint(0, 256, (2, 96, 160, 3), dtype=torch.uint8)
    with torch.inference_mode():
        found = first.detect(images)
    assert int(found.num_detections.min()) > 3
    assert float(found.scores.max()) > 0.5


def test_the_costs_in_the_manifest_are_those_of_the_network(tmp_path: Path) -> None:
    from edgetree.export.build import describe
    from perceptree.models import TreeRCNN, make_spec

    model = TreeRCNN(make_spec("r50", "rgb", 96, 160))
    manifest = describe(model, "untrained", ExportSettings())
    assert manifest.parameters == parameters(model)
    assert manifest.multiply_adds == multiply_adds(model)
    assert manifest.classifier is not None
    costs = manifest.classifier.parameters, manifest.classifier.multiply_adds
    assert costs == tuple(classifier_cost("resnet50", stride_in_1x1=True))
    assert costs[0] == pytest.approx(25.6e6, rel=0.01)  # as publications give it


@pytest.mark.slow
@pytest.mark.parametrize("batch", [1, 4])
@pytest.mark.parametrize(
    ("preset", "modality"),
    [*((p, m) for p in LIGHT for m in ("rgb", "depth")), *((p, "rgb") for p in PAPER)],
)
def test_every_preset_is_verified_without_training(
    preset: str, modality: str, batch: int, tmp_path: Path
) -> None:
    settings = ExportSettings(height=256, width=256, batch=batch)
    out = tmp_path / "model.onnx"
    report = export_preset(preset, out, modality=modality, settings=settings)
    assert_verified(report, settings)
