"""Prepare what is timed: the frames, and the peers' files, each made in its environment."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

import calib
from benchmarks.peers.contestants import NETWORKS, Network
from benchmarks.peers.environments import python_of
from edgetree import TreeDetector, default_model, sample_frames
from edgetree.runtime.input_images import to_bytes

PAD_VALUE = 114
ROOT = Path(__file__).resolve().parents[2]
EXPORTERS = Path(__file__).parent / "exporters"
FACTS = "facts.json"


class Failed(Exception):
    """A program of a peer failed; the message is its last line."""


def call(command: list[str | Path], threads: int | None, folder: Path) -> dict[str, Any]:
    """Run a program of a peer; returns the JSON object in the last line of its output.

    Args:
        command: The program and its arguments.
        threads: Threads of the libraries that ask the environment; None for their default.
        folder: Where the peers' packages may store settings.

    Raises:
        Failed: The program failed.
    """
    settings = {
        "PYTHONPATH": str(ROOT),
        "YOLO_CONFIG_DIR": str(folder / "settings"),
        "YOLO_OFFLINE": "1",
        "NNCF_CI": "1",  # no telemetry
        "HF_HUB_OFFLINE": "1",
        "TORCHINDUCTOR_CACHE_DIR": str(folder / "compiled"),
    }
    if threads is not None:
        settings["OMP_NUM_THREADS"] = str(threads)
    (folder / "settings").mkdir(exist_ok=True)
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, env=os.environ | settings
    )
    if done.returncode != 0:
        lines = done.stderr.strip().splitlines() or [f"exit code {done.returncode}"]
        raise Failed(lines[-1])
    record: dict[str, Any] = json.loads(done.stdout.strip().splitlines()[-1])
    return record


def frames_file(side_px: int | None, folder: Path, *, depth: bool = False) -> Path:
    """The sample frames of edgetree in a .npy file.

    They are (N, H, W, 3) uint8 BGR; with `depth` (N, H, W), uint8 as encoded for the packaged file,
    or float32 metres where they are as they come.

    Args:
        side_px: Side of the square that they are letterboxed to; None for frames as they are.
        folder: Folder of the file.
        depth: Whether to take the depth images.
    """
    path = folder / f"frames-{side_px or 'whole'}{'-depth' * depth}.npy"
    if not path.is_file():
        samples = sample_frames()
        images: list[Any] = [each.depth_m() if depth else each.image() for each in samples]
        if side_px is not None:
            manifest = TreeDetector.load(default_model("depth")).manifest
            encoding = calib.DepthEncoding.from_dict(dict(manifest.depth_encoding or {}))
            pad_value = manifest.resize.pad_value if depth else PAD_VALUE
            height, width = images[0].shape[:2]
            letterbox = calib.Letterbox.fit(width, height, side_px, side_px)
            images = [letterbox.apply(to_bytes(image, encoding), pad_value) for image in images]
        np.save(path, np.stack(images))
    return path


def prepare(names: Iterable[str], folder: Path) -> dict[str, str]:
    """Make the files of networks that are missing; returns the reasons of those that failed."""
    failed = {}
    for name in names:
        if (folder / name / FACTS).is_file():
            continue
        sys.stderr.write(f"making {name}\n")
        try:
            _make(NETWORKS[name], folder)
        except Failed as error:
            failed[name] = str(error)
    return failed


def _make(network: Network, folder: Path) -> None:
    """Run the network's exporter; its folder appears when it is complete."""
    frames = frames_file(network.side_px, folder).absolute()
    python = python_of(network.environment, folder)
    if not python.exists():
        raise Failed(f"no environment {network.environment}: make it with environments.py")
    with tempfile.TemporaryDirectory(dir=folder) as temporary:
        made = Path(temporary) / network.name
        made.mkdir()
        program = EXPORTERS / network.exporter
        facts = call([python, program, network.name, made, frames], None, folder.absolute())
        (made / FACTS).write_text(json.dumps(facts) + "\n", encoding="utf-8")
        made.rename(folder / network.name)


def facts_of(name: str, folder: Path) -> dict[str, Any]:
    """What the exporter says of a network."""
    facts: dict[str, Any] = json.loads((folder / name / FACTS).read_text(encoding="utf-8"))
    return facts
