"""Real frames as a model takes them: for calibration, and for comparing a file with its model."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

import calib
from edgetree.errors import InputError
from edgetree.frames.sources import IMAGE_SUFFIXES, read_image

if TYPE_CHECKING:
    from perceptree.models import ModelSpec

__all__ = [
    "InputRules",
    "find_frames",
    "frames_sha256",
    "probe_frames",
    "read_frames",
    "sample_inputs",
]

_DATASET_FOLDERS = {"rgb": "images", "depth": "depth"}


@dataclass(frozen=True)
class InputRules:
    """How a frame becomes a model's input: size in px, padding, and the depth encoding."""

    modality: str
    height: int
    width: int
    pad_value: int
    depth_encoding: dict[str, Any] | None

    @classmethod
    def of(cls, spec: ModelSpec) -> InputRules:
        """The rules in a model spec."""
        encoding = spec.depth_encoding
        return cls(
            spec.modality,
            spec.height,
            spec.width,
            spec.pad_value,
            None if encoding is None else dict(encoding),
        )

    @property
    def image_shape(self) -> tuple[int, ...]:
        """(H, W, 3) or (H, W)."""
        return (self.height, self.width, 3)[: 3 if self.modality == "rgb" else 2]

    def prepare(self, image: NDArray[Any]) -> NDArray[np.uint8]:
        """A frame of any size, BGR or metres -> uint8 of ``image_shape``, letterboxed."""
        if self.depth_encoding is not None:
            encoding = calib.DepthEncoding.from_dict(self.depth_encoding)
            image = calib.encode_depth(image, encoding)
        height, width = image.shape[:2]
        fit = calib.Letterbox.fit(width, height, self.width, self.height)
        return fit.apply(image, self.pad_value)


def find_frames(folder: Path, modality: str, most: int, *, unseen: bool = False) -> list[Path]:
    """At most ``most`` frames of a folder, evenly spread over its sorted names.

    A folder of the data set's form is entered (``images`` or ``depth``); any other holds the
    images themselves, for depth 16-bit PNGs in millimetres. ``unseen`` takes a data set's frames
    from its test split, where it has one: no model was trained on them.

    Raises:
        InputError: no such folder, or no images in it.
    """
    if not folder.is_dir():
        raise InputError(f"{folder} is no folder: expected one with {modality} frames")
    inner = folder / _DATASET_FOLDERS[modality]
    place = inner if inner.is_dir() else folder
    suffixes = IMAGE_SUFFIXES if modality == "rgb" else (".png",)
    paths = sorted(path for path in place.iterdir() if path.suffix.lower() in suffixes)
    tested = _test_names(folder) if unseen else frozenset()
    paths = [path for path in paths if path.stem in tested] or paths
    if not paths:
        raise InputError(f"folder {place} has no {modality} frames: expected {', '.join(suffixes)}")
    count = min(most, len(paths))
    return [paths[i * len(paths) // count] for i in range(count)]


def _test_names(folder: Path) -> frozenset[str]:
    """Stems of the frames in a data set's test split; none without one."""
    path = folder / "test_RGB.json"
    if not path.is_file():
        return frozenset()
    try:
        images = json.loads(path.read_text(encoding="utf-8"))["images"]
        return frozenset(Path(image["file_name"]).stem for image in images)
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(f"{path}: not a COCO file ({error!r}), expected images in it") from error


def read_frames(paths: Sequence[Path], rules: InputRules) -> NDArray[np.uint8]:
    """(N, H, W, 3) or (N, H, W) uint8, ready for the model."""
    read = read_image if rules.modality == "rgb" else calib.read_depth
    return np.stack([rules.prepare(read(path)) for path in paths])


def sample_inputs(rules: InputRules) -> NDArray[np.uint8]:
    """The package's sample frames, as :func:`read_frames` gives others."""
    from edgetree.samples import sample_frames

    samples = sample_frames()
    images = (s.image() if rules.modality == "rgb" else s.depth_m() for s in samples)
    return np.stack([rules.prepare(image) for image in images])


def probe_frames(rules: InputRules, real: NDArray[np.uint8]) -> dict[str, NDArray[np.uint8]]:
    """Frames that only an odd day brings: another aspect, an empty one, and noise.

    The other aspect is the left half of the first real frame, letterboxed.
    """
    shape = rules.image_shape
    half = real[0][:, : rules.width // 2]
    fit = calib.Letterbox.fit(half.shape[1], half.shape[0], rules.width, rules.height)
    odd = fit.apply(half, rules.pad_value)
    noise = np.random.default_rng(0).integers(0, 256, shape, dtype=np.uint8)
    return {
        "padded": odd,
        "blank": np.full(shape, rules.pad_value, np.uint8),
        "noise": noise,
    }


def frames_sha256(frames: NDArray[np.uint8]) -> str:
    """Hash of prepared frames."""
    return hashlib.sha256(np.ascontiguousarray(frames).tobytes()).hexdigest()
