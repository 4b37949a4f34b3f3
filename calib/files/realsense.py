"""RealSense intrinsics: text of ``rs-enumerate-devices -c`` or pyrealsense2, or JSON."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from calib.camera import FISHEYE, RADTAN, PinholeCamera
from calib.errors import CameraError
from calib.files.fields import Values, camera, lens_model, number, numbers, size

_HEADER = re.compile(r'Intrinsic of "(?P<stream>[^"]+)"[\s/]+(?P<size>\d+x\d+)[\s/]*(?P<form>.*)')
_FIELD = re.compile(r"\s*(?P<name>Width|Height|PPX|PPY|Fx|Fy|Distortion|Coeffs):\s*(?P<value>.*)")
_PRINTED = re.compile(
    r"\[ *(?P<width>\d+)x(?P<height>\d+) +p\[(?P<ppx>\S+) (?P<ppy>\S+)\]"
    r" +f\[(?P<fx>\S+) (?P<fy>\S+)\] +(?P<model>[\w -]+?) +\[(?P<coeffs>[^\]]*)\] *\]"
)
_SUPPORTED = {"none": RADTAN, "brown conrady": RADTAN, "kannala brandt4": FISHEYE}
_UNSUPPORTED = {"inverse brown conrady": RADTAN, "modified brown conrady": RADTAN}


def parse_text(text: str) -> dict[str, Values]:
    """Return the streams in a text by name, such as "Depth 1280x720"; empty for another text.

    pyrealsense2 does not print the stream's name: there the name is size and model.
    """
    streams: dict[str, Values] = {
        "{width}x{height} {model}".format(**printed.groupdict()): printed.groupdict()
        for printed in _PRINTED.finditer(text)
    }
    current: dict[str, Any] | None = None
    for line in text.splitlines():
        if header := _HEADER.search(line):
            width, height = header["size"].split("x")
            current = {"image_width": width, "image_height": height}
            name = f"{header['stream']} {header['size']}"
            streams[name if name not in streams else f"{name} {header['form'].strip()}"] = current
        elif current is not None and (field := _FIELD.match(line)):
            current[field["name"].lower()] = field["value"].strip()
    return streams


def find(values: Values) -> dict[str, Values]:
    """Return one unnamed stream, or several by name."""
    if "ppx" in values:
        return {"": values}
    return {
        str(name): stream
        for name, stream in values.items()
        if isinstance(stream, Mapping) and "ppx" in stream
    }


def build(values: Values) -> PinholeCamera:
    """Create the camera.

    Brown Conrady's coeffs are OpenCV's k1, k2, p1, p2, k3; Kannala Brandt's are k1 to k4 and 0. The
    inverse and modified Brown Conrady models have other formulas and are accepted only if all terms
    are 0.
    """
    given = str(values.get("model", values.get("distortion")))
    name = re.sub(r"^(distortion\.|rs2_distortion_)", "", given.lower()).replace("_", " ")
    terms = numbers(values, "coeffs")
    if len(terms) != 5:
        raise CameraError(f"coeffs has {len(terms)} numbers: expected 5")
    if name in _UNSUPPORTED and any(terms):
        raise CameraError(
            f"the model is {given} with terms {list(terms)}: expected Brown Conrady, because the"
            " terms of this model have another meaning; calibrate the camera with a board"
        )
    model = lens_model("model", name, {**_SUPPORTED, **_UNSUPPORTED})
    focal = [number(values, field) for field in ("fx", "fy", "ppx", "ppy")]
    return camera(size(values), focal, terms[:4] if model == FISHEYE else terms, model)
