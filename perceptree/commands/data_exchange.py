"""`perceptree data split`, `merge` and `convert`: write a dataset anew."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import typer

from basetree.counts import counted
from basetree.program.console import note, print_json, tell
from basetree.program.progress import progress
from basetree.program.quoting import quoted
from perceptree.commands.options import CrowdsAsTrees, Json, SkipBroken
from perceptree.errors import DatasetError

if TYPE_CHECKING:
    from perceptree.data.coco import FrameRecord
    from perceptree.data.dataset import Dataset

_Source: TypeAlias = Annotated[
    Path,
    typer.Argument(
        help="Folder or file with labels: COCO, YOLO, labelme, or an export of CVAT or Label"
        " Studio."
    ),
]
_Out: TypeAlias = Annotated[
    Path, typer.Option(help="New folder for the labels and copies of the pictures.")
]
_Form: TypeAlias = Annotated[
    str,
    typer.Option(
        "--to", metavar="NAME", help="Form to write: coco, yolo-seg, yolo-pose or labelme."
    ),
]


def split(
    source: _Source,
    out: _Out,
    val: Annotated[float, typer.Option(help="Share of the pictures for val.")] = 0.15,
    test: Annotated[float, typer.Option(help="Share of the pictures for test.")] = 0.15,
    by: Annotated[
        str,
        typer.Option(
            metavar="NAME",
            help="What stays in one split beside pictures that look alike and those of one"
            " simulated scene: folder (pictures of one folder), name (names that differ in the"
            " number at the end, such as frames of a video), or likeness (nothing else).",
        ),
    ] = "likeness",
    seed: Annotated[int, typer.Option(help="Seed of the random choice.")] = 1,
    crowds_as_trees: CrowdsAsTrees = False,
    skip_broken: SkipBroken = False,
    as_json: Json = False,
) -> None:
    """Divide labelled pictures into train, val and test."""
    from perceptree.data.dividing import divide

    datasets = _read(source, out, "coco", crowds_as_trees, skip_broken)
    frames = [frame for _, dataset in datasets for frame in dataset.frames]
    if len(datasets) > 1:
        named = ", ".join(str(split) for split, _ in datasets)
        note(f"pictures of {named} are divided anew")
    with progress("comparing pictures", len(frames), shown=not as_json) as bar:
        splits = divide(frames, {"val": val, "test": test}, by, seed, bar.update)
    _write(out, splits, "coco", as_json, _folders(datasets))


def merge(
    masks: Annotated[Path, typer.Argument(help="COCO file with masks or boxes.")],
    keypoints: Annotated[Path, typer.Argument(help="COCO file with keypoints of the pictures.")],
    out: _Out,
    crowds_as_trees: CrowdsAsTrees = False,
    as_json: Json = False,
) -> None:
    """Join the masks of one COCO file with the keypoints of another.

    Annotations of one picture belong together if at least half of the keypoints lie in the box.
    """
    from perceptree.data.dataset import read_labels
    from perceptree.data.exchange.writing import check_output
    from perceptree.data.layouts import find_splits

    for path in (masks, keypoints):
        if not path.is_file():
            raise DatasetError(f"{path}: no such file, expected a COCO file")
    check_output(out, "coco", masks)
    (labels,) = find_splits(masks)
    dataset = read_labels(replace(labels, keypoints=keypoints), crowds_as_trees=crowds_as_trees)
    _tell_notes(dataset)
    split = labels.split if labels.names_split else None
    _write(out, {split: dataset.frames}, "coco", as_json, [labels.root])


def convert(
    source: _Source,
    out: _Out,
    form: _Form = "coco",
    crowds_as_trees: CrowdsAsTrees = False,
    skip_broken: SkipBroken = False,
    as_json: Json = False,
) -> None:
    """Convert labels between COCO, YOLO and labelme, and from CVAT and Label Studio."""
    datasets = _read(source, out, form, crowds_as_trees, skip_broken)
    splits: dict[str | None, list[FrameRecord]] = {}
    for split, dataset in datasets:
        splits.setdefault(split, []).extend(dataset.frames)
    _write(out, splits, form, as_json, _folders(datasets))


def _folders(datasets: Sequence[tuple[str | None, Dataset]]) -> list[Path]:
    return sorted({dataset.labels.root for _, dataset in datasets})


def _read(
    source: Path, out: Path, form: str, crowds_as_trees: bool, skip_broken: bool
) -> list[tuple[str | None, Dataset]]:
    from perceptree.data.entries import EntryError
    from perceptree.data.exchange.reading import read_any
    from perceptree.data.exchange.writing import check_output

    check_output(out, form, source)
    broken: list[EntryError] = []
    try:
        datasets = read_any(source, crowds_as_trees, broken.append if skip_broken else None)
    except DatasetError as error:
        if isinstance(error.__cause__, EntryError):
            raise DatasetError(f"{error}; --skip-broken leaves broken entries out") from error
        raise
    for _, dataset in datasets:
        _tell_notes(dataset)
    if broken:
        note(f"left out {len(broken)} broken entries, the first: {broken[0]}")
    return datasets


def _tell_notes(dataset: Dataset) -> None:
    for line in dataset.notes:
        note(f"{dataset.labels.path}: {line}")


def _write(
    out: Path,
    splits: Mapping[Any, Sequence[FrameRecord]],
    form: str,
    as_json: bool,
    sources: Sequence[Path],
) -> None:
    from perceptree.data.exchange.writing import write_dataset

    for line in write_dataset(out, splits, form, sources):
        note(line)
    counts = {
        split or "all": {
            "pictures": len(frames),
            "trees": sum(not tree.ignored for frame in frames for tree in frame.trees),
        }
        for split, frames in splits.items()
    }
    if as_json:
        values = {"out": str(out), "form": form, "splits": counts}
        print_json({"schema": "perceptree.data-written/1", **values})
        return
    for name, count in counts.items():
        tell(f"{name:5} {counted(count['pictures'], 'picture')}, {counted(count['trees'], 'tree')}")
    tell(out)
    if form == "coco":
        note(f"next: perceptree data check {quoted(out)}")
