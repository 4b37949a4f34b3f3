"""Camera files that are made to hang, to fill memory or to raise errors of other libraries."""

import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from basetree.errors import InputError, InputFileError
from basetree.files.limits import Limits, current_limits, set_limits
from calib import load_camera, load_transform

ROS = """\
image_width: 640
image_height: 480
camera_matrix: {rows: 3, cols: 3, data: [526.69, 0, 312.33, 0, 525.75, 246.22, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [0, 0, 0, 0, 0]}
"""
OLD_REALSENSE = "width: 1, height: 1, ppx: 1, ppy: 1, fx: 1, fy: 1, model: a, coeffs: ["


def aliases(form: str, levels: int = 9) -> str:
    """YAML whose every level holds the level before nine times."""
    lines = ["a0: &a0 {x: 1, y: 2}"]
    for level in range(1, levels):
        nine = ", ".join([f"*a{level - 1}"] * 9)
        keys = ", ".join(f"k{key}: *a{level - 1}" for key in range(9))
        lines.append(f"a{level}: &a{level} {form.format(nine=nine, keys=keys)}")
    return "\n".join(lines) + "\n"


@pytest.fixture(autouse=True)
def _default_limits() -> Iterator[None]:
    before = current_limits()
    yield
    set_limits(before)


HOSTILE = {
    "spaces for the RealSense pattern": ("[ 1x1 p[1 1] f[1 1] " + " " * 3000, "not JSON"),
    "no end for the old RealSense pattern": (OLD_REALSENSE * 4000, "not YAML"),
    "aliases in lists": (aliases("[{nine}]"), "with aliases written out"),
    "aliases in maps": (aliases("{{{keys}}}"), "with aliases written out"),
    "aliases in merged maps": (aliases("{{<<: [{nine}]}}"), "with aliases written out"),
    "aliases of a long text": (
        f"a: &a {'x' * 5000}\nb: [{', '.join(['*a'] * 500)}]\n",
        "characters, with aliases written out",
    ),
    "aliases in several documents": (
        "---\n".join([aliases("[{nine}]", 5)] * 8),
        "with aliases written out",
    ),
    "a list in itself": ("a: &a [*a]\n", "an alias refers to a value that it is in"),
    "a map in itself": ("a: &a {b: {c: *a}}\n", "an alias refers to a value that it is in"),
    "a map merged with itself": ("a: &a {<<: *a}\n", "an alias refers to a value that it is in"),
    "deep YAML": ("a: " + "[" * 3000 + "]" * 3000, "nested more than 50 levels"),
    "deep JSON": ("[" * 60 + "]" * 60, "nested more than 50 levels"),
    "deeper JSON": ('{"a":' * 100_000, "not JSON"),
    "deep XML": ("<a>" * 100_000, "nested more than 50 levels"),
    "XML entities": ('<!DOCTYPE a [<!ENTITY b "c">]><a>&b;</a>', "it has a document type"),
    "a number to the base of 60": ("a: " + ":".join(["1"] * 20_000), "a number of 39999"),
    "a number with more digits than Python prints": (
        ROS.replace("640", "0x" + "f" * 9000),
        "a number of 9002 characters",
    ),
    "empty lines in OpenCV's old YAML": ("%YAML:1.0\n" + "\n" * 30_000, "no known camera format"),
    "a repeated key among many": (
        "{" + ",".join(f'"{key}":0' for key in range(40_000)) + ',"39999":1}',
        "39999 is given twice",
    ),
    "defaults in many sections": (
        "[DEFAULT]\n"
        + "".join(f"k{key}=1\n" for key in range(2000))
        + "".join(f"[s{section}]\n" for section in range(20_000)),
        "no known camera format",
    ),
    "many streams": (
        "".join(f"[ 1x1  p[{x} 1]  f[1 1]  None [0 0 0 0 0] ]\n" for x in range(5000)),
        "holds 5000 cameras",
    ),
    "an empty float": (ROS.replace("[0, 0, 0", '[!!float "", 0, 0'), "'' is no float"),
    "a bool that is none": (ROS + "a: !!bool maybe\n", "'maybe' is no bool"),
    "an int that is none": (ROS + "a: !!int no\n", "'no' is no int"),
    "a type of YAML alone": (ROS + "a: !!set {b}\n", "could not determine a constructor"),
    "a matrix that is none": (ROS + "a: !!opencv-matrix b\n", "expected a mapping node"),
    "a ZED lens that is a number": ("LEFT_CAM_HD: {fx: 1}\nLEFT_DISTO: 3\n", "has no k1, k2"),
    "a long name": (
        "".join(f"{'n' * 1000}{camera}: {{intrinsics: [1]}}\n" for camera in range(9)),
        "holds 9 cameras",
    ),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_files_get_one_short_line_soon(tmp_path: Path, name: str) -> None:
    text, message = HOSTILE[name]
    path = tmp_path / "camera.any"
    path.write_text(text)
    started = time.process_time()
    with pytest.raises(InputError) as caught:
        load_camera(path)
    assert time.process_time() - started < 10
    assert message in str(caught.value)
    assert str(caught.value).startswith(str(path))
    assert len(str(caught.value)) <= 2000
    assert str(caught.value).isprintable()


def test_aliases_and_dates_of_real_files_are_read(tmp_path: Path) -> None:
    path = tmp_path / "camera.yaml"
    path.write_text("d: &d [0, 0, 0, 0, 0]\n" + ROS.replace("[0, 0, 0, 0, 0]", "*d"))
    assert load_camera(path).fx == 526.69
    path.write_text(ROS + "date: 2024-02-31\ncalibrated: !!timestamp 12:00\n")
    assert load_camera(path).fx == 526.69


def test_limits_can_be_changed(tmp_path: Path) -> None:
    path = tmp_path / "camera.yaml"
    path.write_text(ROS)
    for limit, value, message in (
        ("text_file_bytes", 100, "larger than 100 bytes, the limit text_file_bytes"),
        ("text_values", 20, "more than 20 values"),
        ("text_nesting", 2, "nested more than 2 levels deep"),
    ):
        set_limits(replace(Limits(), **{limit: value}))
        with pytest.raises(InputError, match=message):
            load_camera(path)
    set_limits(Limits())
    assert load_camera(path).width == 640
    with pytest.raises(InputError, match="limit text_values is 0: expected a whole number"):
        Limits(text_values=0)


def test_a_file_that_is_too_large_is_not_read_whole(tmp_path: Path) -> None:
    path = tmp_path / "camera.yaml"
    with path.open("wb") as file:
        file.truncate(2**40)
    with pytest.raises(InputFileError, match="larger than 2097152 bytes"):
        load_camera(path)


def test_keys_that_are_no_texts_are_named(tmp_path: Path) -> None:
    path = tmp_path / "transform.yaml"
    path.write_text("schema: calib.transform/1\n3: 4\nx: 5\n")
    with pytest.raises(InputError, match=r"the fields are \['3', 'x'\]"):
        load_transform(path)
