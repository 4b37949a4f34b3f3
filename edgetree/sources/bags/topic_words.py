"""What the words in the names of topics and frames tell: depth, alignment, rectification."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Final, Literal

_PARTS: Final = re.compile(r"[^0-9A-Za-z]+")
_WORDS: Final = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|[0-9]+")
_NOT: Final = frozenset(("no", "non", "not", "un"))
# In "aligned_depth_to_color" the words after "to" are of another picture.
_OTHER_PICTURE: Final = "to"

# Beginnings of words. What is named so is depth along the optical axis, or it is not.
_DEPTH: Final = ("depth", "z16")
_NO_DEPTH: Final = (
    "ambient", "amplitude", "boson", "color", "colour", "confidence", "dispar", "distance", "flir",
    "gray", "grey", "infra", "instance", "intens", "label", "lepton", "lwir", "mwir", "noise",
    "optris", "radial", "reflect", "segment", "semantic", "signal", "swir", "temperature", "therm",
    "uncertain", "varian",
)  # fmt: skip
_NO_DEPTH_WORDS: Final = frozenset(
    ("bgr", "class", "conf", "cost", "disp", "fir", "ir", "mask", "nir", "range", "rgb", "temp")
)
_VENDORS: Final = frozenset(("depthai",))
# These tell less: stereo cameras publish their depth under this name, and their pictures under the
# names of the sides.
_WEAK_DEPTH: Final = frozenset(("stereo", "tof"))
_WEAK_NO_DEPTH: Final = frozenset(("left", "mono", "right"))


def words(name: str) -> list[str]:
    """The words of a name, in lower case and without numbers, parted at "/", "_" and capitals.

    Words after "to" are left out, up to the next "/".

    Examples:
        >>> words("/camera/aligned_depth_to_color/image_raw")
        ['camera', 'aligned', 'depth', 'image', 'raw']
        >>> words("/device_0/Infrared1")
        ['device', 'infrared']
    """
    found: list[str] = []
    for section in name.split("/"):
        inner = [
            word.lower()
            for part in _PARTS.split(section)
            for word in ([part] if part.lower() == "z16" else _WORDS.findall(part))
        ]
        if _OTHER_PICTURE in inner[1:]:
            inner = inner[: inner.index(_OTHER_PICTURE, 1)]
        found += [word for word in inner if not word.isdigit()]
    return found


def is_aligned(topic: str) -> bool:
    """Whether a topic of depth is named as being in the pixels of the colour."""
    return _has(topic, ("aligned", "registered"))


def is_rectified(topic: str) -> bool:
    """Whether a topic of pictures is named as being rectified, such as image_rect_color."""
    return _has(topic, ("rect", "undistort"), but=("rectang",))


def _has(topic: str, beginnings: tuple[str, ...], but: tuple[str, ...] = ()) -> bool:
    """Whether a word begins so, without a "not" before it."""
    found = words(topic)
    return any(
        word.startswith(beginnings) and not word.startswith(but or ("\0",)) and before not in _NOT
        for before, word in zip(["", *found], found, strict=False)
    )


def depth_by_name(names: Iterable[str]) -> tuple[Literal["depth", "other", ""], str]:
    """Whether a picture of one channel is depth, by the names of its topic and frames.

    The first name that tells decides, and in it the last word, so that depth/confidence is none.

    Args:
        names: Names of its topic and frames, the most telling one first.

    Returns:
        "depth", "other" or "" if no name tells, and the word that decided.
    """
    parted = [words(name) for name in names]
    for judge in (_strong, _weak):
        for name in parted:
            for word in reversed(name):
                if verdict := judge(word):
                    return verdict, word
    return "", ""


def _strong(word: str) -> Literal["depth", "other", ""]:
    if word.startswith(_DEPTH) or word.endswith("depth"):
        return "" if word in _VENDORS else "depth"
    return "other" if word.startswith(_NO_DEPTH) or word in _NO_DEPTH_WORDS else ""


def _weak(word: str) -> Literal["depth", "other", ""]:
    if word in _WEAK_DEPTH:
        return "depth"
    return "other" if word in _WEAK_NO_DEPTH else ""
