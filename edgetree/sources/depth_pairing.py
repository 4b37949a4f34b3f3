"""Which depth file belongs to which image, by their names."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Sequence
from itertools import pairwise
from pathlib import PurePath, PurePosixPath
from statistics import median
from typing import Final, NamedTuple

from basetree.errors import InputError
from basetree.files.names import DEPTH_SUFFIXES

COLOUR_FOLDERS: Final = ("rgb", "color", "colour", "images", "image", "left", "jpg", "png")
DEPTH_FOLDERS: Final = ("depth", "depths", "depth_image", "depth_images")
_DEPTH_WORDS: Final = "depths?(?:_mm|_m)?|depthmap|d"
_COLOUR_WORDS: Final = "rgb|colou?r|images?|img|left|frame|picture"
_TIME: Final = re.compile(r"\d+\.\d{3,}|[1-9]\d{9,18}")
_SECONDS_DIGITS: Final = 10
_SINGLE_PERIOD_S: Final = 1 / 30
_SAME_RATE: Final = 1.5


class DepthNames(NamedTuple):
    """The depth file of each image.

    Attributes:
        names: Name of the depth file of each image, in their order; one that does not exist for an
            image without depth.
        missing: Those that do not exist.
        remark: How they were paired, if not by equal stems; None otherwise.
    """

    names: list[str]
    missing: frozenset[str]
    remark: str | None


def frame_names(images: Sequence[PurePath]) -> list[str]:
    """The name of each image's frame: its stem, or its file name if others have the same stem."""
    counts = Counter(path.stem for path in images)
    return [path.stem if counts[path.stem] == 1 else path.name for path in images]


def is_depth_name(stem: str) -> bool:
    """Whether a file's stem begins or ends with a word for depth."""
    return _without(stem, _DEPTH_WORDS) != stem


def depth_names(
    images: Sequence[PurePath],
    present: Collection[str],
    folder: str,
    depth_folder: str,
    suffixes: Sequence[str] = DEPTH_SUFFIXES,
) -> DepthNames:
    """Find the depth file of each image.

    Files of the same stem belong together; or else files whose names are equal without words such
    as depth and rgb; or else, if the names are time stamps, those within half a period.

    Args:
        images: The images.
        present: Names of the depth files that exist.
        folder: Where the images are, for messages.
        depth_folder: Where the depth files are, likewise.
        suffixes: Those of depth files, or of point clouds.

    Raises:
        InputError: No image has a depth file, or two files may be that of an image.
    """
    depths = [
        PurePosixPath(name)
        for name in sorted(present, key=lambda name: _rank(name, suffixes))
        if _rank(name, suffixes)[0] < len(suffixes) and not name.startswith(".")
    ]
    found, remark = _by_stem(images, depths)
    if not any(found):
        found, remark = _by_words(images, depths, folder, depth_folder)
    if not any(found):
        found, remark = _by_time(images, depths)
    expected = [f"{image.stem}{suffixes[0]}" for image in images]
    if not any(found):
        raise InputError(
            f"depth image {depth_folder}/{expected[0]} does not exist, nor with"
            f" {', '.join(suffixes[1:])}: expected one for image {folder}/{images[0].name}"
            f"{_held(images, present, suffixes)}"
        )
    pairs = list(zip(found, expected, strict=True))
    missing = frozenset(name for depth, name in pairs if depth is None)
    return DepthNames([depth or name for depth, name in pairs], missing, remark)


def _held(images: Sequence[PurePath], present: Collection[str], suffixes: Sequence[str]) -> str:
    """What the depth's folder holds in place of depth files of these images, for a message."""
    names = sorted(name for name in present if not name.startswith("."))
    if not names:
        return "; the folder is empty"
    stems = {image.stem for image in images}
    same = [name for name in names if PurePosixPath(name).stem in stems]
    if same and _rank(same[0], suffixes)[0] == len(suffixes):
        return f"; it holds {same[0]}, which is no depth image: are images and depth swapped?"
    return f"; it holds {names[0]}" + (f" to {names[-1]}" if len(names) > 1 else "")


def _rank(name: str, suffixes: Sequence[str]) -> tuple[int, str]:
    """Where a file stands among those of one stem: by its suffix."""
    suffix = PurePosixPath(name).suffix.lower()
    return suffixes.index(suffix) if suffix in suffixes else len(suffixes), name


_Found = tuple[list[str | None], str | None]


