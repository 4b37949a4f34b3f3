"""The card of a model: its measured figures, in a JSON file beside it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Final

from msgspec import Meta, Struct, field

from basetree.errors import InputError
from basetree.files.json import build, read_json
from basetree.files.reading import file_sha256

CARD_SCHEMA: Final = "edgetree.card/1"

_Percent = Annotated[float, Meta(ge=0, le=100)]
_Milliseconds = Annotated[float, Meta(ge=0, le=1e9)]


class _AveragePrecision(Struct):
    boxes: _Percent | None
    masks: _Percent | None
    keypoints: _Percent | None


class _Test(Struct):
    average_precision: _AveragePrecision


class _Speed(Struct):
    detect_p50_ms: _Milliseconds | None


class _Card(Struct):
    """What `edgetree models` lists of a card; release/cards.py writes more."""

    purpose: str = field(name="for")
    test: _Test
    speed: _Speed


class _Diameter(Struct):
    median_abs: Annotated[float, Meta(ge=0, le=1e3)] | None = None


class _Quantities(Struct):
    diameter_m: _Diameter


class _Metres(Struct):
    quantities: _Quantities


class _MeasuredTest(_Test):
    frames: int
    metres: _Metres


class MeasuredCard(Struct):
    """What `edgetree bench` takes from a card."""

    test: _MeasuredTest


def read_card(path: Path, model: Path) -> dict[str, Any]:
    """Read all fields of the card of a model.

    Raises:
        InputError: It cannot be read, has another schema, is of another file, or a field that is
            listed is wrong.
    """
    card: dict[str, Any] = read_json(path, CARD_SCHEMA, dict, "a card of a model")
    if card.get("model_sha256") != file_sha256(model):
        raise InputError(f"{path} is the card of another file than {model.name}")
    build(_Card, card, str(path))
    return card
