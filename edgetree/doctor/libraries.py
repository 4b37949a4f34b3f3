"""Find the installed libraries, their versions, whether they work, and what OpenCV can read."""

from __future__ import annotations

import importlib.metadata
import platform
import re
import subprocess
import sys
from collections.abc import Iterable
from typing import Final

from basetree.program.python import installed_version, run_python
from edgetree.doctor.findings import Libraries
from edgetree.errors import TRAINING_PACKAGES

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
    "laspy",
    "small_gicp",
    "paho-mqtt",
    "pyzmq",
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
VIDEO_BACKENDS: Final = {"V4L2": "CAP_V4L2", "FFmpeg": "CAP_FFMPEG", "GStreamer": "CAP_GSTREAMER"}
"""What reads cameras, with the name of its constant in OpenCV: devices of Linux; RTSP, HTTP and
files; pipelines."""


def examine_libraries() -> Libraries:
    """List the installed packages and test-import the most error-prone in separate processes."""
    found = {name: installed_version(name) for name in _LOOKED_AT}
    versions = {name: version for name, version in found.items() if version is not None}
    modules = dict.fromkeys(_MODULES[name] for name in versions if name in _MODULES)
    needed = (re.match(r"torch\s*\(?==\s*([\w.+]+)", line) for line in _requirements("torchvision"))
    exact = (match[1] for match in needed if match)
    errors = {module: error for module in modules if (error := import_error(module))}
    return Libraries(
        python=platform.python_version(),
        versions=versions,
        minima=minimum_versions(_requirements("edgetree")),
        torch_needed=next(iter(exact), None),
        import_errors=errors,
    )


def minimum_versions(
    requirements: Iterable[str], python: tuple[int, ...] = sys.version_info[:2]
) -> dict[str, str]:
    """The lowest version of each package.

    Args:
        requirements: Requirements such as `name[extra]<3,>=2.1; python_version >= "3.12"`.
        python: The version of Python. Requirements for others do not count.
    """
    found = {}
    for line in requirements:
        what, _, marker = line.partition(";")
        match = re.match(r"([\w.-]+).*?>=\s*([\w.]+)", what)
        if match and _is_for(python, marker):
            found[match[1].lower()] = match[2]
    return found


def _is_for(python: tuple[int, ...], marker: str) -> bool:
    """Whether a marker leaves a requirement to a version of Python."""
    limits = re.findall(r"""python_version\s*(<|>=)\s*["']([\d.]+)""", marker)
    return all(
        (python < tuple(map(int, version.split(".")))) == (sign == "<") for sign, version in limits
    )


def _requirements(name: str) -> list[str]:
    try:
        return importlib.metadata.requires(name) or []
    except importlib.metadata.PackageNotFoundError:
        return []


def import_error(module: str) -> str:
    """The last line of the error when importing a module; empty if it can be imported."""
    try:
        done = run_python("-c", f"import {module}", limit_s=_IMPORT_LIMIT_S)
    except subprocess.TimeoutExpired:
        return f"not imported after {_IMPORT_LIMIT_S} s"
    if done.returncode == 0:
        return ""
    lines = done.stderr.strip().splitlines()
    return lines[-1] if lines else f"the process ended with {done.returncode}"


def examine_video() -> dict[str, bool]:
    """Whether the installed OpenCV has each of `VIDEO_BACKENDS`."""
    import cv2

    return {
        name: bool(cv2.videoio_registry.hasBackend(getattr(cv2, constant)))
        for name, constant in VIDEO_BACKENDS.items()
    }
