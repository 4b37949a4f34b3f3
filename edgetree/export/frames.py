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
_ALL: Final = 1_000_000
ALONE: Final = ("colour", "depth")
_FRAMES_ALONE: Final = 8
_DATASET_FOLDERS = {"rgb": "images", "depth": "depth"}


def prepare_frame(image: NDArray[Any], spec: ModelSpec) -> UInt8:
    """Encode and letterbox a frame of any size.

    Args:
        image: (h, w, 3) uint8 BGR, or (h, w) float depth in metres.
        spec: Model with input size, padding and depth encoding.

    Returns:
        uint8 frame of the spec's `image_shape`.
    """
    return _letterboxed(image if spec.depth_encoding is None else _encoded(image, spec), spec)


def prepare_pair(image: NDArray[Any], depth_m: NDArray[Any], spec: ModelSpec) -> UInt8:
    """Encode and letterbox a frame of colour and depth, which have one size.

    Args:
        image: (h, w, 3) uint8 BGR.
        depth_m: (h, w) float depth in metres.
        spec: Model of both inputs.

    Returns:
        (H, W, 4) uint8 with the depth as the last channel.

    Raises:
        InputError: The two have different sizes.
    """
    if image.shape[:2] != depth_m.shape:
        sizes = [f"{each.shape[1]}x{each.shape[0]} px" for each in (image, depth_m)]
        raise InputError(f"colour is {sizes[0]} and depth {sizes[1]}: expected one size")
    return _letterboxed(np.dstack([image, _encoded(depth_m, spec)]), spec)


def _encoded(depth_m: NDArray[Any], spec: ModelSpec) -> UInt8:
    encoding = calib.DepthEncoding.from_dict(dict(spec.depth_encoding or {}))
    return calib.encode_depth(depth_m, encoding)


def _letterboxed(image: UInt8, spec: ModelSpec) -> UInt8:
    height, width = image.shape[:2]
    return calib.Letterbox.fit(width, height, spec.width, spec.height).apply(image, spec.pad_values)


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
        return _names_of_last_split(folder)
    try:
        images = json.loads(read_regular(path))["images"]
        return frozenset(Path(image["file_name"]).stem for image in images)
    except (OSError, ValueError, LookupError, TypeError, RecursionError) as error:
        raise InputError(f"{path}: not a COCO file ({error!r:.200}), expected images") from error


def _names_of_last_split(folder: Path) -> frozenset[str]:
    """The same by label files of other layouts; none if they do not divide the pictures."""
    from perceptree.data.dataset import read_labels
    from perceptree.data.layouts import find_splits
    from perceptree.errors import DatasetError

    try:
        splits = find_splits(folder)  # in the order train, val, test
        frames = read_labels(splits[-1]).frames if len(splits) > 1 else []
    except DatasetError:
        return frozenset()
    return frozenset(frame.image_path.stem for frame in frames)