def _by_stem(images: Sequence[PurePath], depths: Sequence[PurePath]) -> _Found:
    first: dict[str, str] = {}
    remark = None
    stems = {image.stem for image in images}
    for depth in depths:
        taken = first.setdefault(depth.stem, depth.name)
        if taken != depth.name and depth.stem in stems and remark is None:
            remark = f"depth {taken} is taken where there are several, such as {depth.name}"
    return [first.get(image.stem) for image in images], remark


def _by_words(
    images: Sequence[PurePath], depths: Sequence[PurePath], folder: str, depth_folder: str
) -> _Found:
    by_key: dict[str, list[str]] = {}
    for depth in depths:
        key = _without(_without(depth.stem, _DEPTH_WORDS), _COLOUR_WORDS)
        names = by_key.setdefault(key.lower(), [])
        if not any(PurePosixPath(name).stem == depth.stem for name in names):
            names.append(depth.name)
    keys = [_without(image.stem, _COLOUR_WORDS).lower() for image in images]
    for image, key in zip(images, keys, strict=True):
        if len(by_key.get(key, ())) > 1:
            first, second = by_key[key][:2]
            raise InputError(
                f"depth images {first} and {second} in {depth_folder} both look like the depth of"
                f" {folder}/{image.name}: expected one"
            )
    found = [by_key[key][0] if key in by_key else None for key in keys]
    pairs = zip(images, found, strict=True)
    example = next((f"{image.name} with {name}" for image, name in pairs if name), "")
    return found, f"depth is paired by names without words such as depth and rgb: {example}"


def _without(stem: str, words: str) -> str:
    """A stem without one of the words at its beginning or end; whole if nothing else is left."""
    begin = rf"^(?:{words})(?:[_\-. ]+|(?=\d))"
    end = rf"(?:[_\-. ]+|(?<=\d))(?:{words})$"
    short = re.sub(end, "", re.sub(begin, "", stem, flags=re.IGNORECASE), flags=re.IGNORECASE)
    return short or stem


def _by_time(images: Sequence[PurePath], depths: Sequence[PurePath]) -> _Found:
    """Pairs whose times differ least, each at most once and within half a period."""
    nothing: _Found = ([None] * len(images), None)
    image_s = [_seconds(_without(image.stem, _COLOUR_WORDS)) for image in images]
    depth_s = [_seconds(_without(depth.stem, _DEPTH_WORDS)) for depth in depths]
    if not image_s or not depth_s or None in image_s or None in depth_s:
        return nothing
    shorter_s, longer_s = sorted((_period_s(image_s), _period_s(depth_s)))
    # Two cameras of one rate have medians that differ by their jitter.
    half_s = (longer_s if longer_s < _SAME_RATE * shorter_s else shorter_s) / 2
    times = sorted((time_s, index) for index, time_s in enumerate(depth_s) if time_s is not None)
    near: list[tuple[float, int, int]] = []
    at = 0
    for time_s, index in sorted((t, i) for i, t in enumerate(image_s) if t is not None):
        while at < len(times) and times[at][0] < time_s - half_s:
            at += 1
        near += [
            (abs(other_s - time_s), index, depth)
            for other_s, depth in times[at : at + 3]
            if abs(other_s - time_s) <= half_s
        ]
    found, taken, farthest_s = list(nothing[0]), set[int](), 0.0
    for apart_s, index, depth in sorted(near):
        if found[index] is None and depth not in taken:
            found[index], farthest_s = depths[depth].name, max(farthest_s, apart_s)
            taken.add(depth)
    return found, (
        f"depth is paired by the time stamps in the names, at most {farthest_s * 1000:.1f} ms apart"
        f" (half a period is {half_s * 1000:.1f} ms): {len(taken)} of {len(images)} images"
    )


def _seconds(stem: str) -> float | None:
    """A time stamp in s; whole numbers are s, ms, µs or ns since 1970. None for another name."""
    if _TIME.fullmatch(stem) is None:
        return None
    if "." in stem:
        return float(stem)
    return float(int(stem) / 10 ** (len(stem) - _SECONDS_DIGITS))


def _period_s(times_s: Sequence[float | None]) -> float:
    ordered = sorted(time_s for time_s in times_s if time_s is not None)
    steps = [b - a for a, b in pairwise(ordered) if b > a]
    return median(steps) if steps else _SINGLE_PERIOD_S
