"""RealSense intrinsics: text of `rs-enumerate-devices -c` or pyrealsense2, or JSON."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from typing import Any

from calib.camera import PinholeCamera
from calib.distortion import FISHEYE, RADTAN
from calib.errors import CameraError
from calib.files.fields import Values, camera, lens_model, number, numbers, size

_HEADER = re.compile(r'Intrinsic of "(?P<stream>[^"]+)"[\s/]+(?P<size>\d+x\d+)[\s/]*(?P<form>.*)')
_FIELD = re.compile(r"\s*(?P<name>Width|Height|PPX|PPY|Fx|Fy|Distortion|Coeffs):\s*(?P<value>.*)")
_PRINTED = re.compile(
    r"\[ *(?P<width>\d+)x(?P<height>\d+) +p\[(?P<ppx>\S+) (?P<ppy>\S+)\]"
    r" +f\[(?P<fx>\S+) (?P<fy>\S+)\] +(?P<model>[\w-]+(?: [\w-]+){0,4})"
    r" +\[(?P<coeffs>[^\]]{0,400})\] {0,9}\]"
)
_PRINTED_OLD = re.compile(
    r"width: (?P<width>\d+), height: (?P<height>\d+), ppx: (?P<ppx>\S+), ppy: (?P<ppy>\S+),"
    r" fx: (?P<fx>\S+), fy: (?P<fy>\S+),\s+model: (?P<model>[\w -]+),"
    r" coeffs: \[(?P<coeffs>[^\]]{0,400})\]"
)
_MODEL_NAMES = ("model", "distortion", "distortion_model")
_SUPPORTED = {"none": RADTAN, "brown conrady": RADTAN, "kannala brandt4": FISHEYE}
_UNSUPPORTED = {"inverse brown conrady": RADTAN, "modified brown conrady": RADTAN}


def parse_text(text: str) -> dict[str, Values]:
    """Return the streams in a text by name, such as "Depth 1280x720"; empty for another text.

    pyrealsense2 does not print the stream's name: there the name is size and model, with a number
    if another stream has the same.
    """
    streams: dict[str, Values] = {}
    printed = [
        {**found.groupdict(), "coeffs": found["coeffs"].replace(",", " ")}
        for found in (*_PRINTED.finditer(text), *_PRINTED_OLD.finditer(text))
    ]
    count: Counter[str] = Counter()
    for values in {tuple(sorted(found.items())): found for found in printed}.values():
        name = "{width}x{height} {model}".format(**values)
        count[name] += 1
        streams[f"{name} {count[name]}" if count[name] > 1 else name] = values
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


def find(values: Values, name: str = "") -> dict[str, Values]:
    """Return every map with a ppx, at any depth, by its keys: "color" or "color.intrinsics"."""
    if "ppx" in values:
        return {name: values}
    found: dict[str, Values] = {}
    for key, inner in values.items():
        if isinstance(inner, Mapping):
            found.update(find(inner, f"{name}.{key}" if name else str(key)))
    return found


def build(values: Values) -> PinholeCamera:
    """Create the camera.

    Brown Conrady's coeffs are OpenCV's k1, k2, p1, p2, k3; Kannala Brandt's are k1 to k4 and 0. The
    inverse and modified Brown Conrady models have other formulas and are accepted only if all terms
    are 0.
    """
    terms = numbers(values, "coeffs")
    if len(terms) != 5:
        raise CameraError(f"coeffs has {len(terms)} numbers: expected 5")
    names = [name for name in _MODEL_NAMES if name in values]
    if not names and any(terms):
        raise CameraError(f"{' or '.join(_MODEL_NAMES)} is missing: expected the model of coeffs")
    given = str(values[names[0]]) if names else "none"
    name = re.sub(r"^(distortion\.|rs2_distortion_)", "", given.lower()).replace("_", " ")
    if name == "none" and any(terms):
        raise CameraError(f"the model is {given} with terms {list(terms)}: expected terms of 0")
    if name in _UNSUPPORTED and any(terms):
        raise CameraError(
            f"the model is {given} with terms {list(terms)}: expected Brown Conrady, because the"
            " terms of this model have another meaning; calibrate the camera with a board"
        )
    model = lens_model("model", name, {**_SUPPORTED, **_UNSUPPORTED})
    focal = [number(values, field) for field in ("fx", "fy", "ppx", "ppy")]
    return camera(size(values), focal, terms[:4] if model == FISHEYE else terms, model)
