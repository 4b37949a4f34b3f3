"""Check every photograph of a folder before anything is drawn."""

from __future__ import annotations

from perceptree.simulator.photographs.folder import (
    FOLIAGE,
    KINDS,
    NO_LICENCE,
    PANORAMA,
    PhotoFolder,
    Photograph,
)
from perceptree.simulator.photographs.loading import load_cutout, load_material
from perceptree.simulator.photographs.panoramas import load_panorama

_NAMED = 3  # photographs that a line names


def check_photographs(folder: PhotoFolder) -> list[str]:
    """Read all photographs as scenes do.

    Returns:
        Lines on what is missing or was done to use them; each names a few photographs.

    Raises:
        SettingsError: If one cannot be used; it is named.
    """
    by_remark: dict[str, list[str]] = {}
    for photo in folder.photographs:
        for remark in _remarks(photo):
            by_remark.setdefault(remark, []).append(photo.title)
    for credit in folder.credits:
        if credit["licence"] == NO_LICENCE:
            source = f"{credit['kind']}/{credit['source']}"
            by_remark.setdefault("no LICENCE.txt", []).append(source)
    lines = [f"{remark}: {_some(titles)}" for remark, titles in sorted(by_remark.items())]
    missing = [kind for kind in KINDS if not folder.of_kind(kind)]
    if missing:
        lines.append(f"no folder {', '.join(missing)}: these stay procedural")
    return lines


def _remarks(photo: Photograph) -> tuple[str, ...]:
    if photo.kind == FOLIAGE:
        return ("grey, tinted like leaves",) if load_cutout(photo)[1] else ()
    if photo.kind == PANORAMA:
        return load_panorama(photo)[1]
    return load_material(photo).remarks


def _some(titles: list[str]) -> str:
    shown = ", ".join(titles[:_NAMED])
    more = len(titles) - _NAMED
    return f"{shown} and {more} more" if more > 0 else shown
