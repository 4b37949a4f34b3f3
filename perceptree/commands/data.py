"""`perceptree data`: check, show, divide, join and convert datasets before training."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from basetree.counts import counted
from basetree.errors import SettingsError
from basetree.program.command_line import show_help
from basetree.program.console import note, print_found, print_json, tell, tell_words
from basetree.program.help import new_app
from basetree.program.progress import progress
from basetree.program.quoting import quoted
from perceptree.commands.data_exchange import convert, merge, split
from perceptree.commands.options import CrowdsAsTrees, EntireTree, Fold, Json, check_split

if TYPE_CHECKING:
    from perceptree.data.check import Report

app = new_app("Check, show, divide, join and convert datasets before training.")
_SORT, _LOOK = "Sort", "Look"
app.add(split, "perceptree data split export --out trees --by folder", group=_SORT)
app.add(merge, "perceptree data merge masks.json keypoints.json --out trees", group=_SORT)
app.add(convert, "perceptree data convert trees --to yolo-seg --out trees-yolo", group=_SORT)


@app.callback(invoke_without_command=True)
def data(context: typer.Context) -> None:
    """Print the help if no command is given."""
    show_help(context)


Directory = Annotated[Path, typer.Argument(help="Folder of a dataset, or one COCO file.")]


@app.command(epilog="perceptree data check trees", rich_help_panel=_LOOK)
def check(
    directory: Directory,
    fold: Fold = None,
    entire_tree: EntireTree = False,
    crowds_as_trees: CrowdsAsTrees = False,
    as_json: Json = False,
) -> None:
    """Find missing and broken files, invalid labels, and leakage between splits.

    Exit code 1 if anything is found.
    """
    from perceptree.data.check import Check

    started = Check(directory, fold, entire_tree, crowds_as_trees)
    with progress("checking", len(started), shown=not as_json) as bar:
        report = started.run(progress=bar.update)
    record = {"schema": "perceptree.data-check/1", **report.to_dict()}
    print_found(as_json, lambda: record, lambda: _report_lines(report))
    if report.findings:
        raise typer.Exit(1)
    if not as_json:
        modality = "depth" if all(part.has_depth for part in report.splits) else "rgb"
        note(
            f"next: perceptree train {quoted(directory)} --out runs/{modality} --modality"
            f" {modality}"
        )


def _report_lines(report: Report) -> Iterator[str]:
    for part in report.splits:
        kinds = ("masks", part.has_masks), ("keypoints", part.has_keypoints)
        held = [name for name, there in (*kinds, ("depth", part.has_depth)) if there]
        yield (
            f"{part.split:5} {part.labels}: {counted(part.frames, 'frame')},"
            f" {counted(part.trees, 'tree')},"
            f" with {', '.join(held) or 'boxes only'}"
        )
        yield from (f"      {line}" for line in part.notes)
    yield from map(str, report.findings)
    if not report.findings:
        yield f"nothing found; splits compared by {report.compared_by}"


@app.command(epilog="perceptree data show trees --out pages", rich_help_panel=_LOOK)
def show(
    directory: Directory,
    out: Annotated[Path, typer.Option(help="Folder for the pages.")] = Path("pages"),
    split: Annotated[
        str | None, typer.Option(metavar="NAME", help="train, val or test.", show_default="all")
    ] = None,
    pages: Annotated[int, typer.Option(help="Number of pages.")] = 1,
    per_page: Annotated[int, typer.Option(help="Frames per page.")] = 12,
    seed: Annotated[int, typer.Option(help="Seed for the choice of frames.")] = 1,
    fold: Fold = None,
    entire_tree: EntireTree = False,
    crowds_as_trees: CrowdsAsTrees = False,
) -> None:
    """Draw pages of labelled frames: boxes, mask outlines, keypoints."""
    import cv2

    from basetree.files.writing import write_image
    from perceptree.data.dataset import read_labels
    from perceptree.data.layouts import find_labels, find_splits
    from perceptree.data.show import choose_frames, labelled_pages

    for name, value in (("--pages", pages), ("--per-page", per_page)):
        if value < 1:
            raise SettingsError(f"{name} is {value}: expected at least 1")
    if split is not None:
        check_split(split)
    files = (
        find_splits(directory, fold, entire_tree)
        if split is None
        else [find_labels(directory, split, fold, entire_tree)]
    )
    datasets = [read_labels(labels, crowds_as_trees=crowds_as_trees) for labels in files]
    for dataset in datasets:
        for line in dataset.notes:
            note(f"{dataset.labels.split}: {line}")
    chosen = choose_frames(datasets, pages * per_page, seed)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise SettingsError(
            f"--out {out}: cannot be created ({error.strerror}), expected a writable folder"
        ) from None
    for number, page in enumerate(labelled_pages(chosen, per_page), start=1):
        path = out / f"page_{number:03d}.jpg"
        write_image(path, page, [cv2.IMWRITE_JPEG_QUALITY, 90])
        tell(path)


@app.command(epilog="perceptree data compare photos trees", rich_help_panel=_LOOK)
def compare(
    real: Annotated[Path, typer.Argument(help="Folder of real images.")],
    simulated: Annotated[Path, typer.Argument(help="Folder of perceptree synth, or of images.")],
    out: Annotated[Path, typer.Option(help="HTML page to write.")] = Path("likeness.html"),
    most: Annotated[int, typer.Option(help="Largest number of images per folder.")] = 200,
    as_json: Json = False,
) -> None:
    """Compare real with simulated images: colour, contrast, sharpness, edges, texture."""
    from basetree.files.places import check_folders
    from basetree.files.writing import write_text
    from perceptree.data.likeness import compare_pictures, find_pictures
    from perceptree.data.likeness_page import likeness_page

    if most < 1:
        raise SettingsError(f"--most is {most}: expected at least 1")
    check_folders([out])
    taken, drawn = (find_pictures(folder, most) for folder in (real, simulated))
    with progress("comparing", len(taken) + len(drawn), shown=not as_json) as bar:
        comparison = compare_pictures(taken, drawn, bar.update)
    write_text(out, likeness_page(comparison))
    if as_json:
        values = {**comparison.to_dict(), "page": str(out)}
        print_json({"schema": "perceptree.data-compare/1", **values})
        return
    for difference in comparison.differences[:5]:
        tell_words(
            f"{difference.measure.title}: separation {difference.separation:.2f},"
            f" simulated {difference.shift:+.1f} standard deviations from real"
        )
    tell(out)
