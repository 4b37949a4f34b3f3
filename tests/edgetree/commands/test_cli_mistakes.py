"""Wrong paths, files and values: one line on stderr, exit code 2, and no output files."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import calib
from edgetree.model_file.manifest import Manifest

Cli = Callable[..., Any]


def _everything_under(folder: Path) -> list[Path]:
    return sorted(folder.rglob("*"))


BAD_INPUTS = {
    "a missing image": ("run none.png --model model.onnx", r"none\.png does not exist: expected"),
    "an unreadable image": ("run bad.png --model model.onnx", r"bad\.png cannot be read.*expected"),
    "a cut-off image": ("run cut.png --model model.onnx", r"cut\.png cannot be read.*expected"),
    "depth of another size": (
        "run images/a.jpg --model model.onnx --depth small.png",
        r"small\.png is 64x36 px: expected 640x360 px, like image .*a\.jpg",
    ),
    "depth that is no depth": (
        "run images/a.jpg --model model.onnx --depth images/b.jpg",
        r"b\.jpg.*uint8.*expected.*integers",
    ),
    "a folder without images": ("run empty --model model.onnx", "empty has no images: expected"),
    "a broken image among good ones": (
        "run mixed --model model.onnx --jsonl lines.jsonl --report r.html --strict-frames",
        r"mixed.b\.png cannot be read.*expected",
    ),
    "a missing model": ("run images --model none.onnx", r"none\.onnx does not exist: expected"),
    "a model that is no ONNX": (
        "run images --model camera.json",
        r"camera\.json is not an ONNX model .*expected a file made by `edgetree export`",
    ),
    "a model without our manifest": (
        "run images --model plain.onnx",
        r"plain\.onnx: no manifest.*expected a file made by `edgetree export`",
    ),
    "an output folder under a file": (
        "run images --model model.onnx --out camera.json/out",
        r"output folder camera\.json.out cannot be written \(.+\): expected a writable folder",
    ),
    "JSON lines under a file": (
        "run images --model model.onnx --jsonl camera.json/x --out out",
        r"camera\.json.x cannot be written \(.+\): expected a file",
    ),
    "a missing camera": (
        "run images/a.jpg --model model.onnx --depth depth/a.png --camera none.json",
        r"none\.json.*expected",
    ),
    "a camera of another aspect": (
        "run images/a.jpg --model model.onnx --depth depth/a.png --camera other.json --out out",
        r"a\.jpg: the camera is for 640x480 px and the image is 640x360: expected the same aspect",
    ),
    "an up that is no direction": (
        "run images/a.jpg --model model.onnx --depth depth/a.png --camera camera.json --up 0,1",
        r"--up is '0,1': expected three numbers",
    ),
    "an up of no length": (
        "run images/a.jpg --model model.onnx --depth depth/a.png --camera camera.json --up 0,0,0",
        r"up_camera is \[0.0, 0.0, 0.0\]: expected a direction",
    ),
    "an up of no length beside depth that is none": (
        "run images/a.jpg --model model.onnx --depth images/a.jpg --camera camera.json --up 0,0,0",
        r"up_camera is \[0.0, 0.0, 0.0\]: expected a direction",
    ),
    "an option given twice": (
        "run images --model model.onnx --csv a.csv --csv b.csv",
        r"--csv is given twice: expected once \(see `edgetree run --help`\)",
    ),
    "a cover in centimetres": (
        "run images/a.jpg --model model.onnx --depth depth/a.png --camera camera.json"
        " --ground-cover 30,5",
        r"--ground-cover is '30,5': expected .* in metres, both above 0 and up to 3",
    ),
    "a stump in centimetres": (
        "run images/a.jpg --model model.onnx --depth depth/a.png --camera camera.json"
        " --stump-height 30",
        r"--stump-height is 30: expected metres above 0 and up to 3",
    ),
    "a picture in a folder that is missing": (
        "measure images/a.jpg --model model.onnx --depth depth/a.png --camera camera.json"
        " --out none/a.jpg",
        r"none.a\.jpg cannot be written \(.+\): expected a file in an existing, writable folder",
    ),
    "a table that is a folder": (
        "measure images/a.jpg --model model.onnx --depth depth/a.png --camera camera.json"
        " --csv depth",
        r"depth is a folder: expected the name of a file to write",
    ),
    "an unknown species": (
        "run images/a.jpg --model model.onnx --depth depth/a.png --camera camera.json"
        " --species oak",
        "--species is 'oak': expected pine, spruce or birch",
    ),
    "profiles that overwrite the source": (
        "run images/a.jpg --model model.onnx --profiles images/a.jpg",
        "--profiles",
    ),
    "a threshold out of range": (
        "run images --model model.onnx --score-threshold 7",
        r"--score-threshold.*see `edgetree run --help`",
    ),
    "an unknown option": ("run images --fast", r"--fast.*see `edgetree run --help`"),
    "an unknown command": ("find", r"No such command 'find'.*see `edgetree --help`"),
    "a bench of a missing model": ("bench none.onnx", r"none\.onnx does not exist"),
    "a bench of no images": ("bench model.onnx --frames empty", "empty has no images"),
    "a table's option for one model": (
        "bench model.onnx --precision int8 --size 800x800",
        "--precision, --size given without --backbones",
    ),
    "an unknown backbone": (
        "bench --backbones r50,r5 --models .",
        r"'r5' has no file .*r5-fp32-800x800\.onnx and is not a known network: expected one of",
    ),
}


@pytest.mark.parametrize("case", BAD_INPUTS)
def test_bad_input_gives_one_line_and_no_files(
    run_cli: Cli,
    rgb_manifest: Manifest,
    model: Path,
    write_model: Callable[..., Path],
    images: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    case: str,
) -> None:
    assert model.parent == tmp_path
    write_model(rgb_manifest, "plain.onnx", with_manifest=False)
    (tmp_path / "bad.png").write_text("no image")
    pixels = np.random.default_rng(0).integers(0, 256, (360, 640, 3), np.uint8)
    whole = cv2.imencode(".png", pixels)[1].tobytes()
    (tmp_path / "cut.png").write_bytes(whole[: len(whole) // 2])
    calib.write_depth(tmp_path / "small.png", np.ones((36, 64), np.float32))
    (tmp_path / "empty").mkdir()
    (tmp_path / "mixed").mkdir()
    (tmp_path / "mixed" / "a.png").write_bytes(whole)
    (tmp_path / "mixed" / "b.png").write_text("no image")
    other = calib.PinholeCamera(640, 480, 400.0, 400.0, 319.5, 239.5)
    calib.save_camera(tmp_path / "other.json", other)
    monkeypatch.chdir(tmp_path)
    before = _everything_under(tmp_path)

    arguments, message = BAD_INPUTS[case]
    done = run_cli(*arguments.split())

    assert done.code == 2
    assert done.out == ""
    assert done.err.count("\n") == 1, done.err
    assert done.err.startswith("edgetree: ")
    assert re.search(message, done.err), done.err
    assert _everything_under(tmp_path) == before
