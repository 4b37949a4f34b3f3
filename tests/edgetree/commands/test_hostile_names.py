"""Names and texts of strangers reach neither a terminal nor a log as commands; data is exact."""

from __future__ import annotations

import csv
import json
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

Cli = Callable[..., Any]

NAMES = [
    "bad\x1b]0;owned\x07\x1b[2J\nFAKE LINE",
    "bad\rFAKE LINE",
    "bad\u202egpj",
    "bad\x9b2J\x85FAKE LINE",
]

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such names")


def is_clean(text: str) -> bool:
    lines = text.split("\n")
    return all(line.isprintable() and not line.startswith("FAKE") for line in lines)


@pytest.mark.parametrize("name", NAMES)
def test_pictures_that_cannot_be_read(run_cli: Cli, model: Path, images: Path, name: str) -> None:
    (images / f"{name}.jpg").write_text("no picture")
    for command in ("run", "live"):
        done = run_cli(command, images, "--model", model)
        assert done.code in (0, 1), done.err
        assert is_clean(done.err), done.err
        assert "bad" in done.err
        assert is_clean(done.out)


@pytest.mark.parametrize("name", NAMES)
def test_outputs_and_inputs_of_such_names(
    run_cli: Cli, model: Path, images: Path, tmp_path: Path, name: str
) -> None:
    shutil.copy(images / "a.jpg", images / f"{name}.jpg")
    table = tmp_path / f"{name}.csv"
    done = run_cli("run", images / f"{name}.jpg", "--model", model, "--csv", table)
    assert done.code == 0, done.err
    assert is_clean(done.err), done.err
    assert is_clean(done.out)
    record = json.loads(done.out)
    assert (record["frame"], record["path"]) == (name, str(images / f"{name}.jpg"))
    with table.open(newline="", encoding="utf-8") as stream:
        (row,) = csv.DictReader(stream)
    assert row["frame"] == " ".join(name.split())


@pytest.mark.parametrize("name", NAMES)
def test_mistakes_that_quote_such_names(run_cli: Cli, model: Path, name: str) -> None:
    for arguments in (
        ("run", f"{name}.jpg", "--model", model),
        ("live", f"{name}.mcap", "--model", model),
        ("run", "a.jpg", f"--{name}"),
        (name,),
    ):
        done = run_cli(*arguments)
        assert done.code == 2
        assert (done.err.count("\n"), is_clean(done.err)) == (1, True), done.err


def test_frames_of_other_sizes_in_a_folder(run_cli: Cli, model: Path, images: Path) -> None:
    cv2.imwrite(str(images / "c.png"), np.zeros((2, 2), np.uint8))
    (images / "c.png").rename(images / "c\x1b[2J\nFAKE.png")
    done = run_cli("run", images, "--model", model, "--depth", images.parent / "depth")
    assert done.code in (1, 2)
    assert is_clean(done.err), done.err
