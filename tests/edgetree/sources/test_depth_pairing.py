"""Which depth file belongs to which image, and what happens to images without one."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path, PurePath
from typing import Any

import numpy as np
import pytest

import calib
from basetree.errors import InputError
from edgetree.sources import open_source
from edgetree.sources.depth_pairing import depth_names

Cli = Callable[..., Any]


def paired(images: list[str], depths: list[str]) -> dict[str, str | None]:
    found = depth_names([PurePath(name) for name in images], depths, "rgb", "depth")
    names = [None if name in found.missing else name for name in found.names]
    return dict(zip(images, names, strict=True))


@pytest.mark.parametrize(
    ("image", "depth"),
    [
        ("a.jpg", "a.PNG"),
        ("a.jpg", "a_depth.png"),
        ("a.jpg", "a-depth.tiff"),
        ("a.jpg", "a_depth_mm.png"),
        ("a.jpg", "depth_a.npy"),
        ("a.jpg", "a_d.png"),
        ("a_rgb.png", "a_depth.png"),
        ("rgb0007.png", "depth0007.png"),
        ("color_0007.jpg", "depth_0007.png"),
        ("left000007.png", "depth000007.png"),
        ("frame-000000.color.jpg", "frame-000000.depth.png"),
        ("A_Color.png", "A_Depth.png"),
    ],
)
def test_words_for_depth_and_colour_do_not_count(image: str, depth: str) -> None:
    other = image.replace("7", "8").replace("00000.", "00001.")
    images = [image] if other == image else [image, other]
    assert paired(images, [depth, "notes.txt"])[image] == depth
    assert list(paired(images, [depth]).values())[1:] in ([], [None])


def test_equal_stems_come_first() -> None:
    assert paired(["a.jpg", "b.jpg"], ["a.png", "a_depth.png"]) == {"a.jpg": "a.png", "b.jpg": None}
    names = depth_names([PurePath("a.jpg")], ["a.npy", "a.png"], "rgb", "depth")
    assert names.remark == "depth a.png is taken where there are several, such as a.npy"


def test_two_files_that_look_alike_are_named() -> None:
    with pytest.raises(InputError, match=r"a_d\.png and a_depth\.png in depth both look like the"):
        paired(["a.jpg"], ["a_depth.png", "a_d.png"])


def test_time_stamps_pair_within_half_a_period() -> None:
    images = [f"1305031102.{part}.png" for part in ("175304", "211214", "243211", "275326")]
    depths = [f"1305031102.{part}.png" for part in ("160407", "194330", "262886", "295279")]
    found = paired(images, depths)
    assert [name and name[11:17] for name in found.values()] == ["160407", "194330", None, "262886"]
    remark = depth_names([*map(PurePath, images)], depths, "rgb", "depth").remark
    assert remark is not None
    assert "at most 16.9 ms apart (half a period is 17.0 ms): 3 of 4 images" in remark


@pytest.mark.parametrize("unit", ["{:.6f}", "ms", "us", "ns"])
def test_time_stamps_have_several_units(unit: str) -> None:
    digits = {"ms": 3, "us": 6, "ns": 9}

    def name(time_s: float) -> str:
        if unit in digits:
            return f"{round(time_s * 10 ** digits[unit])}.png"
        return unit.format(time_s) + ".png"

    times_s = [1_700_000_000 + 0.1 * number for number in range(5)]
    depths = [f"{time_s + 0.02:.6f}.png" for time_s in times_s]
    assert list(paired([name(time_s) for time_s in times_s], depths).values()) == depths


def test_numbers_of_frames_are_no_times() -> None:
    with pytest.raises(InputError, match=r"depth image depth/000010\.png does not exist, nor with"):
        paired(["000010.png", "000020.png"], ["000011.png", "000021.png"])
    with pytest.raises(InputError, match="does not exist"):
        paired(["3.1.png", "3.2.png"], ["3.3.png"])
    far = [f"{1_700_000_000 + number}.png" for number in range(3)]
    with pytest.raises(InputError, match="does not exist"):
        paired(far, ["1600000000.png", "1600000001.png"])


def write_tree(root: Path, colour: str, depth: str) -> None:
    rng = np.random.default_rng(0)
    import cv2

    for place, suffix in ((colour, ""), (depth, "_depth" if colour == depth else "")):
        (root / place).mkdir(parents=True, exist_ok=True)
        for stem in ("a", "b"):
            file = root / place / f"{stem}{suffix}.png"
            if place == depth and (suffix or colour != depth):
                values = np.tile(np.linspace(2, 3, 64, dtype=np.float32), (48, 1))
                calib.write_depth(file, values)
            else:
                cv2.imwrite(str(file), rng.integers(0, 256, (48, 64, 3), np.uint8))


def test_folders_of_one_root_and_one_folder_for_both(tmp_path: Path) -> None:
    write_tree(tmp_path / "two", "rgb", "depth")
    write_tree(tmp_path / "one", "all", "all")
    for opened in (
        open_source(tmp_path / "two"),
        open_source(tmp_path / "two", tmp_path / "two"),
        open_source(tmp_path / "two" / "rgb", tmp_path / "two"),
        open_source(tmp_path / "one" / "all", tmp_path / "one" / "all"),
    ):
        frames = list(opened)
        assert [frame.name for frame in frames] == ["a", "b"]
        assert all(frame.image is not None and frame.depth_m is not None for frame in frames)


@pytest.mark.parametrize("mode", ["missing", "empty", "another size", "no depth"])
def test_one_unusable_depth_image_is_left_out(
    run_cli: Cli, model: Path, images: Path, mode: str, tmp_path: Path
) -> None:
    depth = images.parent / "depth"
    file = depth / "b.png"
    if mode == "missing":
        file.unlink()
    elif mode == "empty":
        file.write_bytes(b"")
    elif mode == "another size":
        calib.write_depth(file, np.full((10, 10), 4.0, np.float32))
    else:
        file.write_bytes((images / "b.jpg").read_bytes())
    given = (images, "--depth", depth, "--camera", images.parent / "camera.json", "--model", model)
    done = run_cli("run", *given)
    assert done.code == 1
    assert [json.loads(line)["frame"] for line in done.out.splitlines()] == ["a"]
    assert "b.png" in next(line for line in done.err.splitlines() if "left out" in line)
    assert done.err.splitlines()[-1] == "edgetree: 1 of 2 frames left out, see above"
    shards = ("--shards", tmp_path / "parts", "--jsonl", tmp_path / "a.jsonl")
    done = run_cli("run", *given, *shards)
    assert done.code == 1
    assert "b.png" in done.err
    assert run_cli("live", *given).err.count("1 left out: unreadable images") == 1
    (depth / "a.png").unlink()
    assert run_cli("run", *given).code == 2


def test_a_folder_without_the_depth_says_what_it_holds() -> None:
    with pytest.raises(InputError, match=r"holds a\.jpg, which is no depth image: .*swapped\?$"):
        depth_names([PurePath("a.png")], ["a.jpg", "b.jpg"], "depth", "rgb")
    with pytest.raises(InputError, match=r"; it holds 000000\.png to 000019\.png$"):
        depth_names([PurePath("a.jpg")], ["000019.png", "000000.png"], "rgb", "depth")
    with pytest.raises(InputError, match=r"the folder is empty$"):
        depth_names([PurePath("a.jpg")], [], "rgb", "depth")
