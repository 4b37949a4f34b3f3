"""The models that are found by name: those of the package, and those of folders of the user."""

from __future__ import annotations

import hashlib
import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from edgetree.errors import InputError, ModelFileError
from edgetree.model_file.manifest import METADATA_KEY, Manifest
from edgetree.model_file.safety_check import read_model_file

__all__ = [
    "CARD_SCHEMA",
    "FOLDERS_VARIABLE",
    "MODALITIES",
    "KnownModel",
    "default_model",
    "find_model",
    "known_models",
    "suited_model",
]

MODALITIES: Final = ("rgb", "depth")
FOLDERS_VARIABLE: Final = "EDGETREE_MODELS"
"""Environment variable with further folders of models, separated as in PATH."""
CARD_SCHEMA: Final = "edgetree.card/1"

_PACKAGED: Final = Path(__file__).parent / "assets" / "models"
_CHECKOUT: Final = Path(__file__).parents[1]
_DEFAULTS: Final = {"rgb": "edge-n-rgb", "depth": "edge-n-depth"}


@dataclass(frozen=True)
class KnownModel:
    """A model that is found by name.

    Attributes:
        name: its name, that of the file without its suffix.
        path: the .onnx file.
    """

    name: str
    path: Path

    def manifest(self) -> Manifest:
        """The description of the model in its file.

        Raises:
            ModelFileError: the file is not a model of edgetree.
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
            InputError: the card cannot be read, has another schema, or is of another file.
        """
        path = self.path.with_suffix(".json")
        if not path.is_file():
            return None
        expected = f"expected a card of schema {CARD_SCHEMA}"
        try:
            card = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise InputError(f"{path} cannot be read ({error}): {expected}") from error
        if not isinstance(card, dict) or card.get("schema") != CARD_SCHEMA:
            raise InputError(f"{path} has another schema: {expected}")
        if card.get("model_sha256") != hashlib.sha256(self.path.read_bytes()).hexdigest():
            raise InputError(f"{path} is the card of another file than {self.path.name}")
        return card


def known_models() -> list[KnownModel]:
    """All models that are found by name, by name.

    They are in the folders that the environment variable EDGETREE_MODELS names, in the package, and
    in the folder `models` of a checkout of the project. Of models with the same name, the first one
    in this order is taken.

    Raises:
        InputError: a folder that EDGETREE_MODELS names does not exist.
    """
    found: dict[str, KnownModel] = {}
    of_checkout = [_CHECKOUT / "models"] if (_CHECKOUT / "pyproject.toml").is_file() else []
    for folder in [*_own_folders(), _PACKAGED, *of_checkout]:
        for path in folder.glob("*.onnx"):
            found.setdefault(path.stem, KnownModel(path.stem, path))
    return [found[name] for name in sorted(found)]


def _own_folders() -> list[Path]:
    given = os.environ.get(FOLDERS_VARIABLE, "").split(os.pathsep)
    folders = [Path(text) for text in given if text]
    for folder in folders:
        if not folder.is_dir():
            raise InputError(f"{FOLDERS_VARIABLE} names {folder}: expected an existing folder")
    return folders


def default_model(modality: str) -> Path:
    """Path of the packaged model for "rgb" or "depth".

    Raises:
        InputError: `modality` is neither.
    """
    if modality not in MODALITIES:
        raise InputError(f"modality is {modality!r}: expected 'rgb' or 'depth'")
    return _PACKAGED / f"{_DEFAULTS[modality]}.onnx"


def find_model(text: str) -> Path:
    """The file of a model that is given by name or path.

    Args:
        text: "rgb" or "depth" for the packaged model, the name of a known model, or a path.

    Raises:
        InputError: there is neither a known model nor a file of this name.
    """
    if text in MODALITIES:
        return default_model(text)
    path = Path(text)
    if path.exists() or path.suffix or len(path.parts) > 1:
        return path
    models = {model.name: model.path for model in known_models()}
    if text not in models:
        raise InputError(f"no model is called {text!r}: expected a file or {', '.join(models)}")
    return models[text]


def suited_model(with_depth: bool) -> str:
    """Name of the packaged model for an image with depth, or for one without."""
    return _DEFAULTS["depth" if with_depth else "rgb"]
