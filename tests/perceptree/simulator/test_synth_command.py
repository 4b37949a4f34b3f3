"""``perceptree synth`` and ``scene``: options, output and exit codes."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import pytest

import calib
from perceptree.simulator.dataset import frozen
from perceptree.simulator.dataset.frozen import describe_dataset
from perceptree.simulator.settings import presets

Result = tuple[int, str, str]
Call = Callable[..., Result]
SMALL = ("--width", 128, "--height", 72, "--views", 2)


@pytest.fixture
def call(in_process: None, call: Call) -> Call:
    """Run ``perceptree ARGUMENTS`` with fake frames."""
    return call


@pytest.fixture
def small_test_preset(synth: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    """A test preset of eight small frames."""
    preset = presets.PRESETS["test"]
    settings = replace(synth.small_settings(), splits=preset.settings.splits)
    small = replace(preset, settings=settings, frames=8)
    monkeypatch.setitem(presets.PRESETS, "test", small)


def settings_of(out: Path) -> dict:
    return json.loads((out / "settings.json").read_text())


def test_it_says_what_was_made_where_to_look_and_what_to_type_next(call: Call, tmp_path: Path):
    out = tmp_path / "forest"
    code, printed, told = call("synth", "--out", out, "--frames", 8, *SMALL)
    assert (code, told) == (0, "")
    lines = printed.splitlines()
    assert lines[:3] == [
        "train: 4 frames, 6 trees",
        "val: 2 frames, 3 trees",
        "test: 2 frames, 3 trees",
    ]
    assert lines[3:8] == [
        "frames by weather: clear 2, snow 2, wet 2, fog 2",
        "frames by light: morning 2, daylight 2, evening 2, dusk 2",
        "frames by ground: litter 2, moss 2, roots 2, mud 2",
        "frames by carrier: mast 8",
        "frames by depth sensor: tof 8",
    ]
    assert f"{out}/contact_sheet.jpg" in printed
    assert f"{out}/statistics.html" in printed
    assert lines[-1] == f"next: perceptree train {out} --out runs/depth --modality depth"


def test_after_a_set_without_training_frames_comes_an_evaluation(call: Call, tmp_path: Path):
    file, out = tmp_path / "all_test.json", tmp_path / "out"
    file.write_text('{"splits": {"val": 0, "test": 1}}')
    code, printed, _ = call("synth", "--out", out, "--frames", 4, *SMALL, "--settings", file)
    assert code == 0
    assert printed.splitlines()[-1] == f"next: edgetree eval depth {out}"


def test_json_is_one_object(call: Call, tmp_path: Path):
    code, printed, told = call("synth", "--out", tmp_path, "--frames", 8, *SMALL, "--json")
    assert (code, told) == (0, "")
    assert json.loads(printed) == {
        "schema": "perceptree.synth/1",
        "directory": str(tmp_path),
        "frames": {"train": 4, "val": 2, "test": 2},
        "trees": {"train": 6, "val": 3, "test": 3},
        "conditions": {
            "weather": {"clear": 2, "snow": 2, "wet": 2, "fog": 2},
            "light": {"morning": 2, "daylight": 2, "evening": 2, "dusk": 2},
            "ground": {"litter": 2, "moss": 2, "roots": 2, "mud": 2},
            "carrier": {"mast": 8},
            "depth sensor": {"tof": 8},
        },
    }


def test_a_settings_file_changes_what_it_names_and_a_wrong_one_is_named(call: Call, tmp_path: Path):
    file, out = tmp_path / "forest.json", tmp_path / "out"
    file.write_text('{"stand": {"stems_per_ha": [400, 500]}, "weather": {"kinds": {"fog": 1}}}')
    assert call("synth", "--out", out, "--frames", 8, *SMALL, "--settings", file)[0] == 0
    made = settings_of(out)["settings"]
    assert made["stand"]["stems_per_ha"] == [400, 500]
    assert made["weather"]["kinds"] == {"fog": 1}
    assert made["camera"]["intrinsics"]["width"] == 128
    file.write_text('{"stand": {"stems_per_ha": [1, 2]}}')
    code, _, told = call("synth", "--out", out, "--frames", 8, *SMALL, "--settings", file)
    assert code == 2
    assert told == (
        f"perceptree: {file}: stems_per_ha is (1, 2): expected low <= high, both in [10, 5000]\n"
    )


def test_a_camera_file_and_a_reach_are_taken_over(call: Call, tmp_path: Path):
    camera = calib.PinholeCamera(128, 72, 80.0, 81.0, 60.0, 30.0, (0.1, -0.02, 0.0, 0.0))
    calib.save_camera(tmp_path / "camera.json", camera)
    options = ("--camera", tmp_path / "camera.json", "--reach", 6.5, "--views", 2)
    code, _, _ = call("synth", "--out", tmp_path / "out", "--frames", 6, *options)
    assert code == 0
    settings = settings_of(tmp_path / "out")["settings"]
    assert settings["camera"]["intrinsics"]["fy"] == 81.0
    assert settings["labels"]["reach_m"] == 6.5
    images = json.loads((tmp_path / "out/train_RGB.json").read_text())["images"]
    assert images[0]["camera"] == camera.to_dict()


@pytest.mark.parametrize(("focal_px", "code"), [(286.0, 2), (450.0, 0)])
def test_a_fisheye_that_no_pinhole_can_draw_is_refused(
    call: Call, tmp_path: Path, focal_px: float, code: int
):
    terms = (-0.006, 0.04, -0.04, 0.007)
    lens = (424.0, 400.0, terms, "fisheye")
    calib.save_camera(
        tmp_path / "wide.json", calib.PinholeCamera(848, 800, focal_px, focal_px, *lens)
    )
    options = ("--camera", tmp_path / "wide.json", "--views", 1, "--frames", 3)
    done, _, told = call("synth", "--out", tmp_path / "out", *options)
    assert done == code
    assert ("the camera sees 89 degrees or more off its axis in a corner" in told) == bool(code)


def test_the_camera_of_a_settings_file_is_scaled_and_not_replaced(call: Call, tmp_path: Path):
    camera = calib.PinholeCamera(256, 144, 160.0, 162.0, 120.0, 60.0, (0.1, -0.02, 0.0, 0.0))
    file = tmp_path / "own.json"
    file.write_text(json.dumps({"camera": {"intrinsics": camera.to_dict()}}))
    code, _, _ = call(
        "synth", "--out", tmp_path / "out", "--frames", 12, *SMALL, "--settings", file
    )
    assert code == 0
    made = settings_of(tmp_path / "out")["settings"]["camera"]["intrinsics"]
    assert made == camera.scaled(128, 72).to_dict()
    square = ("--width", 128, "--height", 128, "--settings", file)
    code, _, told = call("synth", "--out", tmp_path / "other", "--frames", 12, *square)
    assert code == 2
    assert "expected the same aspect ratio" in told


def test_images_are_png_where_that_is_asked_for(call: Call, tmp_path: Path):
    code, _, _ = call("synth", "--out", tmp_path, "--frames", 6, *SMALL, "--image-format", "png")
    assert code == 0
    assert settings_of(tmp_path)["files"] == {"image_format": "png"}
    assert (tmp_path / "images/000000.png").is_file()


def test_a_preset_brings_its_seed_and_settings(call: Call, tmp_path: Path):
    code, _, _ = call("synth", "--out", tmp_path, "--preset", "plain", "--frames", 6, *SMALL)
    assert code == 0
    kept = settings_of(tmp_path)
    assert kept["seed"] == presets.PRESETS["plain"].seed
    assert kept["settings"]["weather"]["kinds"] == {"clear": 1.0}
    assert kept["settings"]["camera"]["intrinsics"]["width"] == 128


def test_the_test_preset_is_held_against_the_frozen_set(
    call: Call, tmp_path: Path, small_test_preset: None, monkeypatch
):
    monkeypatch.setattr(frozen, "read_frozen", lambda name: describe_dataset(tmp_path, name))
    code, printed, _ = call("synth", "--out", tmp_path, "--preset", "test")
    assert code == 0
    assert "all 33 files are equal to the frozen test set" in printed
    same = describe_dataset(tmp_path, "test")
    other = replace(same, content_sha256="0", files={**same.files, "images": "0" * 64})
    monkeypatch.setattr(frozen, "read_frozen", lambda name: other)
    code, printed, _ = call("synth", "--out", tmp_path, "--preset", "test")
    assert code == 0
    assert "8 of 33 files differ from the frozen test set: other library versions" in printed
    assert "its labels are the same within 1 %" in printed


def test_labels_that_differ_from_the_frozen_ones_exit_with_one(
    call: Call, tmp_path: Path, small_test_preset: None, monkeypatch
):
    call("synth", "--out", tmp_path, "--preset", "test")
    kept = describe_dataset(tmp_path, "test")
    files = {**kept.files, "test_RGB.json": "0" * 8}
    other = replace(kept, content_sha256="0", files=files, trees_per_frame=3.8)
    monkeypatch.setattr(frozen, "read_frozen", lambda name: other)
    code, printed, told = call("synth", "--out", tmp_path, "--preset", "test", "--json")
    assert (code, told) == (1, "")
    assert json.loads(printed)["frozen"]["complaints"] == ["1.500 trees a frame, expected 3.800"]
    code, printed, _ = call("synth", "--out", tmp_path, "--preset", "test")
    assert code == 1
    assert "its labels differ: 1.500 trees a frame, expected 3.800" in printed


MISTAKES = {
    "preset": (("--preset", "x"), "--preset is 'x': expected one of paper (the paper's mix"),
    "frozen": (("--preset", "test", "--frames", 20), "--preset test is frozen: expected no option"),
    "format": (("--image-format", "bmp"), "image_format is 'bmp': expected one of jpg, png"),
    "reach": (("--reach", 15), "reach_m is 15: expected 1 to 13"),
    "views": (("--views", 0), "views_per_scene is 0: expected 1 to 1000"),
    "width": (("--width", 33), "camera width is 33: expected an even number >= 64"),
    "workers": (("--workers", 0), "workers is 0: expected 1 to 1024"),
    "seed": (("--seed", -2), "seed is -2: expected 0 to 999999"),
    "camera": (("--camera", "none.json"), "none.json: no such file, expected a camera file"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_one_line_and_exit_code_two(call: Call, tmp_path: Path, mistake: str):
    arguments, expected = MISTAKES[mistake]
    code, printed, told = call("synth", "--out", tmp_path / "out", *arguments)
    assert (code, printed) == (2, "")
    assert told.count("\n") == 1
    assert expected in told
    assert not (tmp_path / "out").exists()


SCENE_MISTAKES = {
    "ending": (("--out", "scene.obj"), "--out is scene.obj: expected a name ending in .glb"),
    "seed": (("--out", "scene.glb", "--seed", -1), "--seed is -1: expected at least 0"),
    "preset": (("--out", "scene.glb", "--preset", "x"), "--preset is 'x'"),
}


@pytest.mark.parametrize("mistake", SCENE_MISTAKES)
def test_a_mistake_with_a_scene_is_one_line(call: Call, mistake: str):
    arguments, expected = SCENE_MISTAKES[mistake]
    code, printed, told = call("scene", *arguments)
    assert (code, printed) == (2, "")
    assert told.count("\n") == 1
    assert expected in told


def test_without_a_preset_the_frames_are_of_the_field(call: Call, tmp_path: Path):
    code, _, _ = call("synth", "--out", tmp_path / "own", "--frames", 8, *SMALL)
    assert code == 0
    kept = settings_of(tmp_path / "own")
    field = json.loads(json.dumps(presets.PRESETS["field"].settings.to_dict()))
    for group in ("clutter", "objects", "weather", "stand", "imaging", "trap", "negatives"):
        assert kept["settings"][group] == field[group]
    assert (kept["seed"], kept["settings"]["splits"]) == (0, {"val": 0.1, "test": 0.1})
