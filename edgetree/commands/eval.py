"""`edgetree eval`: evaluate a model file on labelled frames."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer

from basetree.program.console import note, print_json, tell_words
from basetree.program.options import expand_groups
from basetree.program.progress import Progress, progress
from edgetree.commands.option_groups import SessionOptions
from edgetree.commands.options import Json, model_record


@expand_groups
def evaluate(
    model: Annotated[
        str,
        typer.Argument(
            metavar="MODEL", help="An exported .onnx file, or a name that `edgetree models` lists."
        ),
    ],
    data: Annotated[Path, typer.Argument(help="Folder of a dataset.")],
    *,
    split: Annotated[str, typer.Option(metavar="NAME", help="train, val or test.")] = "test",
    fold: Annotated[int | None, typer.Option(help="Fold, for datasets with several.")] = None,
    entire_tree: Annotated[
        bool, typer.Option("--entire-tree", help="Use the labels of entire trees (SynthTree43k).")
    ] = False,
    inputs: Annotated[
        str,
        typer.Option(
            metavar="NAME",
            help="Which images a model of colour and depth is shown: both, colour or depth.",
        ),
    ] = "both",
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for report.json and report.html, with plots and pictures."),
    ] = None,
    session: SessionOptions,
    as_json: Json = False,
) -> None:
    """Evaluate a model file on labelled frames, like `perceptree eval` does for a checkpoint.

    Where frames have depth in metres and a camera, scores of trees beyond the reach of the model's
    labels are lowered, as `run` and `live` do.

    Prints the COCO AP of boxes, masks and keypoints and errors in pixels, by distance, weather and
    other conditions. Needs the packages for training.
    """
    from basetree.files.writing import output_folder
    from edgetree.evaluate import evaluate_file, summary_of

    detector, path = session.open_model(model)
    with ExitStack() as stack:
        folder = None if out is None else stack.enter_context(output_folder(out))
        bar: list[Progress] = []

        def show(done: int, frames: int) -> None:
            if not bar:
                bar.append(stack.enter_context(progress("evaluating", frames, shown=not as_json)))
            bar[0].update(done)

        about = model_record(detector, path)
        report = evaluate_file(detector, about, data, split, fold, entire_tree, inputs, show)
        page = None if folder is None else report.write(folder)
    if as_json:
        print_json(report.figures)
        return
    for line in summary_of(report):
        tell_words(line)
    hint = "next: add --out FOLDER for plots and pictures"
    note(hint if page is None else f"open: {page}")
