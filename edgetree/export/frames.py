"""Read frames and prepare them as input of a model, for calibration and verification."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

import calib
from basetree.arrays import UInt8
from basetree.errors import InputError
from basetree.files.names import IMAGE_SUFFIXES
from basetree.files.regular import read_regular
from edgetree.frames.images import read_image

if TYPE_CHECKING:
    from perceptree.models import ModelSpec

_CALIBRATION_FRAMES: Final = 64
_DATASET_FOLDERS = {"rgb": "images", "depth": "depth"}


def input_shape(spec: ModelSpec) -> tuple[int, ...]:
    """Shape of one frame as input of a model: (H, W, 3) for `rgb`, (H, W) for `depth`."""
    return (spec.height, spec.width, 3)[: 3 if spec.modality == "rgb" else 2]


def prepare_frame(image: NDArray[Any], spec: ModelSpec) -> UInt8:
    """Encode and letterbox a frame of any size.

    Args:
        image: (h, w, 3) uint8 BGR, or (h, w) float depth in metres.
        spec: Model with input size, padding and depth encoding.

    Returns:
        uint8 frame of `input_shape(spec)`.
    """
    if spec.depth_encoding is not None:
        encoding = calib.DepthEncoding.from_dict(dict(spec.depth_encoding))
        image = calib.encode_depth(image, encoding)
    height, width = image.shape[:2]
    return calib.Letterbox.fit(width, height, spec.width, spec.height).apply(image, spec.pad_value)


def find_frames(folder: Path, modality: str, most: int, *, test_split: bool = False) -> list[Path]:
    """Find at most `most` frames of a folder, evenly spread over its sorted names.

    Args:
        folder: a dataset, with its frames in `images` or `depth` or where its label files name
            them, or a folder of images, or one label file. Depth frames are 16-bit PNG files in
            millimetres.
        modality: `rgb` or `depth`.
        most: Largest number of frames.
        test_split: Take only frames of the dataset's test split, or of `val`, if it has one. No
            model was trained on these.

    Raises:
        InputError: The folder does not exist or holds no images.
    """
    if not folder.exists():
        raise InputError(f"{folder} is no folder: expected one with {modality} frames")
    paths = _pictures(folder, modality, test_split) if folder.is_dir() else []
    paths = paths or _labelled_frames(folder, modality, test_split=test_split)
    if not paths:
        suffixes = ", ".join(_suffixes(modality))
        raise InputError(f"{folder} has no {modality} frames: expected {suffixes}")
    count = min(most, len(paths))
    return [paths[i * len(paths) // count] for i in range(count)]


def _suffixes(modality: str) -> tuple[str, ...]:
    return IMAGE_SUFFIXES if modality == "rgb" else (".png",)


def _pictures(folder: Path, modality: str, test_split: bool) -> list[Path]:
    """The pictures in a folder, or in its folder of the modality."""
    subfolder = folder / _DATASET_FOLDERS[modality]
    images = subfolder if subfolder.is_dir() else folder
    suffixes = _suffixes(modality)
    paths = sorted(path for path in images.iterdir() if path.suffix.lower() in suffixes)
    chosen = _test_split_names(folder) if test_split else frozenset()
    return [path for path in paths if path.stem in chosen] or paths


def _labelled_frames(folder: Path, modality: str, *, test_split: bool) -> list[Path]:
    """The frames of a dataset in any layout of `perceptree.data`; none if it has no labels.

    Args:
        folder: The dataset.
        modality: `rgb` or `depth`.
        test_split: Take only the test split, without one only `val`, without both only `train`.
    """
    from perceptree.data.dataset import read_labels
    from perceptree.data.layouts import find_splits
    from perceptree.errors import DatasetError

    try:
        splits = find_splits(folder)  # in the order train, val, test
    except DatasetError:
        return []
    frames = [
        frame
        for labels in splits[-1 if test_split else 0 :]
        for frame in read_labels(labels).frames
    ]
    paths = [frame.image_path if modality == "rgb" else frame.depth_path for frame in frames]
    return sorted(path for path in paths if path is not None)


def _test_split_names(folder: Path) -> frozenset[str]:
    """Names without suffix of the frames in a dataset's test split, or without one in `val`."""
    files = (folder / f"{split}_RGB.json" for split in ("test", "val"))
    path = next((path for path in files if path.is_file()), None)
    if path is None:
        return frozenset()
    try:
        images = json.loads(read_regular(path))["images"]
        return frozenset(Path(image["file_name"]).stem for image in images)
    except (OSError, ValueError, LookupError, TypeError, RecursionError) as error:
        raise InputError(f"{path}: not a COCO file ({error!r:.200}), expected images") from error


def read_frames(paths: Sequence[Path], spec: ModelSpec) -> UInt8:
    """Read and prepare frames: (N, H, W, 3) or (N, H, W) uint8, see `prepare_frame`."""
    read = read_image if spec.modality == "rgb" else calib.read_depth
    return np.stack([prepare_frame(read(path), spec) for path in paths])


def read_calibration_frames(folder: Path, spec: ModelSpec, *, exclude: Sequence[Path]) -> UInt8:
    """Read frames for calibration: (N, H, W, 3) or (N, H, W) uint8, at most 64.

    Args:
        folder: a dataset or a folder of images, see `find_frames`.
        spec: Model with input size, padding and depth encoding.
        exclude: Files not to use.

    Raises:
        InputError: The folder has no other frames.
    """
    excluded = {path.resolve() for path in exclude}
    found = find_frames(folder, spec.modality, _CALIBRATION_FRAMES + len(excluded))
    paths = [path for path in found if path.resolve() not in excluded][:_CALIBRATION_FRAMES]
    if not paths:
        raise InputError(
            f"folder {folder} has no frames beside those compared on: expected some to calibrate on"
        )
    return read_frames(paths, spec)


def sample_inputs(spec: ModelSpec) -> UInt8:
    """The sample frames of the package, prepared like `read_frames`."""
    from edgetree.samples import sample_frames

    samples = sample_frames()
    images = (s.image() if spec.modality == "rgb" else s.depth_m() for s in samples)
    return np.stack([prepare_frame(image, spec) for image in images])


def edge_case_frames(spec: ModelSpec, real: UInt8) -> dict[str, UInt8]:
    """Edge cases by name: a frame with much padding, a blank frame, and noise.

    Args:
        spec: Model with input size and padding.
        real: (N, H, W, 3) or (N, H, W) prepared frames. The left half of the first one is
            letterboxed for the case `padded`.
    """
    shape = input_shape(spec)
    half = real[0][:, : spec.width // 2]
    fit = calib.Letterbox.fit(half.shape[1], half.shape[0], spec.width, spec.height)
    return {
        "padded": fit.apply(half, spec.pad_value),
        "blank": np.full(shape, spec.pad_value, np.uint8),
        "noise": np.random.default_rng(0).integers(0, 256, shape, dtype=np.uint8),
    }


def frames_sha256(frames: UInt8) -> str:
    """SHA-256 of the pixels of prepared frames, as a hexadecimal string."""
    return hashlib.sha256(np.ascontiguousarray(frames).tobytes()).hexdigest()
