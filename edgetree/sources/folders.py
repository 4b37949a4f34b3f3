"""Which files of a folder are pictures, and which depth images belong to them."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from basetree.counts import counted
from basetree.errors import InputError
from basetree.files.names import DEPTH_SUFFIXES, HEIF_SUFFIXES
from basetree.files.picture_size import has_deep_grey
from calib.clouds import CLOUD_SUFFIXES
from edgetree.sources.depth_pairing import (
    COLOUR_FOLDERS,
    DEPTH_FOLDERS,
    depth_names,
    is_depth_name,
)
from edgetree.sources.picture_names import (
    has_named_depth,
    has_suffix,
    heic_words,
    image_suffixes,
    in_order,
    is_image_name,
    unread_heic,
    with_files,
)

_log = logging.getLogger(__name__)

ARRAY_SUFFIX: Final = ".npy"


def has_images(folder: Path) -> bool:
    """Whether a path is a folder with images in it."""
    return folder.is_dir() and any(map(is_image_name, folder.iterdir()))


def depth_inside(folder: Path) -> Path | None:
    """The folder of the depth that belongs to the images of a folder; None if there is none.

    It is one beside that of the images, or the folder itself where names such as `a.jpg` and
    `a_depth.png` tell both apart.
    """
    if not folder.is_dir():
        return None
    if with_files(folder, COLOUR_FOLDERS, image_suffixes()) == folder:
        return folder if has_named_depth(folder) else None
    depth = with_files(folder, DEPTH_FOLDERS, DEPTH_SUFFIXES)
    return None if depth == folder else depth


def depth_alone(source: Path, depth: Path | None = None) -> Path | None:
    """The file or folder of depth of a source that holds no pictures; None for another source.

    Pictures of one channel with more than 8 bits are depth, too.

    Args:
        source: A file or folder.
        depth: Its depth as the user gave it, which may be the source itself.
    """
    is_same = depth is not None and depth.exists() and source.exists() and depth.samefile(source)
    if depth is not None and not is_same:
        return None
    if is_same and not source.is_dir() and has_suffix(source, HEIF_SUFFIXES):
        return None  # a picture with its depth in one file
    if not source.is_dir():
        is_depth = is_same or source.suffix.lower() == ARRAY_SUFFIX or _are_deep([source])
        return source if is_depth else None
    if with_files(source, COLOUR_FOLDERS, image_suffixes()) != source:
        return None
    names = [path for path in source.iterdir() if path.is_file() and not path.name.startswith(".")]
    pictures = [path for path in names if is_image_name(path)]
    if not pictures:
        folder = with_files(source, DEPTH_FOLDERS, DEPTH_SUFFIXES)
        has_arrays = any(path.suffix.lower() == ARRAY_SUFFIX for path in names)
        return folder if has_arrays or folder != source else None
    # With pictures and their depth in one folder, names or suffixes tell them apart.
    is_mixed = any(path.suffix.lower() == ARRAY_SUFFIX for path in names) or any(
        is_depth_name(path.stem) != is_depth_name(pictures[0].stem) for path in pictures
    )
    is_lossy = any(path.suffix.lower() not in DEPTH_SUFFIXES for path in pictures)
    is_depth = not (is_mixed or is_lossy) and (is_same or _are_deep(pictures))
    return source if is_depth else None


def _are_deep(pictures: Sequence[Path]) -> bool:
    """Whether pictures have one channel of more than 8 bits; of many the first, middle and last."""
    looked_at = {pictures[place] for place in (0, len(pictures) // 2, -1)}
    return all(has_suffix(path, DEPTH_SUFFIXES) and has_deep_grey(path) for path in looked_at)


def folder_files(
    folder: Path, depth: Path | None = None, *, depth_only: bool = False
) -> list[tuple[Path, Path | None]]:
    """The images of a folder, in the order of their numbers or names.

    Args:
        folder: The folder, or one that holds a folder of colour images.
        depth: Folder of their depth images. If it is not given, it is found inside such a folder.
        depth_only: Whether the images are depth images instead of colour images.

    Returns:
        Each image with its depth image, which may not exist; or with None.

    Raises:
        InputError: There are no images, or no image has a depth image.
    """
    root, folder = folder, with_files(folder, COLOUR_FOLDERS, image_suffixes())
    depth = depth_inside(root) if depth is None else depth
    if folder != root:
        _log.warning("images of %s with the depth of %s", folder, depth or "no folder")
    suffixes = DEPTH_SUFFIXES if depth_only and depth is None else image_suffixes()
    paths = in_order(path for path in folder.iterdir() if has_suffix(path, suffixes))
    heic = unread_heic(folder)
    if not paths and heic:
        raise InputError(f"folder {folder} has no images but {heic_words(heic)}")
    if not paths and (colour := [path for path in folder.iterdir() if is_image_name(path)]):
        raise InputError(
            f"folder {folder} has no depth images but {counted(len(colour), 'picture')} such as"
            f" {min(colour).name}: expected {', '.join(suffixes)} for a depth model; pass --depth,"
            " or take a colour model (--model rgb)"
        )
    if not paths:
        raise InputError(f"folder {folder} has no images: expected {', '.join(suffixes)}")
    if heic:
        _log.warning("left out of folder %s: %s", folder, heic_words(heic))
    return with_depth(paths, depth, folder)


def with_depth(
    paths: Sequence[Path], depth: Path | None, folder: Path
) -> list[tuple[Path, Path | None]]:
    """Images with their depth images, by names.

    Args:
        paths: The images.
        depth: Folder of the depth images, which may be that of the images; None if there are none.
        folder: Where the images are.

    Raises:
        InputError: `depth` is no folder, or no image has a depth image in it.
    """
    if depth is None:
        return [(path, None) for path in paths]
    if not depth.is_dir():
        raise InputError(f"depth {depth} is not a folder: expected one, like {folder}")
    if depth.samefile(folder) and all(has_suffix(path, HEIF_SUFFIXES) for path in paths):
        return [(path, path) for path in paths]  # the depth of each is in its own file
    depth = with_files(depth, DEPTH_FOLDERS, (*DEPTH_SUFFIXES, *CLOUD_SUFFIXES))
    present = {path.name for path in depth.iterdir()}
    if depth.resolve() == folder.resolve():
        paths = [path for path in paths if not is_depth_name(path.stem)] or paths
        present -= {path.name for path in paths}
    has_depth = any(name.lower().endswith(DEPTH_SUFFIXES) for name in present)
    has_clouds = any(name.lower().endswith(CLOUD_SUFFIXES) for name in present) and not has_depth
    expected = CLOUD_SUFFIXES if has_clouds else DEPTH_SUFFIXES
    paired = depth_names(paths, present, str(folder), str(depth), expected)
    if paired.remark is not None:
        _log.warning("%s", paired.remark)
    return [(path, depth / name) for path, name in zip(paths, paired.names, strict=True)]
