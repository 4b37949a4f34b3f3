"""`edgetree models`: list the models that are found by name."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from basetree.program.console import complain, note, print_json, tell, tell_words
from edgetree.commands.options import Json

if TYPE_CHECKING:
    from edgetree.catalogue import KnownModel

_COLUMNS = ("name", "images", "precision", "MB", "boxes", "masks", "keypoints", "ms")
_IMAGES = {"rgb": "images without depth", "depth": "images with depth"}


def models(*, as_json: Json = False) -> None:
    """List the models that --model takes by name, with size, accuracy and speed.

    They are those of the package, those in the folders that the environment variable
    EDGETREE_MODELS names, and those in the folder `models` here and of a checkout of the project.
    Accuracy and speed are from the model card beside each file.
    """
    from edgetree.catalogue import DEFAULTS, FOLDERS_VARIABLE, hidden_models, known_models

    listed = [record for model in known_models() for record in _record(model)]
    for model in hidden_models():
        complain(f"left out: {model.path}: {model.name} is an earlier model: expected another name")
    if as_json:
        print_json({"schema": "edgetree.models/1", "models": listed})
        return
    rows = [_COLUMNS, *(_row(record) for record in listed)]
    widths = [max(len(row[column]) for row in rows) for column in range(len(_COLUMNS))]
    for row in rows:
        cells = (text.ljust(width) for text, width in zip(row, widths, strict=True))
        tell("  ".join(cells).rstrip())
    for record in listed:
        if record["card"] is not None:
            tell_words(f"{record['name']}: {record['card']['for']}")
    for modality, name in DEFAULTS.items():
        tell_words(f"{modality}: {name}, the default for {_IMAGES[modality]}")
    tell_words("boxes, masks, keypoints: average precision in percent on the frozen test frames")
    tell_words("ms: median time of a detection on the machine of the card")
    note(f"further models: name their folders in {FOLDERS_VARIABLE}")


def _record(model: KnownModel) -> Iterator[dict[str, Any]]:
    """A model as a JSON object; nothing, and a note, if it cannot be read.

    A card that cannot be used is told, and the model listed without it.
    """
    from basetree.errors import EdgetreeError, InputError

    try:
        manifest = model.manifest()
    except EdgetreeError as error:
        complain(f"left out: {error}")
        return
    try:
        card = model.card()
    except InputError as error:
        card = None
        complain(f"no figures of {model.name}: {error}")
    yield {
        "name": model.name,
        "path": str(model.path),
        "modality": manifest.modality,
        "precision": manifest.precision,
        "size_bytes": model.path.stat().st_size,
        "input_px": [manifest.input.width, manifest.input.height],
        "training_data": manifest.training_data,
        "card": card,
    }


def _row(record: dict[str, Any]) -> tuple[str, ...]:
    card = record["card"]
    figures: tuple[str, ...] = ("-",) * 4
    if card is not None:
        precision = card["test"]["average_precision"]
        shares = (precision[kind] for kind in ("boxes", "masks", "keypoints"))
        figures = (*(_number(share) for share in shares), _number(card["speed"]["detect_p50_ms"]))
    return (
        record["name"],
        record["modality"],
        record["precision"],
        f"{record['size_bytes'] / 1e6:.1f}",
        *figures,
    )


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.1f}"
