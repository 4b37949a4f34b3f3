"""`edgetree check-rig` on files: exit codes and messages."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from schema_check import check_schema


def test_it_prints_one_object_and_passes(run_cli: Callable[..., Any], images: Path) -> None:
    done = run_cli(
        "check-rig", images, "--depth", images.parent / "depth",
        "--camera", images.parent / "camera.json", "--json",
    )  # fmt: skip
    assert done.code == 0, done.err
    record = json.loads(done.out)
    assert check_schema(record) == "edgetree.check-rig/1"
    assert {check["verdict"] for check in record["checks"]} <= {"holds", "cannot tell"}


def test_images_without_depth_are_refused(run_cli: Callable[..., Any], images: Path) -> None:
    done = run_cli("check-rig", images, "--camera", images.parent / "camera.json")
    assert done.code == 2
    assert "has no depth" in done.err


def test_seconds_are_checked(run_cli: Callable[..., Any], images: Path) -> None:
    done = run_cli("check-rig", images, "--seconds", "0")
    assert done.code == 2
    assert "--seconds is 0.0: expected seconds above 0" in done.err


def test_stereo_pairs_are_refused(run_cli: Callable[..., Any], images: Path) -> None:
    camera = images.parent / "camera.json"
    done = run_cli("check-rig", images, "--right", images, "--camera", camera)
    assert done.code == 2
    assert "--right given: expected a camera with depth of its own" in done.err
    assert done.err.count("\n") == 1
