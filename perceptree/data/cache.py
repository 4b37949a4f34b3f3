"""On-disk cache of decoded, letterboxed frames, memory-mapped for training.

A cache is a folder of plain arrays, written completely or not at all. Its key is a hash of the
labels and image files, so a change of either rebuilds it. Each frame has a checksum that is
verified when the frame is read.
"""

from __future__ import annotations

import hashlib
import json
import tokenize
import zlib
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from basetree.arrays import Bool, UInt8
from basetree.files.writing import replacing_folder
from perceptree.data.coco import FrameRecord
from perceptree.data.frames import Sample, load_sample, source_path, source_paths
from perceptree.errors import DatasetError
from perceptree.models import ModelSpec

_VERSION = 2
# Of what the key holds. States of trainings hold the key, so it outlives the layout of the folder.
_KEY_VERSION = 1
_RECORD = "cache.json"
_IMAGES, _MASKS = "images.bin", "masks.bin"
# dtype and row shape of each array.
_ARRAYS: dict[str, tuple[type[np.generic], tuple[int, ...]]] = {
    "boxes": (np.float32, (4,)),
    "keypoints": (np.float32, (5, 3)),
    "tree_starts": (np.int64, ()),
    "ignored": (np.float32, (4,)),
    "ignored_starts": (np.int64, ()),
    "mask_rects": (np.int32, (4,)),
    "mask_starts": (np.int64, ()),
    "checksums": (np.uint32, ()),
}
_PREFETCH = 16
# What numpy and the record's reader raise for files that are none.
_DAMAGED = (
    *(OSError, ValueError, LookupError, TypeError, ArithmeticError, EOFError, RecursionError),
    *(SyntaxError, tokenize.TokenError, MemoryError),
)

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Skipped:
    """A frame that was left out.

    Attributes:
        name: The image file's name.
        reason: Why it was left out.
    """

    name: str
    reason: str


