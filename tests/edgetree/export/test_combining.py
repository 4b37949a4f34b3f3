"""One file of three models finds what the right one of them finds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from stems_without_ground import STEMS

from basetree.arrays import Float32
from basetree.errors import CheckFailed, EdgetreeError
from edgetree import TreeDetections, TreeDetector, sample_frames
from edgetree.bench.profile import PARTS, network_times
from edgetree.catalogue import find_model
from edgetree.conformance import make_kit, read_kit
from edgetree.errors import ModelFileError
from edgetree.export import combine_models, combining, verify_model
from edgetree.export.build import with_manifest
from edgetree.model_file.manifest import Manifest, UsualRange
from edgetree.runtime import ColourAndDepth, SessionSettings

Cli = Callable[..., Any]
ROOT = Path(__file__).parents[3]
BOTH, COLOUR, DEPTH = ROOT / "models/edge-s.onnx", "edge-s-rgb", "edge-s-depth"
SAMPLE = sample_frames()[0]


@pytest.fixture(scope="module")
def combined(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("combined") / "any.onnx"
    made = combine_models(BOTH, COLOUR, DEPTH, out, lambda _: None)
    assert made.frames == len(sample_frames())
    assert made.file_bytes == out.stat().st_size
    return out


def same(found: TreeDetections, wanted: TreeDetections) -> bool:
    assert len(wanted)
    return all(
        np.array_equal(getattr(found, name), getattr(wanted, name))
        for name in ("boxes_px", "scores", "keypoints_px", "keypoint_stds_px", "masks")
    )


def test_each_image_is_given_to_the_model_that_was_trained_for_it(combined: Path) -> None:
    detector = TreeDetector.load(combined)
    image, depth_m = SAMPLE.image(), SAMPLE.depth_m()

    both = detector.detect(image, depth_m)
    colour, depth = detector.detect(image), detector.detect(depth_m=depth_m)

    assert both.alone is None
    assert same(both, TreeDetector.load(BOTH).detect(image, depth_m))
    assert colour.alone is not None
    assert colour.alone.image == "colour"
    assert same(colour, TreeDetector.load(COLOUR).detect(image))
    assert depth.alone is not None
    assert depth.alone.image == "depth"
    assert same(depth, TreeDetector.load(DEPTH).detect(depth_m))


@pytest.mark.parametrize("depth_m", [SAMPLE.depth_m(), STEMS], ids=["ground", "no ground"])
def test_an_image_that_shows_nothing_counts_as_missing(combined: Path, depth_m: Float32) -> None:
    black = np.zeros((*depth_m.shape, 3), np.uint8)

    found = TreeDetector.load(combined).detect(black, depth_m)

    assert same(found, TreeDetector.load(DEPTH).detect(depth_m))
    assert "black" in str(found.alone)


def test_depth_alone_without_ground_is_seen_as_by_the_depth_model(combined: Path) -> None:
    detector, own = TreeDetector.load(combined), TreeDetector.load(DEPTH)

    found = detector.detect(depth_m=STEMS)

    assert same(found, own.detect(STEMS))


def test_errors_are_those_of_the_model_that_ran(combined: Path) -> None:
    detector = TreeDetector.load(combined)
    alone = detector.manifest.alone
    assert {kind: each.name for kind, each in alone.items()} == {"colour": COLOUR, "depth": DEPTH}
    detector.manifest = replace(
        detector.manifest,
        error_factor=0.9,
        alone={
            "colour": replace(alone["colour"], error_factor=0.6),
            "depth": replace(alone["depth"], error_factor=0.5),
        },
    )
    image, depth_m = SAMPLE.image(), SAMPLE.depth_m()

    factors = [
        detector.detect(image, depth_m).error_factor,
        detector.detect(image).error_factor,
        detector.detect(depth_m=depth_m).error_factor,
    ]

    assert factors == [0.9, 0.6, 0.5]


def test_the_reach_is_that_of_the_model_that_ran(combined: Path) -> None:
    detector, image, depth_m = TreeDetector.load(combined), SAMPLE.image(), SAMPLE.depth_m()
    alone = detector.manifest.alone
    near = replace(alone["depth"], reach_m=1.0)
    detector.manifest = replace(detector.manifest, alone={**alone, "depth": near})
    dark = np.zeros_like(image)

    assert len(detector.detect(image, depth_m, SAMPLE.camera))
    assert not len(detector.detect(dark, depth_m, SAMPLE.camera))
    assert len(detector.detect(dark, depth_m))


def test_a_picture_alone_is_unlike_those_of_the_model_that_ran(combined: Path) -> None:
    detector = TreeDetector.load(combined)
    alone = detector.manifest.alone
    odd = replace(alone["colour"], training_pictures=(UsualRange("lightness", 1.0, 2.0),))
    detector.manifest = replace(detector.manifest, alone={**alone, "colour": odd})

    assert detector.detect(SAMPLE.image()).unlike is not None
    assert detector.detect(SAMPLE.image(), SAMPLE.depth_m()).unlike is None


def test_a_profile_counts_the_model_that_ran_and_no_branch_twice(combined: Path) -> None:
    detector = TreeDetector.load(combined)
    pairs = [ColourAndDepth(SAMPLE.image(), SAMPLE.depth_m()), ColourAndDepth(SAMPLE.image(), None)]
    inputs = [detector.inputs_of(detector.prepare(pair)[None]) for pair in pairs]

    both, mixed, own = (
        network_times(path, SessionSettings(threads=1), given)
        for path, given in ((combined, inputs[:1]), (combined, inputs), (BOTH, inputs[:1]))
    )

    assert all(both.parts_ms[part] > 0 for part in PARTS)
    counts = [
        {each.operator: each.nodes for each in times.operators} for times in (both, mixed, own)
    ]
    assert "If" not in counts[0]
    assert counts[0]["QLinearConv"] == counts[2]["QLinearConv"]
    assert counts[1]["QLinearConv"] < counts[0]["QLinearConv"]


def test_all_models_are_warmed_up(combined: Path) -> None:
    detector, shown = TreeDetector.load(combined), []
    run = detector.session.run

    def noting(inputs: Any) -> Any:
        has_colour, has_depth = (inputs["colour"] > 0).any(), (inputs["depth"] < 255).any()
        shown.append((bool(has_colour), bool(has_depth)))
        return run(inputs)

    detector.session.run = noting  # type: ignore[method-assign]
    detector.warm_up(1)
    assert set(shown) == {(True, True), (True, False), (False, True)}


@pytest.mark.parametrize(
    ("files", "message"),
    [
        ((BOTH, "edge-n-rgb", DEPTH), r"colour alone, edge-n-rgb: input size is \(384, 640, 3\)"),
        ((BOTH, COLOUR, "edge-n-depth"), r"depth alone, edge-n-depth: input size is \(384, 640\)"),
        ((BOTH, DEPTH, DEPTH), "edge-s-depth.onnx takes depth: expected one that takes colour"),
        (
            (COLOUR, COLOUR, DEPTH),
            "edge-s-rgb.onnx takes colour: expected one that takes colour and",
        ),
        ((Path("none.onnx"), COLOUR, DEPTH), "model none.onnx does not exist: expected"),
    ],
)
def test_files_that_do_not_fit_are_refused(files: Any, message: str, tmp_path: Path) -> None:
    with pytest.raises(ModelFileError, match=message):
        combine_models(*files, tmp_path / "out.onnx", lambda _: None)
    assert not list(tmp_path.iterdir())


def test_a_combined_file_and_another_name_are_refused(combined: Path, tmp_path: Path) -> None:
    with pytest.raises(ModelFileError, match="is combined already"):
        combine_models(combined, COLOUR, DEPTH, tmp_path / "out.onnx", lambda _: None)
    with pytest.raises(EdgetreeError, match=r"out\.bin: expected a name that ends in"):
        combine_models(BOTH, COLOUR, DEPTH, tmp_path / "out.bin", lambda _: None)


def test_trees_are_chosen_alike_after_the_graph(tmp_path: Path) -> None:
    import onnx

    other = tmp_path / "other.onnx"
    manifest = manifest_of(DEPTH)
    thresholds = replace(manifest.thresholds, mask_overlap=0.5)
    proto = onnx.load(find_model(DEPTH))
    other.write_bytes(with_manifest(proto, replace(manifest, thresholds=thresholds)))
    with pytest.raises(ModelFileError, match=r"has a mask_overlap of 0\.5: expected 0\.8"):
        combine_models(BOTH, COLOUR, other, tmp_path / "out.onnx", lambda _: None)


def test_a_conformance_kit_is_made_of_a_combined_file(combined: Path, tmp_path: Path) -> None:
    make_kit(combined, tmp_path / "kit")
    assert read_kit(tmp_path / "kit").frames


def test_a_file_that_finds_something_else_is_not_written(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The wrong way round, a frame with depth counts as one without."""
    shows = {"colour": ("ReduceMax", "Greater"), "depth": ("ReduceMin", "GreaterOrEqual")}
    monkeypatch.setattr(combining, "_SHOWS", shows)
    with pytest.raises(CheckFailed, match=r"gives other .* than .*edge-s\.onnx in"):
        combine_models(BOTH, COLOUR, DEPTH, tmp_path / "out.onnx", lambda _: None)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("changed", ["lowest score", "opset", "batch"])
