"""The models that are found by name: those of the package, and those of folders of the user."""

from __future__ import annotations

import difflib
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from basetree.errors import InputError
from edgetree.errors import ModelFileError
from edgetree.model_file.manifest import METADATA_KEY, Manifest
from edgetree.model_file.safety_check import read_model_file

DEFAULTS: Final = {"rgb": "edge-s-rgb", "depth": "edge-n-depth"}
"""The packaged model that "rgb" and "depth" stand for: of a command without --model, too."""
MODALITIES: Final = tuple(DEFAULTS)
_BOTH: Final = "edge-n"
FOLDERS_VARIABLE: Final = "EDGETREE_MODELS"
"""Environment variable with further folders of models, separated as in PATH."""

_PACKAGED: Final = Path(__file__).parent / "assets" / "models"


@dataclass(frozen=True)
class KnownModel:
    """A model that is found by name.

    Attributes:
        name: Its name, that of the file without its suffix.
        path: The .onnx file.
    """

    name: str
    path: Path

    def manifest(self) -> Manifest:
        """The description of the model in its file.

        Raises:
            ModelFileError: The file is not a model of edgetree.
        """
        metadata = read_model_file(self.path).metadata
        if METADATA_KEY not in metadata:
            raise ModelFileError(
                f"model {self.path} has no manifest: expected a file made by `edgetree export`"
            )
        return Manifest.from_json(metadata[METADATA_KEY])

    def card(self) -> dict[str, Any] | None:
        """The measured figures of the file, from NAME.json beside it; None if there is no card.

        Raises:
            InputError: The card cannot be read, has another schema, or is of another file.
        """
        path = self.path.with_suffix(".json")
        if not path.is_file():
            return None
        from edgetree.model_file.card import read_card

        return read_card(path, self.path)


def known_models() -> list[KnownModel]:
    """All models that are found by name, by name.

    They are in the package, in the folders that the environment variable EDGETREE_MODELS names, in
    the folder `models` of the current directory, and in that of a checkout of the project. Of
    models with the same name, the first one in this order is taken.

    Raises:
        InputError: a folder that EDGETREE_MODELS names does not exist.
    """
    found: dict[str, KnownModel] = {}
    for model in _all_models():
        found.setdefault(model.name, model)
    return [found[name] for name in sorted(found)]


def hidden_models() -> list[KnownModel]:
    """Models of the folders of `known_models` whose name an earlier one has.

    Raises:
        InputError: a folder that EDGETREE_MODELS names does not exist.
    """
    found = {model.name: model.path.resolve() for model in known_models()}
    return [model for model in _all_models() if model.path.resolve() != found[model.name]]


def _all_models() -> Iterator[KnownModel]:
    for folder in (_PACKAGED, *_own_folders(), *_near_folders()):
        for path in sorted(folder.glob("*.onnx")):
            yield KnownModel(path.stem, path)


def _own_folders() -> list[Path]:
    given = os.environ.get(FOLDERS_VARIABLE, "").split(os.pathsep)
    folders = [Path(text) for text in given if text]
    for folder in folders:
        if not folder.is_dir():
            raise InputError(f"{FOLDERS_VARIABLE} names {folder}: expected an existing folder")
    return folders


def _near_folders() -> list[Path]:
    """Where `models` is looked for: here, in the checkout around here, and in the package's."""
    source = Path(__file__)
    of_package = [source.parents[1]] if _is_checkout(source.parents[1]) else []
    try:
        here = Path.cwd()
    except OSError:  # it was removed
        return [folder / "models" for folder in of_package]
    around = [folder for folder in (here, *here.parents) if _is_checkout(folder)]
    return [folder / "models" for folder in dict.fromkeys([here, *around[:1], *of_package])]


def _is_checkout(folder: Path) -> bool:
    return (folder / "pyproject.toml").is_file() and (folder / "edgetree/catalogue.py").is_file()


def default_model(name: str) -> Path:
    """Path of a model that is found by name.

    Args:
        name: "rgb" or "depth" for the packaged model that is the default for such images, or a name
            that `edgetree models` lists, such as "edge-s-rgb".

    Raises:
        ModelFileError: No model has this name.
        InputError: a folder that EDGETREE_MODELS names does not exist.

    Examples:
        >>> from edgetree import default_model
        >>> default_model("depth").name
        'edge-n-depth.onnx'
    """
    packaged = {path.stem: path for path in _PACKAGED.glob("*.onnx")}
    file = packaged.get(DEFAULTS.get(name, name))
    if file is not None:
        return file
    models = {model.name: model.path for model in known_models()}
    if name not in models:
        raise _unknown(name, sorted({*models, *MODALITIES}))
    return models[name]


def _unknown(name: str, known: list[str]) -> ModelFileError:
    """What is said of a name that no model has."""
    file = f"{name}.onnx"
    close = [file] if Path(file).is_file() else difflib.get_close_matches(name.lower(), known, n=1)
    hint = f" (did you mean {close[0]}?)" if close else ""
    return ModelFileError(
        f"no model is called {name!r}{hint}: expected a file or {', '.join(known)}"
    )


def find_model(model: Path | str) -> Path:
    """The file of a model that is given by name or path.

    Args:
        model: a name as for `default_model`, or the path of an .onnx file.

    Raises:
        ModelFileError: There is neither a known model nor a file of this name.
        InputError: a folder that EDGETREE_MODELS names does not exist.
    """
    text, path = str(model), Path(model)
    is_path = path.is_file() or path.suffix == ".onnx" or len(path.parts) > 1
    return path if is_path and text not in MODALITIES else default_model(text)


def suited_model(with_depth: bool) -> str:
    """Name of the packaged model for an image with depth, or for one without.

    With depth it is that of colour and depth, if the package has it.
    """
    if with_depth and (_PACKAGED / f"{_BOTH}.onnx").is_file():
        return _BOTH
    return DEFAULTS["depth" if with_depth else "rgb"]


def other_model(modality: str, used: str) -> str | None:
    """Name of another packaged model for the same images: the default one, if it is another.

    Args:
        modality: "rgb", "depth" or "both".
        used: Name of the model in use.
    """
    packaged = sorted(path.stem for path in _PACKAGED.glob(f"*-{modality}.onnx"))
    usual = [DEFAULTS[modality]] if modality in DEFAULTS else []
    return next((name for name in (*usual, *packaged) if name != used), None)