def find_views(
    folder: Path, modality: str, most: int, *, test_split: bool = False
) -> list[tuple[Path, ...]]:
    """Find at most `most` frames as the files of their images, as `find_frames` does.

    Of `both` these are colour and depth, which belong together by their names without suffix.

    Raises:
        InputError: The folder does not exist, holds no images, or no pair of them.
    """
    if modality != "both":
        return [(path,) for path in find_frames(folder, modality, most, test_split=test_split)]
    colour, depth = (
        find_frames(folder, kind, _ALL, test_split=test_split) for kind in ("rgb", "depth")
    )
    depth_of = {path.stem: path for path in depth}
    pairs = [(path, depth_of[path.stem]) for path in colour if path.stem in depth_of]
    if not pairs:
        raise InputError(
            f"folder {folder} has no pairs of colour and depth: expected files of the same names"
        )
    count = min(most, len(pairs))
    return [pairs[i * len(pairs) // count] for i in range(count)]


def read_frames(views: Sequence[Path | tuple[Path, ...]], spec: ModelSpec) -> UInt8:
    """Read and prepare frames.

    Args:
        views: The file of each frame, or its files as in `find_views`.
        spec: Model with input size, padding and depth encoding.

    Returns:
        (N, H, W, 3), (N, H, W) or (N, H, W, 4) uint8, see `prepare_frame` and `prepare_pair`.
    """
    return np.stack([_read(view if isinstance(view, tuple) else (view,), spec) for view in views])


def _read(view: tuple[Path, ...], spec: ModelSpec) -> UInt8:
    if spec.modality == "both":
        colour, depth = view
        try:
            return prepare_pair(read_image(colour), calib.read_depth(depth), spec)
        except InputError as error:
            raise InputError(f"{colour}: {error}") from error
    read = read_image if spec.modality == "rgb" else calib.read_depth
    return prepare_frame(read(view[0]), spec)


def read_calibration_frames(folder: Path, spec: ModelSpec, *, exclude: Sequence[Path]) -> UInt8:
    """Read frames for calibration: at most 64, as `read_frames` gives them.

    Of colour and depth, some frames show only one of the two.

    Args:
        folder: a dataset or a folder of images, see `find_frames`.
        spec: Model with input size, padding and depth encoding.
        exclude: Files not to use.

    Raises:
        InputError: The folder has no other frames.
    """
    excluded = {path.resolve() for path in exclude}
    found = find_views(folder, spec.modality, _CALIBRATION_FRAMES + len(excluded))
    views = [view for view in found if view[0].resolve() not in excluded][:_CALIBRATION_FRAMES]
    if not views:
        raise InputError(
            f"folder {folder} has no frames beside those compared on: expected some to calibrate on"
        )
    frames = read_frames(views, spec)
    if spec.modality == "both":
        for first, alone in enumerate(ALONE):
            frames[first :: 2 * len(ALONE)] = only(alone, frames[first :: 2 * len(ALONE)], spec)
    return frames


def only(alone: str, frames: UInt8, spec: ModelSpec) -> UInt8:
    """Frames of colour and depth with nothing in one of the two.

    Args:
        alone: What stays, `colour` or `depth`.
        frames: (..., H, W, 4) uint8.
        spec: Model of both inputs.
    """
    changed = frames.copy()
    if alone == "depth":
        changed[..., :3] = 0
    else:
        changed[..., 3] = int((spec.depth_encoding or {})["invalid_value"])
    return changed


def sample_inputs(spec: ModelSpec) -> UInt8:
    """The sample frames of the package, prepared like `read_frames`."""
    from edgetree.samples import sample_frames

    samples = sample_frames()
    if spec.modality == "both":
        return np.stack([prepare_pair(each.image(), each.depth_m(), spec) for each in samples])
    images = (s.image() if spec.modality == "rgb" else s.depth_m() for s in samples)
    return np.stack([prepare_frame(image, spec) for image in images])


def edge_case_frames(spec: ModelSpec, real: UInt8) -> dict[str, UInt8]:
    """Edge cases by name: a frame with much padding, a blank frame, and noise.

    Of colour and depth also the first frames with one of the two alone.

    Args:
        spec: Model with input size and padding.
        real: Prepared frames. The left half of the first one is letterboxed for the case `padded`.
    """
    half = real[0][:, : spec.width // 2]
    fit = calib.Letterbox.fit(half.shape[1], half.shape[0], spec.width, spec.height)
    cases = {
        "padded": fit.apply(half, spec.pad_values),
        "blank": np.full(spec.image_shape, spec.pad_values, np.uint8),
        "noise": np.random.default_rng(0).integers(0, 256, spec.image_shape, dtype=np.uint8),
    }
    if spec.modality == "both":
        for alone in ALONE:
            shown = only(alone, real[:_FRAMES_ALONE], spec)
            cases |= {f"{alone} alone {number}": frame for number, frame in enumerate(shown)}
    return cases


def frames_sha256(frames: UInt8) -> str:
    """SHA-256 of the pixels of prepared frames, as a hexadecimal string."""
    return hashlib.sha256(np.ascontiguousarray(frames).tobytes()).hexdigest()