def test_the_models_of_a_combined_file_are_alike(combined: Path, changed: str) -> None:
    manifest = TreeDetector.load(combined).manifest
    depth = manifest.alone["depth"]
    values: dict[str, Any] = {
        "lowest score": replace(depth.thresholds, score=0.02),
        "opset": 18,
        "batch": replace(depth.input, batch_sizes=(2,)),
    }
    names = {"lowest score": "thresholds", "batch": "input"}
    other = replace(depth, **{names.get(changed, changed): values[changed]})
    with pytest.raises(ModelFileError, match=f"depth alone, edge-s-depth: {changed}"):
        replace(manifest, alone={**manifest.alone, "depth": other})
    with pytest.raises(ModelFileError, match=r"alone is \('depth',\): expected"):
        replace(manifest, alone={"depth": depth})


def test_the_manifest_of_a_combined_file_is_read_again(combined: Path) -> None:
    manifest = TreeDetector.load(combined).manifest
    assert Manifest.from_json(manifest.to_json()) == manifest
    assert manifest.name == "any"
    assert manifest.shown("depth").weights_sha256 == manifest_of(DEPTH).weights_sha256
    assert manifest.shown(None) is manifest
    assert manifest.shown("neither") is manifest
    whole = (manifest_of(name).parameters for name in (BOTH, COLOUR, DEPTH))
    assert manifest.parameters == sum(whole)


