"""Processes that simulate noise instead of forests, so that faults can be tried in seconds."""

import os
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FAKE = Path(__file__).with_name("fake_synth.py")

# Python runs a module of this name in every process that finds it.
STARTED_IN_EVERY_PROCESS = f"""
import importlib.util, sys
spec = importlib.util.spec_from_file_location("fake_synth", {str(FAKE)!r})
module = importlib.util.module_from_spec(spec)
spec.loader.exec_module(module)
sys.modules[module.fake.__name__] = module.fake
"""


def environment(folder: Path, frame_seconds: float = 0.0) -> dict[str, str]:
    """The environment of such processes; `folder` gets a module that they import."""
    (folder / "sitecustomize.py").write_text(STARTED_IN_EVERY_PROCESS)
    kernels = folder / "__pycache__" / "kernels"
    kernels.mkdir(parents=True, exist_ok=True)
    (kernels / "fake.nbi").touch()  # or the first simulation says that it compiles
    return {
        **os.environ,
        "NUMBA_CACHE_DIR": str(kernels),
        "PYTHONPATH": os.pathsep.join([str(folder), str(ROOT)]),
        "FAKE_FRAME_SECONDS": str(frame_seconds),
        "RAY_USAGE_STATS_ENABLED": "0",
    }


def synth_command(out: object, frames: int, *options: object) -> list[str]:
    """``perceptree synth`` of small frames in scenes of two."""
    small = ("--width", 128, "--height", 72, "--views", 2, "--seed", 3)
    words = ("-m", "perceptree", "synth", "--out", out, "--frames", frames, *small, *options)
    return [sys.executable, *map(str, words)]


def contents(directory: Path) -> dict[str, bytes]:
    """Name and bytes of every file of a dataset, without the manifests of its shards."""
    return {
        name: path.read_bytes()
        for path in sorted(directory.rglob("*"))
        if path.is_file() and not (name := str(path.relative_to(directory))).startswith("shards/")
    }