class FrameCache:
    """The cached frames of a split; create it with `open_cache`."""

    def __init__(self, folder: Path) -> None:
        record = json.loads((folder / _RECORD).read_text("utf-8"))
        self.folder = folder
        self.key: str = record["key"]
        self.names: list[str] = record["names"]
        self.skipped = [Skipped(**entry) for entry in record["skipped"]]
        self.has_masks: bool = record["has_masks"]
        self.exact: bool = record.get("exact", False)
        self._images = _memory_map(folder / _IMAGES).reshape(-1, *record["image_shape"])
        self._masks = _memory_map(folder / _MASKS)
        arrays: dict[str, NDArray[Any]] = {
            name: np.load(folder / f"{name}.npy", mmap_mode="r") for name in _ARRAYS
        }
        self._boxes, self._keypoints = arrays["boxes"], arrays["keypoints"]
        self._tree_starts, self._checksums = arrays["tree_starts"], arrays["checksums"]
        self._mask_rects, self._mask_starts = arrays["mask_rects"], arrays["mask_starts"]
        self._ignored, self._ignored_starts = arrays["ignored"], arrays["ignored_starts"]
        self._check(arrays)

    def _check(self, arrays: dict[str, NDArray[Any]]) -> None:
        """Raise ValueError if arrays have other shapes than those that were written."""
        for name, (kind, row) in _ARRAYS.items():
            if arrays[name].dtype != kind or arrays[name].shape[1:] != row:
                raise ValueError(f"{name} has another form")
        frames, trees, ignored = len(self._images), len(self._boxes), len(self._ignored)
        if not isinstance(self.has_masks, bool) or not isinstance(self.exact, bool):
            raise ValueError("has_masks or exact is not true or false")
        if len(self.names) != frames or len(self._checksums) != frames:
            raise ValueError("names and checksums are not those of the images")
        if not len(self._keypoints) == len(self._mask_rects) == trees:
            raise ValueError("keypoints and masks are not those of the boxes")
        for starts, count, end in (
            (self._tree_starts, frames, trees),
            (self._ignored_starts, frames, ignored),
            (self._mask_starts, trees, len(self._masks)),
        ):
            if len(starts) != count + 1 or starts[0] != 0 or starts[-1] != end:
                raise ValueError("the rows do not begin and end where the arrays do")
            if (np.diff(starts) < 0).any():
                raise ValueError("the rows are not in order")

    def __len__(self) -> int:
        return len(self.names)

    @property
    def trees(self) -> int:
        """Number of labelled trees."""
        return len(self._boxes)

    def __getitem__(self, index: int) -> Sample:
        """Return frame `index`.

        Raises:
            DatasetError: If the frame's bytes do not match their checksum.
        """
        image = np.array(self._images[index])
        rows = slice(*self._tree_starts[index : index + 2].tolist())
        packed = np.array(self._masks[slice(*self._mask_starts[[rows.start, rows.stop]].tolist())])
        if zlib.crc32(packed.tobytes(), zlib.crc32(image.tobytes())) != self._checksums[index]:
            raise DatasetError(
                f"{self.folder}: the cached frame {self.names[index]} does not match its checksum;"
                " expected an undamaged cache: remove the folder to rebuild it"
            )
        masks = self._unpack(rows, packed, image.shape[:2]) if self.has_masks else None
        boxes, keypoints = self._boxes[rows].copy(), self._keypoints[rows].copy()
        ignored = self._ignored[slice(*self._ignored_starts[index : index + 2].tolist())].copy()
        return Sample(image, boxes, keypoints, masks, ignored, self.exact)

    def image(self, index: int) -> UInt8:
        """Return the image of frame `index`, as a `Sample` has it, without checking it."""
        return np.array(self._images[index])

    def _unpack(self, rows: slice, packed: UInt8, shape: tuple[int, ...]) -> Bool:
        masks = np.zeros((rows.stop - rows.start, *shape), bool)
        start = 0
        for mask, (x0, y0, x1, y1) in zip(masks, self._mask_rects[rows].tolist(), strict=True):
            bits = (y1 - y0) * (x1 - x0)
            part = np.unpackbits(packed[start : start + -(-bits // 8)], count=bits)
            mask[y0:y1, x0:x1] = part.reshape(y1 - y0, x1 - x0)
            start += -(-bits // 8)
        return masks


def _memory_map(path: Path) -> UInt8:
    """Map a file to memory as bytes; the file may be empty."""
    return np.memmap(path, np.uint8, "r") if path.stat().st_size else np.zeros(0, np.uint8)


def open_cache(
    frames: Sequence[FrameRecord],
    spec: ModelSpec,
    folder: Path,
    skip_broken: bool = False,
    progress: Progress = lambda done, total: None,
) -> FrameCache:
    """Open the cache of some frames; build it if it is missing or out of date.

    Args:
        frames: Frames of a split.
        spec: Model whose input size and modality the frames are prepared for.
        folder: Folder of the cache.
        skip_broken: Leave out frames whose files are missing or broken and list them in
            `skipped`, instead of raising an error.
        progress: Called with the number of frames done and the total while building.

    Raises:
        DatasetError: If a frame is missing or broken, or the folder cannot be written.
    """
    key = frames_key(frames, spec, skip_broken)
    try:
        cache = read_cache(folder) if _key_in(folder) == key else None
        if cache is None:
            _build(frames, spec, folder, key, skip_broken, progress)
            cache = FrameCache(folder)
        return cache
    except OSError as error:
        path = error.filename or folder
        raise DatasetError(
            f"{path}: cannot be written ({error.strerror or error}); expected a folder with"
            " space for the decoded frames, or another folder with --cache"
        ) from error


def frames_key(frames: Sequence[FrameRecord], spec: ModelSpec, skip_broken: bool) -> str:
    """Hash the labels, the image files' sizes and modification times, and the input format.

    Raises:
        DatasetError: If a frame has no depth image that the model reads, unless `skip_broken`.
    """
    form = [
        _KEY_VERSION,
        spec.modality,
        spec.height,
        spec.width,
        spec.pad_values,
        spec.depth_encoding,
    ]
    digest = hashlib.sha256(json.dumps([*form, skip_broken]).encode())
    for frame in frames:
        try:
            paths = source_paths(frame, spec.modality)
        except DatasetError:
            if not skip_broken:
                raise
            paths = ()
        stamp = [part for each in paths for part in _stamp(each)]
        name = paths[0].name if paths else None
        identity = [name, frame.width, frame.height, frame.extra.get("depth_encoding"), *stamp]
        identity += [frame.exact_stride_px] * frame.reads_exact(spec.modality)
        digest.update(json.dumps(identity).encode())
        for tree in frame.trees:
            digest.update(tree.box_px.tobytes() + tree.keypoints.tobytes())
            kind = "ignored" if tree.ignored else False
            digest.update(repr((kind, tree.segmentation)).encode())
    return digest.hexdigest()


def _stamp(path: Path) -> list[int]:
    """Size and modification time of a file; nothing of one that is missing."""
    try:
        status = path.stat()
    except OSError:
        return []
    return [status.st_size, status.st_mtime_ns]


def read_cache(folder: Path) -> FrameCache | None:
    """Read the cache in a folder; None if it is missing or damaged."""
    try:
        return FrameCache(folder)
    except _DAMAGED:
        return None


def _key_in(folder: Path) -> str | None:
    """Return the key of a cache of this layout; None for any other folder."""
    try:
        record = json.loads((folder / _RECORD).read_text("utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
    if not isinstance(record, dict) or record.get("version") != _VERSION:
        return None
    return record.get("key")


def _build(
    frames: Sequence[FrameRecord],
    spec: ModelSpec,
    folder: Path,
    key: str,
    skip_broken: bool,
    progress: Progress,
) -> None:
    """Write to a temporary folder next to `folder`, then rename it."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    with replacing_folder(folder) as partial_folder:
        writer = _Writer(partial_folder, spec)
        for done, (frame, outcome) in enumerate(load_in_order(frames, spec), start=1):
            try:
                writer.add(source_path(frame, spec.modality).name, outcome.result())
            except DatasetError as error:
                if not skip_broken:
                    raise
                writer.skipped.append(Skipped(frame.image_path.name, str(error)))
            progress(done, len(frames))
        writer.finish(key)


def load_in_order(
    frames: Sequence[FrameRecord], spec: ModelSpec
) -> Iterator[tuple[FrameRecord, Future[Sample]]]:
    """Yield frames with their samples, in order, decoding a few ahead."""
    with ThreadPoolExecutor() as pool:
        remaining = iter(frames)
        pending = [(f, pool.submit(load_sample, f, spec)) for f in islice(remaining, _PREFETCH)]
        while pending:
            first = pending.pop(0)
            pending += [(f, pool.submit(load_sample, f, spec)) for f in islice(remaining, 1)]
            yield first


class _Writer:
    """Appends samples to the arrays of a cache."""

    def __init__(self, folder: Path, spec: ModelSpec) -> None:
        self._folder = folder
        self._shape = list(spec.image_shape)
        self._images = (folder / _IMAGES).open("wb")
        self._masks = (folder / _MASKS).open("wb")
        self._names: list[str] = []
        self._rows: dict[str, list[Any]] = {name: [] for name in _ARRAYS}
        self._rows["tree_starts"].append(0)
        self._rows["mask_starts"].append(0)
        self._rows["ignored_starts"].append(0)
        self._has_masks, self._exact = True, False
        self.skipped: list[Skipped] = []

    def add(self, name: str, sample: Sample) -> None:
        """Append a frame."""
        self._images.write(sample.image.tobytes())
        packed = b"".join(map(self._pack, sample.masks if sample.masks is not None else ()))
        if sample.masks is None:
            self._has_masks = False
            for _ in sample.boxes:
                self._pack(np.zeros((1, 1), bool))
        self._masks.write(packed)
        self._names.append(name)
        self._exact = sample.exact
        self._rows["checksums"].append(zlib.crc32(packed, zlib.crc32(sample.image.tobytes())))
        self._rows["boxes"] += list(sample.boxes.astype(np.float32))
        self._rows["keypoints"] += list(sample.keypoints.astype(np.float32))
        self._rows["tree_starts"].append(len(self._rows["boxes"]))
        self._rows["ignored"] += list(sample.ignored.astype(np.float32))
        self._rows["ignored_starts"].append(len(self._rows["ignored"]))

    def _pack(self, mask: Bool) -> bytes:
        """Pack the bits of a mask inside its bounding rectangle; record the rectangle."""
        columns, rows = np.nonzero(mask.any(0))[0], np.nonzero(mask.any(1))[0]
        rect = (columns[0], rows[0], columns[-1] + 1, rows[-1] + 1) if len(rows) else (0, 0, 0, 0)
        packed = np.packbits(mask[rect[1] : rect[3], rect[0] : rect[2]]).tobytes()
        self._rows["mask_rects"].append(rect)
        self._rows["mask_starts"].append(self._rows["mask_starts"][-1] + len(packed))
        return packed

    def finish(self, key: str) -> None:
        """Close the files and write the index, which completes the cache."""
        self._images.close()
        self._masks.close()
        for name, (kind, row) in _ARRAYS.items():
            np.save(
                self._folder / f"{name}.npy", np.array(self._rows[name], kind).reshape(-1, *row)
            )
        record = {
            "version": _VERSION,
            "key": key,
            "names": self._names,
            "image_shape": self._shape,
            "has_masks": self._has_masks,
            "exact": self._exact,
            "skipped": [vars(entry) for entry in self.skipped],
        }
        (self._folder / _RECORD).write_text(json.dumps(record), "utf-8")
