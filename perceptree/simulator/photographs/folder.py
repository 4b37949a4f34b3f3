"""A folder of photographs: what is in it, a hash of its content, and whom to name."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from basetree.errors import SettingsError
from basetree.files.regular import read_regular
from perceptree.errors import DatasetError
from perceptree.simulator.settings import SimulatorSettings

MATERIALS = ("bark", "ground", "rock")
FOLIAGE, PANORAMA = "foliage", "panorama"
KINDS = (*MATERIALS, FOLIAGE, PANORAMA)
MAPS = ("color", "normal", "height")
CUBE_FACES = ("posx", "negx", "posy", "negy", "posz", "negz")
CREDITS = "textures"  # name of the credits in a dataset's settings.json
_PICTURES = (".jpg", ".jpeg", ".png")
_LICENCES = ("LICENCE.txt", "LICENSE.txt")
_LICENCE = re.compile(
    r"\b(CC0|CC.BY|MIT|BSD|Apache|Creative Commons|public domain|licen[cs]e|copyright)\b", re.I
)
NO_LICENCE = "not stated"


@dataclass(frozen=True)
class Photograph:
    """One material, cut-out or panorama.

    Attributes:
        kind: One of KINDS.
        source: Name of the source's folder.
        name: Name of the photograph.
        files: Picture by its part: one of MAPS, one of CUBE_FACES, or `color` if there is only
            one.
    """

    kind: str
    source: str
    name: str
    files: dict[str, Path]

    @property
    def title(self) -> str:
        """Where it is, relative to the folder."""
        return f"{self.kind}/{self.source}/{self.name}"


@dataclass(frozen=True)
class PhotoFolder:
    """The photographs of a folder.

    Attributes:
        root: The folder.
        photographs: All photographs, sorted by kind, source and name.
        sha256: Hash of the names and contents of all pictures and licences.
        credits: Per source: `kind`, `source`, `licence` (first line of its LICENCE.txt that
            names one) and `names` of the photographs.
    """

    root: Path
    photographs: tuple[Photograph, ...]
    sha256: str
    credits: tuple[dict[str, Any], ...]

    def of_kind(self, kind: str) -> list[Photograph]:
        """The photographs of a kind."""
        return [photo for photo in self.photographs if photo.kind == kind]

    def check_unchanged(self) -> None:
        """Read the folder again, on another machine or later.

        Raises:
            SettingsError: If its content has changed.
        """
        if open_photographs(self.root).sha256 != self.sha256:
            raise SettingsError(
                f"--textures {self.root}: holds other photographs than at the start; expected the"
                " same files on every machine"
            )


def open_photographs(root: Path) -> PhotoFolder:
    """List and hash a folder of photographs, without decoding them.

    Args:
        root: Folder with KIND/SOURCE/NAME, as in the guide "Photographs of your own forest".

    Raises:
        SettingsError: If it cannot be read, has no folder of a known kind, or a part is missing.
    """
    try:
        found = tuple(photo for kind in KINDS for photo in _photographs(root, kind))
        if not found:
            raise SettingsError(
                f"--textures is {root}: expected a folder with photographs in at least one of"
                f" {', '.join(KINDS)}, as KIND/SOURCE/NAME/color.jpg"
            )
        return PhotoFolder(root.absolute(), found, _sha256(root, found), _credits(root, found))
    except OSError as error:
        raise SettingsError(
            f"--textures {error.filename or root}: cannot be read ({error.strerror}), expected a"
            " folder of photographs"
        ) from error


def with_photographs(settings: SimulatorSettings, folder: PhotoFolder | None) -> SimulatorSettings:
    """Settings that name the content of a folder; without a folder, unchanged settings.

    Raises:
        SettingsError: If the settings name photographs and no folder is given.
    """
    named = settings.photographs
    if folder is None and named.sha256:
        raise SettingsError(
            f"the settings name photographs (sha256 {named.sha256[:12]}...): expected --textures"
            " with their folder"
        )
    if folder is None:
        return settings
    return replace(settings, photographs=replace(named, sha256=folder.sha256))


def dataset_credits(settings_file: Path) -> list[dict[str, Any]]:
    """Read whom a dataset's photographs are of, and their licences, from its `settings.json`.

    Returns:
        As `PhotoFolder.credits`; empty for a dataset without photographs.

    Raises:
        DatasetError: If the file cannot be read.
    """
    try:
        content = json.loads(read_regular(settings_file))
    except (OSError, ValueError, RecursionError) as error:
        raise DatasetError(
            f"{settings_file}: cannot be read ({error}), expected a dataset's settings.json"
        ) from error
    found = content.get(CREDITS, []) if isinstance(content, dict) else []
    if not isinstance(found, list) or not all(isinstance(one, dict) for one in found):
        raise DatasetError(
            f"{settings_file}: {CREDITS} is {found!r:.100}, expected a list of sources and licences"
        )
    return found


def _photographs(root: Path, kind: str) -> Iterator[Photograph]:
    for source in _visible(root / kind, root):
        if not source.is_dir():
            continue
        if kind == PANORAMA and CUBE_FACES[0] in _pictures(source):
            yield _cube(kind, source.name, source.name, source)
            continue
        for entry in _visible(source, root):
            if kind in MATERIALS and entry.is_dir():
                yield _material(kind, source.name, entry)
            elif kind == PANORAMA and entry.is_dir():
                yield _cube(kind, source.name, entry.name, entry)
            elif kind not in MATERIALS and entry.suffix.lower() in _PICTURES:
                yield Photograph(kind, source.name, entry.stem, {"color": entry})


def _visible(folder: Path, root: Path) -> list[Path]:
    """Entries of a folder by name; none for a kind that is missing in the root."""
    if folder.parent == root and not folder.is_dir():
        return []
    return sorted(path for path in folder.iterdir() if not path.name.startswith("."))


def _pictures(folder: Path) -> dict[str, Path]:
    return {
        path.stem: path for path in sorted(folder.iterdir()) if path.suffix.lower() in _PICTURES
    }


def _material(kind: str, source: str, folder: Path) -> Photograph:
    pictures = _pictures(folder)
    if "color" not in pictures:
        raise SettingsError(f"{folder}: has no color.jpg or color.png, expected one")
    return Photograph(kind, source, folder.name, {m: pictures[m] for m in MAPS if m in pictures})


def _cube(kind: str, source: str, name: str, folder: Path) -> Photograph:
    pictures = _pictures(folder)
    missing = [face for face in CUBE_FACES if face not in pictures]
    if missing:
        raise SettingsError(
            f"{folder}: is no cube map without {', '.join(missing)}, expected a picture for each of"
            f" {', '.join(CUBE_FACES)}"
        )
    return Photograph(kind, source, name, {face: pictures[face] for face in CUBE_FACES})


def _licence_file(root: Path, photo: Photograph) -> Path | None:
    folder = root / photo.kind / photo.source
    return next((folder / name for name in _LICENCES if (folder / name).is_file()), None)


def _licence(text: str) -> str:
    """The first line that names a licence, else the first line."""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    named = [line for line in lines if _LICENCE.search(line)]
    return (named or lines or [NO_LICENCE])[0]


def _sha256(root: Path, photographs: tuple[Photograph, ...]) -> str:
    files = {file for photo in photographs for file in photo.files.values()}
    files |= {file for photo in photographs if (file := _licence_file(root, photo))}
    digest = hashlib.sha256()
    for name, file in sorted((path.relative_to(root).as_posix(), path) for path in files):
        content = hashlib.sha256(read_regular(file)).hexdigest()
        digest.update(name.encode("utf-8", "surrogateescape") + f"\0{content}\0".encode())
    return digest.hexdigest()


def _credits(root: Path, photographs: tuple[Photograph, ...]) -> tuple[dict[str, Any], ...]:
    by_source: dict[tuple[str, str], dict[str, Any]] = {}
    for photo in photographs:
        key = photo.kind, photo.source
        if key not in by_source:
            file = _licence_file(root, photo)
            licence = (
                NO_LICENCE
                if file is None
                else _licence(read_regular(file).decode("utf-8", "replace"))
            )
            by_source[key] = {"kind": key[0], "source": key[1], "licence": licence, "names": []}
        by_source[key]["names"].append(photo.name)
    return tuple(by_source.values())
