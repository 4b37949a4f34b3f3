"""A conformance kit: a folder with a model file, raw frames and the trees in them.

KIT/model.onnx        the model
KIT/kit.json          the frames, the score threshold and what the model is
KIT/frames/NAME.raw   pixels row by row: BGR bytes, or 16-bit little-endian millimetres
KIT/frames/NAME.depth.raw   the depth beside the colour, for a model of both
KIT/expected.json     the trees, in the form that programs write their results
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
import os
import statistics
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from basetree.errors import InputError
from basetree.files import writing
from basetree.files.json import read_json, refuse_repeated
from basetree.files.limits import current_limits
from basetree.files.names import is_inside
from basetree.files.reading import file_sha256
from basetree.files.writing import replacing, text_file
from calib import PinholeCamera
from edgetree.conformance.frames import FramePixels, KitCamera, frames_for
from edgetree.conformance.reference import Reference
from edgetree.conformance.results import (
    MOST_FRAMES,
    FrameTrees,
    Results,
    found_trees,
    read_results,
    write_results,
)
from edgetree.model_file.safety_check import check_is_file
from edgetree.runtime.providers import CPU

KIT_SCHEMA: Final = "edgetree.conformance-kit/1"
SCORE_THRESHOLD: Final = 0.15
"""Lower than for display, so that there are more trees, and trees found twice among them."""
_MODEL, _EXPECTED, _FRAMES, _CONTENT = "model.onnx", "expected.json", "frames", "kit.json"
KIT_FILES = (_MODEL, _EXPECTED, _CONTENT)
"""Files in the folder of a kit, but for its frames."""
_COLOUR: Final = 3
_PIXELS: Final[dict[int, Any]] = {3: np.dtype("u1"), 1: np.dtype("<u2")}

_Side = Annotated[int, Meta(ge=1, le=65_535)]


@dataclass(frozen=True)
class KitFrame:
    """One frame.

    Attributes:
        name: Its name.
        file: Path of its pixels inside the kit.
        width: Width in pixels.
        height: Height in pixels.
        channels: 3 for blue, green and red bytes; 1 for 16-bit millimetres, 0 = no reading.
        depth_file: Path of 16-bit millimetres of the same size, beside colour for a model of both;
            None if there are none.
        camera: Its camera, with which trees beyond the model's reach are left out; None if it is
            not given.

    Raises:
        InputError: A value is out of range, or the path leaves the kit.
    """

    name: str
    file: str
    width: _Side
    height: _Side
    channels: int
    depth_file: str | None = None
    camera: KitCamera | None = None

    def __post_init__(self) -> None:
        if self.channels not in _PIXELS or self.width * self.height > current_limits().image_pixels:
            raise InputError(
                f"frame {self.name!r} is {self.width}x{self.height} with {self.channels}"
                f" channels, expected at most {current_limits().image_pixels} pixels, and 1 or 3"
            )
        _check_inside(f"frame {self.name!r}: file", self.file)
        if self.depth_file is not None:
            _check_inside(f"frame {self.name!r}: depth_file", self.depth_file)
            if self.channels != _COLOUR:
                raise InputError(
                    f"frame {self.name!r} has a depth_file and {self.channels} channel, expected"
                    f" {_COLOUR}"
                )

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of its pixels: (H, W, 3) or (H, W)."""
        return (self.height, self.width, self.channels)[: 3 if self.channels == _COLOUR else 2]

    @property
    def size_bytes(self) -> int:
        """Size of its file."""
        return int(_PIXELS[self.channels].itemsize) * math.prod(self.shape)

    @property
    def pinhole(self) -> PinholeCamera | None:
        """Its camera, for the detector."""
        if self.camera is None:
            return None
        return PinholeCamera(self.width, self.height, **dataclasses.asdict(self.camera))

    @property
    def depth(self) -> KitFrame | None:
        """Its depth as a frame of its own; None if there is none beside the colour."""
        if self.depth_file is None:
            return None
        return dataclasses.replace(self, file=self.depth_file, channels=1, depth_file=None)


