"""Kits and results from strangers: nothing outside of the kit is read, sizes are bounded."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import pytest

from basetree.errors import InputError
from edgetree.catalogue import default_model
from edgetree.conformance import compare_results, read_kit, read_results, run_kit
from edgetree.conformance.kit import KIT_SCHEMA, read_expected, read_frame
from edgetree.conformance.results import RESULTS_SCHEMA

FRAME = {"name": "a", "file": "frames/a.raw", "width": 64, "height": 48, "channels": 1}
TREE = {"score": 0.9, "box_px": [1, 2, 30, 40]}


def kit_with(folder: Path, *frames: dict[str, Any], **changes: Any) -> Path:
    """A kit with a frame of zeros, or with other frames."""
    (folder / "frames").mkdir(exist_ok=True)
    (folder / "frames/a.raw").write_bytes(bytes(64 * 48 * 2))
    content = {
        "schema": KIT_SCHEMA,
        **dict.fromkeys(("model", "model_sha256", "name", "precision", "project_version"), "x"),
        "input_width": 64,
        "input_height": 32,
        "score_threshold": 0.15,
        "frames": frames or [FRAME],
        **changes,
    }
    (folder / "kit.json").write_text(json.dumps(content))
    return folder


def results_with(path: Path, **frame: Any) -> Path:
    """A file with the trees of one frame."""
    texts = dict.fromkeys(("model_sha256", "runtime", "runtime_version", "processor"), "x")
    frames = [{"name": "a", "trees": [TREE], **frame}]
    path.write_text(json.dumps({"schema": RESULTS_SCHEMA, **texts, "frames": frames}))
    return path


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"file": "/dev/zero"}, "frame 'a': file is '/dev/zero', expected a path inside the kit"),
        ({"file": "../../../etc/hostname"}, "expected a path inside the kit"),
        ({"file": "frames/../../x"}, "expected a path inside the kit"),
        ({"file": ""}, "file is '', expected a path inside the kit"),
        ({"file": 5}, r"frames\[0\].file is 5, expected text"),
        ({"width": 0}, r"frames\[0\].width is 0, expected a whole number of at least 1"),
        ({"width": 10**12}, r"width is 1000000000000, expected a whole number of at most 65535"),
        ({"width": 65_535, "height": 65_535}, "expected at most 200000000 pixels"),
        ({"channels": 4}, r"64x48 with 4 channels"),
        ({"channels": 3, "depth_file": "../x"}, "depth_file is '../x', expected a path inside"),
        ({"depth_file": "frames/a.raw"}, "has a depth_file and 1 channel, expected 3"),
    ],
)
def test_a_frame_that_no_kit_has_is_refused(
    tmp_path: Path, changes: dict[str, Any], message: str
) -> None:
    kit = kit_with(tmp_path, FRAME | changes)
    with pytest.raises(InputError, match=message) as raised:
        read_kit(kit)
    assert str(raised.value).startswith(str(kit / "kit.json"))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"model": "../model.onnx"}, "model is '../model.onnx', expected a path inside the kit"),
        ({"score_threshold": 2}, "score_threshold is 2, expected a number of at most 1"),
        ({"input_width": 0}, "input_width is 0, expected"),
        ({"frames": [FRAME, FRAME]}, "a is given twice"),
        ({"frames": [FRAME] * 51}, "frames is a list of 51 items, expected a list of at most"),
    ],
)
def test_a_kit_that_no_command_makes_is_refused(
    tmp_path: Path, changes: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        read_kit(kit_with(tmp_path, **changes))


@pytest.mark.parametrize("target", ["/dev/zero", "."])
def test_a_frame_that_is_no_regular_file_is_not_read(tmp_path: Path, target: str) -> None:
    kit = kit_with(tmp_path)
    (kit / "frames/a.raw").unlink()
    (kit / "frames/a.raw").symlink_to(target)
    with pytest.raises(InputError, match=r"a\.raw is not a regular file: expected pixels"):
        read_frame(kit, read_kit(kit).frames[0])


def test_a_frame_with_a_large_file_is_not_read(tmp_path: Path) -> None:
    kit = kit_with(tmp_path)
    with (kit / "frames/a.raw").open("wb") as stream:
        stream.truncate(2**40)
    with pytest.raises(InputError, match=r"a\.raw has 1099511627776 bytes: expected 6144"):
        read_frame(kit, read_kit(kit).frames[0])


def test_the_frames_of_a_kit_are_read_one_after_another(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    frames = [FRAME | {"name": f"{number}"} for number in range(3)]
    model = default_model("depth").read_bytes()
    kit = kit_with(tmp_path, *frames, model_sha256=hashlib.sha256(model).hexdigest())
    (kit / "x").write_bytes(model)
    read: list[str] = []

    def reading(folder: Path, frame: Any) -> Any:
        read.append(frame.name)
        return read_frame(folder, frame)

    monkeypatch.setattr("edgetree.conformance.kit.read_frame", reading)
    found = run_kit(kit, rounds=2)
    assert read == ["0", "1", "2"] * 3
    assert found.median_ms is not None


@pytest.mark.parametrize(
    ("frame", "message"),
    [
        ({"trees": [TREE] * 201}, r"frames\[0\].trees is a list of 201 items, expected"),
        ({"trees": [TREE | {"box_px": [0, 0, 1e300, 1]}]}, r"trees\[0\].box_px\[2\] is 1e\+300"),
        ({"trees": [TREE | {"score": None}]}, r"trees\[0\].score is null, expected a number"),
        ({"trees": [TREE | {"mask": [0.5]}]}, "mask has 1 values: expected 784"),
        ({"covered": [{"by": -1, "tree": TREE}]}, r"covered\[0\].by is -1, expected a whole numb"),
        ({"name": 3}, r"frames\[0\].name is 3, expected text"),
    ],
)
def test_results_that_no_program_finds_are_refused(
    tmp_path: Path, frame: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        read_results(results_with(tmp_path / "results.json", **frame))


def test_a_kit_whose_tree_is_covered_by_none_is_refused(tmp_path: Path) -> None:
    kit = kit_with(tmp_path)
    results_with(kit / "expected.json", covered=[{"by": 1, "tree": TREE}])
    with pytest.raises(InputError, match=r"expected.json: frame 'a' has a tree that tree 1 covers"):
        read_expected(kit)


def test_the_largest_results_are_compared(tmp_path: Path) -> None:
    trees = [TREE | {"box_px": [x, 0, x + 50, 90]} for x in range(200)]
    frames = [FRAME | {"name": f"{number}"} for number in range(5)]
    kit = kit_with(tmp_path, *frames)
    for name in ("expected.json", "found.json"):
        content = json.loads(results_with(kit / name).read_text())
        content["frames"] = [{"name": each["name"], "trees": trees} for each in frames]
        (kit / name).write_text(json.dumps(content))
    comparison = compare_results(kit, read_results(kit / "found.json"))
    assert (comparison.trees, comparison.unmatched) == (1000, 0)