def manifest_of(model: Path | str) -> Manifest:
    return TreeDetector.load(model).manifest


@pytest.mark.parametrize("checkpoint", ["edge-s", "edge-s-depth"])
def test_each_part_is_verified_against_its_checkpoint(
    combined: Path, checkpoint: str, tmp_path: Path, run_cli: Cli
) -> None:
    assert run_cli("samples", "--out", tmp_path / "samples").code == 0
    weights = ROOT / "checkpoints" / f"{checkpoint}.safetensors"
    folder = tmp_path / "samples"
    (folder / "pictures").rename(folder / "images")
    folder = folder / "depth" if checkpoint.endswith("depth") else folder
    report = verify_model(combined, weights, data=folder)
    assert report.manifest.name == ("any" if checkpoint == "edge-s" else checkpoint)
    assert not report.parity.faults()
    assert not any("alone" in frame.name for frame in report.parity.frames)


def test_the_command_says_what_it_made(run_cli: Cli, tmp_path: Path) -> None:
    out = tmp_path / "made.onnx"
    done = run_cli("combine", BOTH, "--colour", COLOUR, "--depth", DEPTH, "--out", out)
    assert done.code == 0
    assert "made.onnx (15.0 MB) finds what the three files find, on 6 frames" in done.out
    itself = run_cli("combine", out, "--colour", COLOUR, "--depth", DEPTH, "--out", out)
    assert itself.code == 2
    assert "--out is" in itself.err
    other = tmp_path / "other.onnx"
    refused = run_cli("combine", BOTH, "--colour", COLOUR, "--depth", COLOUR, "--out", other)
    assert refused.code == 2
    assert "edge-s-rgb.onnx takes colour: expected one that takes depth" in refused.err