@dataclass(frozen=True)
class Kit:
    """The content of kit.json.

    Attributes:
        model: Name of the model file inside the kit.
        model_sha256: Its hash.
        name: Name of the model.
        precision: Precision of the model.
        input_width: Width of the model's input in pixels.
        input_height: Height of the model's input in pixels.
        score_threshold: Trees with a lower score are left out.
        frames: The frames.
        project_version: Version of edgetree that made the model.
        weight_bits: Bits that the weights of an 8-bit model use, see `Manifest`.
        schema: Version of this layout.
    """

    model: str
    model_sha256: str
    name: str
    precision: str
    input_width: _Side
    input_height: _Side
    score_threshold: Annotated[float, Meta(ge=0, le=1)]
    frames: Annotated[tuple[KitFrame, ...], Meta(max_length=MOST_FRAMES)]
    project_version: str
    weight_bits: int | None = None
    schema: str = KIT_SCHEMA

    def __post_init__(self) -> None:
        _check_inside("model", self.model)
        refuse_repeated(frame.name for frame in self.frames)


def _check_inside(what: str, name: str) -> None:
    if not is_inside(name):
        raise InputError(f"{what} is {name!r}, expected a path inside the kit")


def make_kit(
    model: Path, folder: Path, *, score_threshold: float = SCORE_THRESHOLD
) -> tuple[Kit, Results]:
    """Write a kit for a model of this project.

    Args:
        model: a file of `edgetree export`.
        folder: Folder to make or replace; only an empty one or an older kit is replaced.
        score_threshold: Trees with a lower score are left out.

    Returns:
        The kit, and the trees in its frames.

    Raises:
        InputError: The model cannot be used, or the folder cannot be written.
    """
    check_is_file(model)
    if folder.exists() and not (folder.is_dir() and not any(folder.iterdir())):
        try:
            read_kit(folder)
        except InputError as error:
            raise InputError(
                f"{folder} is not empty and not a kit: expected a new folder for the kit"
            ) from error
    reference = Reference(model, score_threshold=score_threshold)
    manifest, content = reference.manifest, model.read_bytes()
    sha256 = hashlib.sha256(content).hexdigest()
    frames: list[KitFrame] = []
    found: list[FrameTrees] = []
    try:
        with writing.replacing_folder(folder) as new:
            (new / _FRAMES).mkdir()
            told = manifest.reach_m is not None and manifest.modality != "rgb"
            for name, pixels, camera in frames_for(manifest.modality, cameras=told):
                frame = dataclasses.replace(_write_frame(new, name, pixels), camera=camera)
                frames.append(frame)
                found.append(reference.detect_with_covered(name, pixels, frame.pinhole))
            kit = Kit(
                _MODEL,
                sha256,
                manifest.name,
                manifest.precision,
                manifest.input.width,
                manifest.input.height,
                score_threshold,
                tuple(frames),
                manifest.project_version,
                manifest.weight_bits,
            )
            expected = reference.results(sha256, tuple(found))
            with replacing(new / _MODEL) as stream:
                stream.write(content)
            with text_file(new / _CONTENT) as text:
                json.dump(dataclasses.asdict(kit), text, indent=1)
            write_results(new / _EXPECTED, expected)
    except OSError as error:
        raise InputError(
            f"{folder} cannot be written ({error.strerror}): expected a folder in an existing,"
            " writable one"
        ) from error
    return kit, expected


def _write_frame(folder: Path, name: str, pixels: FramePixels) -> KitFrame:
    if isinstance(pixels, tuple):
        colour, depth = (
            _write_frame(folder, each, plane)
            for each, plane in zip((name, f"{name}.depth"), pixels, strict=True)
        )
        return dataclasses.replace(colour, depth_file=depth.file)
    channels = pixels.shape[2] if pixels.ndim == 3 else 1
    file = f"{_FRAMES}/{name}.raw"
    with replacing(folder / file) as stream:
        stream.write(pixels.astype(_PIXELS[channels]).tobytes())
    height, width = pixels.shape[:2]
    return KitFrame(name, file, width, height, channels)


