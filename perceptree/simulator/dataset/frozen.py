"""Frozen test sets: their expected files, and the comparison of a dataset with them."""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
from dataclasses import asdict, dataclass
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from basetree.files.regular import read_regular
from perceptree.errors import DatasetError
from perceptree.simulator.dataset.plan import settings_sha256
from perceptree.simulator.dataset.splits import SPLITS
from perceptree.simulator.dataset.storage import FRAME_FOLDERS
from perceptree.simulator.settings.presets import PRESETS

FROZEN_PRESETS = ("test", "field-test")

_OCCLUSION_BINS = 10
_TOLERANCE = 0.01
_DIGEST_LENGTH = 8
_LIBRARIES = ("numpy", "opencv-python-headless", "numba")


@dataclass(frozen=True)
class FrozenSet:
    """Expected values of a frozen test set.

    Attributes:
        name: Name of the preset.
        seed: Seed of the dataset.
        frames: Number of frames.
        settings_sha256: Hash of settings, seed and file formats.
        content_sha256: Hash of all images, depth maps and COCO files.
        trees_per_frame: Mean number of labelled trees per frame.
        occlusion: Fraction of trees by visible fraction, in ten equal bins from 0 to 1.
        files: By folder, the first 8 hexadecimal digits of each file's SHA-256, concatenated in
            the order of the file names.
        versions: Versions of the libraries that made it.
    """

    name: str
    seed: int
    frames: int
    settings_sha256: str
    content_sha256: str
    trees_per_frame: float
    occlusion: list[float]
    files: dict[str, str]
    versions: dict[str, str]

    def to_json(self) -> str:
        """Make the content of the file in the package."""
        return json.dumps(asdict(self), indent=1) + "\n"


@dataclass(frozen=True)
class Comparison:
    """Comparison of a dataset with a frozen test set.

    Attributes:
        files: Number of files.
        differing: Number of files that differ.
        complaints: Label statistics that differ by more than 1 %.
    """

    files: int
    differing: int
    complaints: list[str]


def frozen_file(name: str) -> str:
    """Name of the package file with the values of a frozen preset."""
    return f"frozen_{name.replace('-', '_')}.json"


def read_frozen(name: str) -> FrozenSet:
    """Read the values of one of FROZEN_PRESETS from the package."""
    path = resources.files("perceptree.simulator.settings").joinpath(frozen_file(name))
    return FrozenSet(**json.loads(path.read_text("utf-8")))


def preset_sha256(name: str) -> str:
    """Hash the current settings, seed and file formats of a preset."""
    preset = PRESETS[name]
    return settings_sha256(preset.settings, preset.seed, preset.files)


def content_sha256(directory: Path) -> str:
    """Hash names and contents of all images, depth maps and COCO files, in sorted order."""
    content = hashlib.sha256()
    for name, digest in _digests(directory):
        content.update(f"{name} {digest}\n".encode())
    return content.hexdigest()


def describe_dataset(directory: Path, name: str) -> FrozenSet:
    """Compute the values of a dataset that was made by a preset.

    Args:
        directory: Folder of the dataset.
        name: Name of the preset.

    Raises:
        DatasetError: If the dataset has no labelled trees.
    """
    preset = PRESETS[name]
    trees_per_frame, occlusion = _label_figures(directory)
    return FrozenSet(
        preset.name,
        preset.seed,
        preset.frames,
        preset_sha256(name),
        content_sha256(directory),
        trees_per_frame,
        occlusion,
        _short_digests(directory),
        library_versions(),
    )


def compare_with_frozen(directory: Path, frozen: FrozenSet) -> Comparison:
    """Compare a dataset with a frozen test set.

    Args:
        directory: Folder of the dataset.
        frozen: The frozen test set.

    Raises:
        DatasetError: If the dataset has no labelled trees.
    """
    if content_sha256(directory) == frozen.content_sha256:
        return Comparison(_count(frozen.files), 0, [])
    found = _short_digests(directory)
    differing = sum(
        _differing(found.get(folder, ""), frozen.files.get(folder, ""))
        for folder in sorted(set(found) | set(frozen.files))
    )
    trees_per_frame, occlusion = _label_figures(directory)
    complaints = []
    if abs(trees_per_frame - frozen.trees_per_frame) > _TOLERANCE * frozen.trees_per_frame:
        complaints.append(
            f"{trees_per_frame:.3f} trees a frame, expected {frozen.trees_per_frame:.3f}"
        )
    for number, (share, expected) in enumerate(zip(occlusion, frozen.occlusion, strict=True)):
        if abs(share - expected) > _TOLERANCE:
            complaints.append(
                f"{100 * share:.1f} % of the trees are visible to {number / _OCCLUSION_BINS:.1f}"
                f" to {(number + 1) / _OCCLUSION_BINS:.1f}, expected {100 * expected:.1f} %"
            )
    return Comparison(max(_count(found), _count(frozen.files)), differing, complaints)


def library_versions() -> dict[str, str]:
    """Installed versions of the libraries that affect the bytes of a dataset."""
    return {name: importlib.metadata.version(name) for name in _LIBRARIES}


def _digests(directory: Path) -> list[tuple[str, str]]:
    """Name and SHA-256 of every image, depth map and COCO file, sorted by name."""
    paths = [path for folder in FRAME_FOLDERS for path in (directory / folder).glob("*")]
    paths += [path for split in SPLITS if (path := directory / f"{split}_RGB.json").exists()]
    names = sorted(path.relative_to(directory).as_posix() for path in paths)
    return [(name, hashlib.sha256((directory / name).read_bytes()).hexdigest()) for name in names]


def _short_digests(directory: Path) -> dict[str, str]:
    strung: dict[str, str] = {}
    for name, digest in _digests(directory):
        folder = name.rpartition("/")[0] or name
        strung[folder] = strung.get(folder, "") + digest[:_DIGEST_LENGTH]
    return strung


def _differing(found: str, expected: str) -> int:
    """Count the digests that differ between two strings, missing ones included."""
    longest = max(len(found), len(expected))
    return sum(
        found[start : start + _DIGEST_LENGTH] != expected[start : start + _DIGEST_LENGTH]
        for start in range(0, longest, _DIGEST_LENGTH)
    )


def _count(files: dict[str, str]) -> int:
    return sum(len(digests) for digests in files.values()) // _DIGEST_LENGTH


def _label_figures(directory: Path) -> tuple[float, list[float]]:
    """Trees per frame, and the fraction of trees in each bin of their visible fraction."""
    frames, visible = 0, []
    for split in SPLITS:
        path = directory / f"{split}_RGB.json"
        if path.exists():
            try:
                content: dict[str, Any] = json.loads(read_regular(path))
                frames += len(content["images"])
                visible += [float(tree["visible_fraction"]) for tree in content["annotations"]]
            except (OSError, ValueError, LookupError, TypeError, ArithmeticError, RecursionError):
                raise DatasetError(f"{path}: not the labels of a simulated dataset") from None
    if not frames or not visible:
        raise DatasetError(f"{directory}: holds no labelled trees, expected a simulated dataset")
    if not np.isfinite(visible).all():
        raise DatasetError(f"{directory}: a visible_fraction is not finite, expected 0 to 1")
    counts = np.histogram(visible, _OCCLUSION_BINS, (0, 1))[0]
    shares = [round(float(count) / len(visible), 4) for count in counts]
    return round(len(visible) / frames, 4), shares
