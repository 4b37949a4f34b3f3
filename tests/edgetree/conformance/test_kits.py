"""A kit tells programs that find the same trees from those that do not."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from both_model import write_both_model
from numpy.typing import NDArray

import calib
from basetree.errors import InputError
from edgetree.catalogue import default_model
from edgetree.conformance import (
    Results,
    compare_results,
    make_kit,
    read_kit,
    read_results,
    run_kit,
    tolerance_for,
)
from edgetree.conformance.kit import read_expected, read_frame
from edgetree.conformance.pairing import Pairing
from edgetree.conformance.results import CoveredTree, FoundTree, FrameTrees
from edgetree.runtime import TreeDetector, detector

Change = Callable[[list[dict[str, Any]]], object]


@pytest.fixture(scope="module")
def kits(kit_of: Callable[[str], Path]) -> dict[str, Path]:
    """Kits of the packaged models."""
    return {modality: kit_of(f"edge-n-{modality}") for modality in ("rgb", "depth")}


@pytest.mark.parametrize("modality", ["rgb", "depth"])
def test_a_kit_has_all_that_a_program_needs(kits: dict[str, Path], modality: str) -> None:
    folder = kits[modality]
    kit, expected = read_kit(folder), read_expected(folder)
    model = default_model(f"edge-n-{modality}").read_bytes()
    assert (folder / kit.model).read_bytes() == model
    assert kit.model_sha256 == hashlib.sha256(model).hexdigest() == expected.model_sha256
    itemsize = {"rgb": 3, "depth": 2}[modality]
    for frame in kit.frames:
        size = (folder / frame.file).stat().st_size
        assert size == frame.width * frame.height * itemsize
    assert len({(frame.width, frame.height) for frame in kit.frames}) >= 5
    assert [frame.name for frame in kit.frames] == [frame.name for frame in expected.frames]
    trees = {frame.name: len(frame.trees) for frame in expected.frames}
    assert min(trees[frame.name] for frame in kit.frames if frame.name != "blank") >= 1


def test_a_kit_of_the_package_has_a_tree_that_a_better_one_covers(kits: dict[str, Path]) -> None:
    assert read_expected(kits["rgb"]).covered >= 1


def test_the_frames_are_those_of_the_package(kits: dict[str, Path]) -> None:
    from edgetree import sample_frames

    sample = sample_frames()[0]
    frame = read_kit(kits["rgb"]).frames[0]
    np.testing.assert_array_equal(read_frame(kits["rgb"], frame), sample.image())
    depth = read_frame(kits["depth"], read_kit(kits["depth"]).frames[0])
    np.testing.assert_array_equal(depth / np.float32(1000), sample.depth_m())


@pytest.mark.parametrize("modality", ["rgb", "depth"])
def test_the_same_program_passes(kits: dict[str, Path], modality: str) -> None:
    found = run_kit(kits[modality], threads=1)
    comparison = compare_results(kits[modality], found)
    assert comparison.problems == ()
    assert comparison.passed
    assert comparison.unmatched == 0
    assert max(each.largest for each in comparison.quantities) < 1e-3
    assert found.median_ms is None


def test_a_kit_of_colour_and_depth_holds_both_or_either(tmp_path: Path) -> None:
    write_both_model(tmp_path / "both.onnx")
    kit, _ = make_kit(tmp_path / "both.onnx", tmp_path / "kit")
    frames = {frame.name: frame for frame in kit.frames}
    for name, images in {"wide": 2, "odd": 1, "small": 1, "blank": 1}.items():
        pixels = read_frame(tmp_path / "kit", frames[name])
        assert (len(pixels) if isinstance(pixels, tuple) else 1) == images
    colour, depth = read_frame(tmp_path / "kit", frames["wide"])
    assert colour.shape == (*depth.shape, 3)
    assert (frames["odd"].channels, frames["small"].channels) == (3, 1)
    assert compare_results(tmp_path / "kit", run_kit(tmp_path / "kit", threads=1)).passed
    (tmp_path / "kit" / str(frames["wide"].depth_file)).write_bytes(bytes(10))
    with pytest.raises(InputError, match=r"wide.depth.raw has 10 bytes: expected 1075200"):
        run_kit(tmp_path / "kit")


def test_a_kit_of_depth_shows_trees_beyond_reach(kits: dict[str, Path]) -> None:
    frames = {frame.name: frame for frame in read_kit(kits["depth"]).frames}
    beyond = frames["beyond_reach"]
    assert beyond.pinhole is not None
    assert (beyond.pinhole.width, beyond.pinhole.cx) == (980, 339.5)
    assert beyond.pinhole.distortion == ()
    pixels = read_frame(kits["depth"], beyond)
    everything = TreeDetector.load(default_model("depth"), score_threshold=0.15).detect(
        pixels / np.float32(1000)
    )
    kept = next(f for f in read_expected(kits["depth"]).frames if f.name == "beyond_reach")
    assert len(everything) == len(kept.trees) + 1
    assert [frame.camera for frame in read_kit(kits["rgb"]).frames] == [None] * 11


def test_times_are_measured_if_asked_for(kits: dict[str, Path]) -> None:
    found = run_kit(kits["depth"], threads=1, rounds=1)
    assert found.median_ms is not None
    assert found.median_ms > 0


def swap_colours(box: calib.Letterbox, image: Any, pad: int) -> Any:
    return _apply(box, image[:, :, ::-1], pad)


def stretch(box: calib.Letterbox, image: Any, pad: int) -> Any:
    whole = dataclasses.replace(box, resized_width=box.width, resized_height=box.height)
    return _apply(whole, image, pad)


def pad_otherwise(box: calib.Letterbox, image: Any, pad: int) -> Any:
    return _apply(box, image, 255 - pad if pad > 200 else 255)


_apply = calib.Letterbox.apply
_distinct_trees = detector.distinct_trees


def keep_no_overlapping(
    boxes_px: np.ndarray, masks: np.ndarray, max_overlap: float
) -> NDArray[np.bool_]:
    return _distinct_trees(boxes_px, masks, 0.0)


@pytest.mark.parametrize(
    ("modality", "owner", "name", "wrong"),
    [
        ("rgb", calib.Letterbox, "apply", swap_colours),
        ("rgb", calib.Letterbox, "apply", stretch),
        ("depth", calib.Letterbox, "apply", pad_otherwise),
        ("rgb", calib.Letterbox, "to_source", lambda box, xy: np.asarray(xy, np.float64)),
        ("rgb", detector, "distinct_trees", keep_no_overlapping),
        ("depth", detector, "distinct_trees", keep_no_overlapping),
        ("depth", detector, "within_reach", lambda trees, *_: trees),
    ],
)
def test_a_wrong_program_fails(
    monkeypatch: pytest.MonkeyPatch,
    kits: dict[str, Path],
    modality: str,
    owner: Any,
    name: str,
    wrong: Any,
) -> None:
    monkeypatch.setattr(owner, name, wrong)
    found = run_kit(kits[modality])
    monkeypatch.undo()
    for runtime in (found.runtime, "openvino"):
        assert not compare_results(
            kits[modality], dataclasses.replace(found, runtime=runtime)
        ).passed


def changed(folder: Path, change: Change) -> Results:
    """What the kit expects, with a change to the list of frames."""
    data = json.loads((folder / "expected.json").read_text("utf-8"))
    change(data["frames"])
    with tempfile.TemporaryDirectory() as other:
        path = Path(other) / "changed.json"
        path.write_text(json.dumps(data), "utf-8")
        return read_results(path)


def for_all(change: Callable[[dict[str, Any]], object]) -> Change:
    return lambda frames: [change(tree) for frame in frames for tree in frame["trees"]]


@pytest.mark.parametrize(
    ("change", "line"),
    [
        (lambda frames: frames.pop(), "frame blank: no result"),
        (lambda frames: frames.append(frames[0]), "frame sample_0: twice"),
        (lambda frames: frames[0].update(name="other"), "frame other: not in the kit"),
        (
            lambda frames: [frame["trees"].clear() for frame in frames],
            "sample_0: tree 1 is missing",
        ),
        (
            lambda frames: [
                frame["trees"].insert(0, {**frame["trees"][0], "box_px": [0, 0, 5, 5]})
                for frame in frames
                if frame["trees"]
            ],
            "sample_0: a tree too many (score",
        ),
        (lambda frames: frames[0]["trees"].reverse(), "sample_0: the trees are not sorted"),
        (
            lambda frames: frames[0]["trees"][-1].update(score=0.05),
            "sample_0: a tree with score 0.050: expected none below the threshold 0.15",
        ),
        (
            for_all(lambda tree: tree.update(box_px=[value + 9 for value in tree["box_px"]])),
            "sample_0: tree 1: box differs by 4.5 px: expected at most",
        ),
        (
            for_all(lambda tree: tree["keypoints_px"][2].__setitem__(0, 0.0)),
            "sample_0: tree 1: keypoint 3 differs by",
        ),
        (
            for_all(lambda tree: tree.update(score=1.0)),
            "score differs by",
        ),
        (
            for_all(lambda tree: tree.update(mask=[1 - value for value in tree["mask"]])),
            "sample_0: tree 1: mask (mean of the probabilities) differs by",
        ),
        (for_all(lambda tree: tree.pop("mask")), "sample_0: tree 1: no mask: expected it"),
    ],
)
def test_wrong_results_fail_with_a_plain_line(
    kits: dict[str, Path], change: Change, line: str
) -> None:
    comparison = compare_results(kits["rgb"], changed(kits["rgb"], change))
    assert not comparison.passed
    assert any(line in problem for problem in comparison.problems), comparison.problems[:5]


def test_small_differences_pass(kits: dict[str, Path]) -> None:
    def shift(tree: dict[str, Any]) -> None:
        tree["box_px"] = [value + 0.1 for value in tree["box_px"]]

    comparison = compare_results(kits["rgb"], changed(kits["rgb"], for_all(shift)))
    assert comparison.passed
    box = next(each for each in comparison.quantities if each.name == "box")
    assert box.largest == pytest.approx(0.1 * 384 / 260, rel=0.05)


def tree(score: float, left: float) -> FoundTree:
    return FoundTree(score, (left, 0.0, left + 10, 100.0), None, (1.0,) * 784)


def unmatched(wanted: FrameTrees, *found: FoundTree) -> list[str]:
    return list(Pairing(wanted, found, 0.3, 0.05).unmatched())


def test_either_of_two_trees_that_cover_each_other_may_be_found() -> None:
    wanted = FrameTrees("a", (tree(0.9, 0), tree(0.8, 50)), (CoveredTree(0, tree(0.88, 3)),))
    assert unmatched(wanted, tree(0.9, 0), tree(0.8, 50)) == []
    assert unmatched(wanted, tree(0.89, 3), tree(0.8, 50)) == []
    both = unmatched(wanted, tree(0.9, 0), tree(0.88, 3), tree(0.8, 50))
    assert len(both) == 1
    assert "a better tree cover each other" in both[0]
    clear = FrameTrees("a", (tree(0.9, 0),), (CoveredTree(0, tree(0.6, 3)),))
    assert len(unmatched(clear, tree(0.6, 3))) == 2


def test_trees_near_the_threshold_need_not_be_found() -> None:
    wanted = FrameTrees("a", (tree(0.33, 0),))
    assert unmatched(wanted) == []
    assert unmatched(FrameTrees("a", ()), tree(0.34, 0)) == []
    assert unmatched(FrameTrees("a", (tree(0.36, 0),))) == [
        "a: tree 1 is missing (score 0.36, box 0, 0, 10, 100)"
    ]


def test_the_tolerance_grows_with_what_differs(kits: dict[str, Path]) -> None:
    ours = read_expected(kits["rgb"])
    arm = dataclasses.replace(ours, processor="arm64")
    other = dataclasses.replace(ours, runtime="openvino")
    exact = tolerance_for("float32", ours, other)
    boxes = [tolerance_for("int8", ours, theirs).box_px for theirs in (ours, arm, other)]
    assert exact.trees == 0
    assert [exact.box_px, *boxes] == sorted({exact.box_px, *boxes})


def test_results_of_another_model_are_refused(kits: dict[str, Path]) -> None:
    with pytest.raises(InputError, match="the results are of the model"):
        compare_results(kits["rgb"], read_expected(kits["depth"]))


def test_a_kit_that_lacks_a_frame_is_refused(kits: dict[str, Path], tmp_path: Path) -> None:
    kit = tmp_path / "kit"
    kit.mkdir()
    data = json.loads((kits["rgb"] / "kit.json").read_text("utf-8"))
    data["frames"].pop()
    (kit / "kit.json").write_text(json.dumps(data), "utf-8")
    (kit / "expected.json").write_bytes((kits["rgb"] / "expected.json").read_bytes())
    with pytest.raises(InputError, match="have different frames"):
        compare_results(kit, read_expected(kits["rgb"]))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "cannot be read"),
        ("[]", "has the schema 'list'"),
        ('{"schema": "edgetree.conformance-results/1"}', "has no field 'model_sha256'"),
    ],
)
def test_a_broken_file_is_named(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "results.json"
    path.write_text(text, "utf-8")
    with pytest.raises(InputError, match=message) as raised:
        read_results(path)
    assert str(path) in str(raised.value)


def test_a_mask_of_another_size_is_named(kits: dict[str, Path]) -> None:
    with pytest.raises(InputError, match=r"changed.json.*mask has 3 values: expected 784"):
        changed(kits["rgb"], for_all(lambda found: found.update(mask=[0.0, 1.0, 0.0])))


def test_a_cut_frame_is_named(kits: dict[str, Path], tmp_path: Path) -> None:
    frame = read_kit(kits["depth"]).frames[0]
    (tmp_path / "frames").mkdir()
    (tmp_path / frame.file).write_bytes(b"123")
    with pytest.raises(InputError, match=r"sample_0.raw has 3 bytes: expected 1843200"):
        read_frame(tmp_path, frame)


def test_a_model_that_the_kit_was_not_made_of_is_not_run(
    kits: dict[str, Path], tmp_path: Path
) -> None:
    folder = shutil.copytree(kits["depth"], tmp_path / "kit")
    shutil.copy(default_model("edge-s-depth"), folder / "model.onnx")
    with pytest.raises(InputError, match=r"onnx has the SHA-256 .*, and kit\.json says"):
        run_kit(folder, threads=1)


def test_a_folder_of_other_things_is_not_replaced(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine", "utf-8")
    with pytest.raises(InputError, match="is not empty and not a kit"):
        make_kit(default_model("rgb"), tmp_path)
    assert (tmp_path / "notes.txt").read_text("utf-8") == "mine"


@pytest.mark.parametrize("content", ['{"parts": []}', '{"schema": "ours.kit/3"}', "kit"])
def test_a_folder_with_a_kit_of_another_program_is_not_replaced(
    content: str, tmp_path: Path
) -> None:
    (tmp_path / "kit.json").write_text(content, "utf-8")
    with pytest.raises(InputError, match="is not empty and not a kit"):
        make_kit(default_model("rgb"), tmp_path)
    assert (tmp_path / "kit.json").read_text("utf-8") == content
