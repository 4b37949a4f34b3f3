"""Options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeAlias

import typer

if TYPE_CHECKING:
    from edgetree.runtime import TreeDetector

__all__ = ["Json", "Model", "Provider", "Strict", "Threads", "open_model"]

Json: TypeAlias = Annotated[
    bool, typer.Option("--json", help="Print one JSON object on stdout, and nothing else there.")
]
Model: TypeAlias = Annotated[
    str, typer.Option(help="An exported .onnx file; or rgb or depth, for those in the package.")
]
Threads: TypeAlias = Annotated[
    int | None, typer.Option(min=1, help="Threads of one inference; all cores if not given.")
]
Provider: TypeAlias = Annotated[
    str,
    typer.Option(
        metavar="NAME",
        help="What runs the model: cpu, cuda, tensorrt, openvino, coreml, directml; or auto, for"
        " the first of them that starts.",
    ),
]
Strict: TypeAlias = Annotated[
    bool,
    typer.Option(
        "--strict/--no-strict",
        help="Fail if --provider cannot be used, or let the processor take over with a warning.",
    ),
]


def open_model(
    model: str,
    threads: int | None,
    score_threshold: float | None = None,
    *,
    provider: str = "cpu",
    strict: bool = True,
) -> tuple[TreeDetector, Path]:
    """The detector for the value of a `Model` option, and its file."""
    from edgetree.runtime import DISPLAY_THRESHOLD, MODALITIES, TreeDetector, default_model

    path = default_model(model) if model in MODALITIES else Path(model)
    threshold = DISPLAY_THRESHOLD if score_threshold is None else score_threshold
    detector = TreeDetector.load(
        path,
        provider=provider,
        strict=strict,
        threads=threads,
        score_threshold=threshold,
    )
    return detector, path
