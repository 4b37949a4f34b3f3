"""Names of pictures in folders: which files are pictures, in which order, and where they are."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path, PurePath
from typing import Final, TypeVar

from basetree.counts import counted
from basetree.errors import InputError, install_hint
from basetree.files.headers import heif
from basetree.files.names import DEPTH_SUFFIXES, HEIF_SUFFIXES, IMAGE_SUFFIXES
from basetree.files.picture_size import has_deep_grey
from edgetree.sources.depth_pairing import depth_names, is_depth_name

_P = TypeVar("_P", bound=PurePath)

# Not the digits after a decimal point, such as those of time stamps.
_LAST_NUMBER: Final = re.compile(r"((?:.*[^0-9.])?)([0-9]{1,18})([^0-9]*)", re.DOTALL)


def is_image_name(path: Path) -> bool:
    """Whether a path is named as a picture that is not hidden."""
    return has_suffix(path, image_suffixes())


def image_suffixes() -> tuple[str, ...]:
    """The suffixes of pictures, with HEIC's where the package that reads them is installed."""
    return (*IMAGE_SUFFIXES, *HEIF_SUFFIXES) if heif.is_readable() else IMAGE_SUFFIXES


def has_suffix(path: Path, suffixes: Sequence[str]) -> bool:
    """Whether a name ends in one of these suffixes and is not hidden."""
    return path.suffix.lower() in suffixes and not path.name.startswith(".")


def has_named_depth(folder: Path) -> bool:
    """Whether names such as `a.jpg` and `a_depth.png` tell a folder's pictures from their depth.

    At least half of the pictures then have depth.
    """
    files = [path for path in folder.iterdir() if path.is_file()]
    depths = sorted(
        path for path in files if has_suffix(path, DEPTH_SUFFIXES) and is_depth_name(path.stem)
    )
    pictures = [path for path in files if is_image_name(path) and not is_depth_name(path.stem)]
    if not depths or not pictures:
        return False
    try:
        found = depth_names(pictures, [path.name for path in depths], str(folder), str(folder))
    except InputError:
        return False
    if 2 * len(found.missing) > len(pictures):
        return False
    return depths[0].suffix.lower() == ".npy" or has_deep_grey(depths[0])


def unread_heic(folder: Path) -> list[str]:
    """The names of the HEIC pictures of a folder that are not read, as the package is missing."""
    if heif.is_readable():
        return []
    return sorted(path.name for path in folder.iterdir() if has_suffix(path, HEIF_SUFFIXES))


def heic_words(names: Sequence[str]) -> str:
    """How many HEIC pictures cannot be read, and what they need."""
    return (
        f"{counted(len(names), 'HEIC picture')} such as {names[0]}, which need pillow-heif:"
        f" {install_hint('heic')}, or export JPEG or PNG"
    )


def in_order(paths: Iterable[_P]) -> list[_P]:
    """Sort paths by name, or by the last number if the names differ in it alone: 2 is before 10."""
    by_name = sorted(paths)
    found = [_LAST_NUMBER.fullmatch(path.name) for path in by_name]
    numbers = [int(match[2]) for match in found if match is not None]
    others = {(match[1], match[3]) for match in found if match is not None}
    if len(numbers) < len(by_name) or len(others) != 1:
        return by_name
    return [path for _, path in sorted(zip(numbers, by_name, strict=True))]


def with_files(folder: Path, names: Sequence[str], suffixes: Sequence[str]) -> Path:
    """The folder, or the only one of these names in it if it has no such files itself."""
    inside = sorted(folder.iterdir())
    if any(path.suffix.lower() in suffixes and path.is_file() for path in inside):
        return folder
    found = [path for path in inside if path.is_dir() and path.name.lower() in names]
    return found[0] if len(found) == 1 else folder