def read_kit(folder: Path) -> Kit:
    """Read the content of a kit.

    Raises:
        InputError: The folder is not a kit; the message names the file and the value.
    """
    path = folder / _CONTENT
    expected = "a folder of `edgetree conformance make`"
    if not folder.is_dir():
        raise InputError(f"{folder} is not a folder: expected {expected}")
    return read_json(path, KIT_SCHEMA, Kit, expected)


def read_expected(folder: Path) -> Results:
    """Read the trees that programs must find in the frames of a kit.

    Raises:
        InputError: As for `read_results`.
    """
    path = folder / _EXPECTED
    results = read_results(path)
    for frame in results.frames:
        for each in frame.covered:
            if each.by >= len(frame.trees):
                raise InputError(
                    f"{path}: frame {frame.name!r} has a tree that tree {each.by} covers, expected"
                    f" one of its {len(frame.trees)}, from 0 on"
                )
    return results


def read_frame(folder: Path, frame: KitFrame) -> FramePixels:
    """Read the pixels of a frame: uint8 (H, W, 3) BGR, uint16 (H, W) millimetres, or both.

    Raises:
        InputError: The file is missing or has another size than kit.json says.
    """
    if frame.depth is not None:
        return _read_pixels(folder, frame), _read_pixels(folder, frame.depth)
    return _read_pixels(folder, frame)


def _read_pixels(folder: Path, frame: KitFrame) -> NDArray[Any]:
    path = folder / frame.file
    try:
        if path.exists() and not path.is_file():
            raise InputError(f"{path} is not a regular file: expected pixels")
        with path.open("rb") as stream:
            size = os.fstat(stream.fileno()).st_size
            if size != frame.size_bytes:
                raise InputError(
                    f"{path} has {size} bytes: expected {frame.size_bytes}, as in {_CONTENT}"
                )
            data = stream.read(frame.size_bytes)
    except (OSError, ValueError) as error:  # a name that is not of this system
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"{path} cannot be read ({reason}): expected pixels") from error
    pixels: NDArray[Any] = np.frombuffer(data, _PIXELS[frame.channels]).reshape(frame.shape)
    return pixels


def _sha256(model: Path) -> str:
    try:
        return file_sha256(model)
    except OSError as error:
        raise InputError(
            f"model {model} cannot be read ({error.strerror}): expected an .onnx file"
        ) from error


def run_kit(
    folder: Path, *, provider: str = CPU, threads: int | None = None, rounds: int = 0
) -> Results:
    """Find the trees in the frames of a kit with this package.

    Args:
        folder: The kit.
        provider: What runs the network, a name in `edgetree.runtime.PROVIDERS`.
        threads: Threads of one inference; None for all usable cores.
        rounds: Passes over the frames that are timed; 0 for no times.

    Raises:
        InputError: The kit cannot be read, its model is another one than kit.json says, or the
            provider cannot be used.
    """
    kit = read_kit(folder)
    model = folder / kit.model
    check_is_file(model)
    if (sha256 := _sha256(model)) != kit.model_sha256:
        raise InputError(
            f"{model} has the SHA-256 {sha256[:12]}..., and {_CONTENT} says"
            f" {kit.model_sha256[:12]}...: expected the model that the kit was made of; make a kit"
            " of each model"
        )
    reference = Reference(
        model,
        score_threshold=kit.score_threshold,
        provider=provider,
        threads=threads,
    )
    found = [
        FrameTrees(
            frame.name, found_trees(reference.detect(read_frame(folder, frame), frame.pinhole))
        )
        for frame in kit.frames
    ]
    times_ms = []
    for frame in kit.frames * rounds:
        image = read_frame(folder, frame)
        begin = time.perf_counter()
        reference.detect(image, frame.pinhole)
        times_ms.append((time.perf_counter() - begin) * 1e3)
    median_ms = statistics.median(times_ms) if times_ms else None
    return reference.results(kit.model_sha256, tuple(found), median_ms)
