"""`--depth-scale` and `--depth-kind` mean the same in all commands and for all sources."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import calib

Cli = Callable[..., Any]

CAMERA = calib.PinholeCamera(640, 360, 400.0, 400.0, 319.5, 179.5)
DEPTH_M = np.tile(np.linspace(3.9, 4.1, 640, dtype=np.float32), (360, 1))
SCALE = calib.DepthScale(1.25, 0.0, 0.001, 0.002, -0.9, 0.5, 4.0)


def write(images: Path, form: str) -> tuple[object, ...]:
    """Write the depth in a unit of its own; returns the options that say so."""
    folder, camera = images.parent / form, ("--camera", images.parent / "camera.json")
    folder.mkdir()
    options: tuple[object, ...] = ()
    for stem in ("a", "b"):
        if form == "fifths":
            steps = np.rint(DEPTH_M * 5000).astype(np.uint16)
            cv2.imwrite(str(folder / f"{stem}.png"), steps)
            options = ("--depth-scale", 0.0002)
        elif form == "float millimetres":
            np.save(folder / f"{stem}.npy", DEPTH_M * 1000)
            options = ("--depth-scale", "0.001")
        elif form == "calibrated":
            calib.write_depth(folder / f"{stem}.png", DEPTH_M / 1.25)
            calib.save_depth_scale(images.parent / "scale.json", SCALE)
            options = ("--depth-scale", images.parent / "scale.json")
        else:
            np.save(folder / f"{stem}.npy", calib.depth_to_range(DEPTH_M, CAMERA))
            options = ("--depth-kind", "range")
    return ("--depth", folder, *camera, *options)


FORMS = ("fifths", "float millimetres", "calibrated", "range")


def distance_m(line: str) -> float:
    return float(json.loads(line)["trees"][0]["metres"]["distance_m"])


@pytest.mark.parametrize("form", FORMS)
def test_run_live_and_measure_give_the_same_metres(
    run_cli: Cli, model: Path, images: Path, form: str
) -> None:
    options = (*write(images, form), "--model", model)
    usual = ("--depth", images.parent / "depth", *options[2:4], "--model", model)
    expected = distance_m(run_cli("run", images, *usual).out.splitlines()[0])
    for command in ("run", "live"):
        done = run_cli(command, images, *options)
        assert done.code == 0, done.err
        found = [distance_m(line) for line in done.out.splitlines()]
        assert found == pytest.approx([expected] * 2, rel=0.02)
    depth = next(path for path in Path(str(options[1])).iterdir() if path.stem == "a")
    done = run_cli("measure", images / "a.jpg", "--depth", depth, *options[2:], "--json")
    assert done.code == 0, done.err
    (tree,) = json.loads(done.out)["frame"]["trees"]
    assert tree["metres"]["distance_m"] == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("form", FORMS)
def test_check_rig_takes_them(run_cli: Cli, images: Path, form: str) -> None:
    done = run_cli("check-rig", images, *write(images, form), "--json")
    assert done.code == 0, done.err
    assert json.loads(done.out)["frames"] == 2


@pytest.mark.parametrize("value", ["1e300", "1e-300", "0", "nan", "-0.001"])
@pytest.mark.parametrize("command", ["run", "live", "measure", "check-rig"])
def test_absurd_scales_end_in_one_line(
    run_cli: Cli, images: Path, command: str, value: str
) -> None:
    source = images / "a.jpg" if command == "measure" else images
    given = ("--depth", images.parent / "depth", "--camera", images.parent / "camera.json")
    done = run_cli(command, source, *given, "--depth-scale", value)
    assert done.code == 2
    assert done.err.startswith("edgetree: --depth-scale is "), done.err
    done = run_cli(command, source, *given, "--depth-kind", "radial")
    assert (done.code, done.err[:35]) == (2, "edgetree: --depth-kind is radial: e")
