"""Find the installed libraries, their required versions, and whether they can be imported."""

from __future__ import annotations

import importlib.metadata
import platform
import re
import subprocess
import sys
from collections.abc import Iterable
from typing import Final

from edgetree.doctor.findings import Libraries
from edgetree.errors import TRAINING_PACKAGES

__all__ = ["CAMERA_PACKAGES", "examine_libraries", "import_error", "minimum_versions"]

OPENCV_BUILDS: Final = (
    "opencv-python",
    "opencv-python-headless",
    "opencv-contrib-python",
    "opencv-contrib-python-headless",
)
ONNXRUNTIME_BUILDS: Final = (
    "onnxruntime",
    "onnxruntime-gpu",
    "onnxruntime-openvino",
    "onnxruntime-directml",
    "onnxruntime-qnn",
    "onnxruntime-rocm",
    "onnxruntime-migraphx",
    "onnxruntime-training",
)
CAMERA_PACKAGES: Final = ("pyrealsense2", "depthai", "pyorbbecsdk2")
_LOOKED_AT: Final = (
    "edgetree",
    "numpy",
    "typer",
    *OPENCV_BUILDS,
    *ONNXRUNTIME_BUILDS,
    *CAMERA_PACKAGES,
    "rosbags",
    "small_gicp",
    "paho-mqtt",
    *TRAINING_PACKAGES,
)
# The module of each distribution that is test-imported.
_MODULES: Final = {
    "numpy": "numpy",
    **dict.fromkeys(OPENCV_BUILDS, "cv2"),
    **dict.fromkeys(ONNXRUNTIME_BUILDS, "onnxruntime"),
    "torchvision": "torchvision",
}
_IMPORT_LIMIT_S: Final = 120


def examine_libraries() -> Libraries:
    """List the installed packages and test-import the most error-prone in separate processes."""
    versions = {name: version for name in _LOOKED_AT if (version := _version(name)) is not None}
    modules = dict.fromkeys(_MODULES[name] for name in versions if name in _MODULES)
    errors = {module: error for module in modules if (error := import_error(module))}
    return Libraries(
        python=platform.python_version(),
        versions=versions,
        minima=minimum_versions(_requirements("edgetree")),
        torch_needed=_exact_version(_requirements("torchvision"), "torch"),
        import_errors=errors,
    )


def minimum_versions(requirements: Iterable[str]) -> dict[str, str]:
    """The lowest version of each package, from requirements of the form `name>=version`."""
    found = (re.match(r"([\w.-]+)\s*\(?>=\s*([\w.]+)", line) for line in requirements)
    return {match[1].lower(): match[2] for match in found if match}


def _exact_version(requirements: Iterable[str], name: str) -> str | None:
    found = (re.match(rf"{name}\s*\(?==\s*([\w.+]+)", line) for line in requirements)
    return next((match[1] for match in found if match), None)


def _requirements(name: str) -> list[str]:
    try:
        return importlib.metadata.requires(name) or []
    except importlib.metadata.PackageNotFoundError:
        return []


def _version(name: str) -> str | None:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return None


def import_error(module: str) -> str:
    """The last line of the error when importing a module; empty if it can be imported."""
    command = [sys.executable, "-c", f"import {module}"]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, check=False, timeout=_IMPORT_LIMIT_S
        )
    except subprocess.TimeoutExpired:
        return f"not imported after {_IMPORT_LIMIT_S} s"
    if done.returncode == 0:
        return ""
    lines = done.stderr.strip().splitlines()
    return lines[-1] if lines else f"the process ended with {done.returncode}"
