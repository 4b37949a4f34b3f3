"""RealSense intrinsics: text of ``rs-enumerate-devices -c`` or pyrealsense2, or fields as JSON."""

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
_EXACT = {"none": RADTAN, "brown conrady": RADTAN, "kannala brandt4": FISHEYE}
_OTHER = {"inverse brown conrady": RADTAN, "modified brown conrady": RADTAN}


def parse_text(text: str) -> dict[str, Values]:
    """The streams in the text, named like "Depth 1280x720"; empty where it is another text.

    What pyrealsense2 prints does not tell the stream: size and model are its name.
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
    """One stream's fields, or several under their names."""
    if "ppx" in values:
        return {"": values}
    return {
        str(name): stream
        for name, stream in values.items()
        if isinstance(stream, Mapping) and "ppx" in stream
    }


def build(values: Values) -> PinholeCamera:
    """coeffs are k1, k2, p1, p2, k3 of OpenCV for Brown Conrady; k1 to k4 and 0 for Kannala Brandt.

    The inverse and the modified model are other formulas: without terms they are no lens at all,
    with terms there is no camera for them here.
    """
    word = str(values.get("model", values.get("distortion")))
    name = re.sub(r"^(distortion\.|rs2_distortion_)", "", word.lower()).replace("_", " ")
    terms = numbers(values, "coeffs")
    if len(terms) != 5:
        raise CameraError(f"coeffs has {len(terms)} numbers: expected 5")
    if name in _OTHER and any(terms):
        raise CameraError(
            f"the model is {word} with terms {list(terms)}: expected Brown Conrady, as the"
            " terms of another model mean something else; calibrate it with a board"
        )
    model = lens_model("model", name, {**_EXACT, **_OTHER})
    focal = [number(values, field) for field in ("fx", "fy", "ppx", "ppy")]
    return camera(size(values), focal, terms[:4] if model == FISHEYE else terms, model)
