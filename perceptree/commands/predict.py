"""`perceptree predict`: detect trees in a folder of images; draw them and write labels."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from basetree.counts import counted
from basetree.errors import SettingsError
from basetree.program.console import complain, print_json, tell
from basetree.program.progress import track
from perceptree.commands.options import Checkpoint, Device, Json
from perceptree.commands.progress import say
from perceptree.errors import DatasetError

if TYPE_CHECKING:
    from calib import CocoLabels

_LABELS_FILE = "labels.json"
_BATCH = 4

_Folder = Annotated[
    Path,
    typer.Argument(
        help="Folder of images; for a depth model depth images, 16-bit in millimetres or 8-bit in"
        " the model's depth encoding."
    ),
]
_Score = Annotated[
    float, typer.Option("--score-threshold", help="Leave out detections with a lower score.")
]
_Runs = Annotated[
    bool,
    typer.Option(
        "--rle", help="Masks as exact run lengths instead of polygons, which more tools can edit."
    ),
]


def predict(
    checkpoint: Checkpoint,
    folder: _Folder,
    out: Annotated[Path, typer.Option(help="Folder for annotated images and labels.json.")],
    score: _Score = 0.5,
    runs: _Runs = False,
    device: Device = "cpu",
    as_json: Json = False,
) -> None:
    """Detect trees in a folder of images, for review and correction in a labelling tool.

    Writes each image with the detections drawn on it, and one COCO file with boxes, masks and
    keypoints for labelling tools. Files that cannot be read are left out, and the exit code is 1.
    """
    from basetree.program.interrupts import interrupt_afterwards
    from perceptree.evaluation import on_device, predict_with, report_folder
    from perceptree.evaluation.pictures import (
        add_labels,
        detect_pictures,
        find_pictures,
        new_labels,
        write_drawing,
    )
    from perceptree.models import load_checkpoint

    if not 0 <= score <= 1:
        raise SettingsError(f"--score-threshold is {score}: expected 0 to 1")
    if out.resolve() == folder.resolve():
        raise DatasetError(f"--out is {out}, the folder of the images: expected another")
    model, _ = load_checkpoint(checkpoint)
    if model.spec.modality == "both":
        raise SettingsError(
            f"{checkpoint}: takes colour and depth together, expected a model of one of them; or"
            " edgetree export and edgetree run"
        )
    model = on_device(model, device)
    paths = find_pictures(folder)
    names = _drawing_names(paths)
    report_folder(out)
    labels = new_labels(checkpoint.name, score, runs)
    left_out: list[str] = []

    def leave_out(error: Exception) -> None:
        left_out.append(str(error))
        complain(f"perceptree: left out: {error}")

    found = detect_pictures(predict_with(model), model.spec, paths, score, _BATCH, leave_out)
    trees = 0
    try:
        for picture in track(found, "detecting", len(paths), shown=not as_json):
            with interrupt_afterwards():
                add_labels(labels, picture)
                write_drawing(picture, out / names[picture.path])
                trees += len(picture.trees.scores)
    except KeyboardInterrupt:
        _write_labels(labels, out)
        raise
    if len(left_out) == len(paths):
        raise DatasetError(f"{folder}: no image can be read, expected one of the model's modality")
    _write_labels(labels, out)
    _print_result(len(paths) - len(left_out), trees, folder, out, as_json)
    if left_out:
        say(f"{len(left_out)} of {counted(len(paths), 'image')} left out, see above")
        raise typer.Exit(1)


def _write_labels(labels: CocoLabels, out: Path) -> None:
    from basetree.files.writing import write_text

    write_text(out / _LABELS_FILE, json.dumps(labels.to_dict(), allow_nan=False))


def _drawing_names(paths: list[Path]) -> dict[Path, str]:
    """Name the drawings by stem, or by full file name if two images share a stem."""
    stems = [path.stem for path in paths]
    return {
        path: f"{path.stem if stems.count(path.stem) == 1 else path.name}_trees.jpg"
        for path in paths
    }


def _print_result(pictures: int, trees: int, folder: Path, out: Path, as_json: bool) -> None:
    labels = out / _LABELS_FILE
    if as_json:
        values = {"pictures": pictures, "trees": trees, "out": str(out), "labels": str(labels)}
        print_json({"schema": "perceptree.predict/1", **values})
        return
    tell(f"{counted(trees, 'tree')} in {counted(pictures, 'image')}, drawn in {out}")
    tell(f"next: correct {labels} in a labelling tool that reads COCO, with the images in {folder}")
