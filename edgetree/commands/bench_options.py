"""The options of `edgetree bench`, in groups."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from edgetree.commands.options import RESULTS, Provider, Strict

if TYPE_CHECKING:
    from edgetree.bench.files import NetworkFiles


@dataclass(frozen=True)
class MeasureOptions:
    """How to measure."""

    panel = "Measuring"

    threads: Annotated[
        str | None,
        typer.Option(
            metavar="LIST",
            help="Threads of one inference, such as 1,2.",
            show_default="all cores",
        ),
    ] = None
    batch: Annotated[
        str,
        typer.Option(
            metavar="LIST",
            help="Frames that are handed over together, such as 1,4. A file runs them in batches of"
            " the size that it was exported for.",
        ),
    ] = "1"
    frames: Annotated[
        Path | None,
        typer.Option(help="Frames as for `run`, up to 16.", show_default="the packaged samples"),
    ] = None
    seconds: Annotated[
        float,
        typer.Option("--seconds", min=0.0, help="Time to measure each variant for, in a round."),
    ] = 1.0
    rounds: Annotated[int, typer.Option(min=1, help="Rounds in which all variants take turns.")] = 5
    minutes: Annotated[
        float,
        typer.Option(
            min=0.0,
            help="After the rounds, run each variant this long without a pause, to see whether the"
            " machine slows down when it is warm.",
        ),
    ] = 0.0
    provider: Provider = "cpu"
    strict: Strict = True

    def thread_counts(self) -> tuple[int, ...]:
        """The numbers of threads.

        Raises:
            InputError: a number is not a whole number from 1 on.
        """
        from edgetree.runtime.session import usable_cores

        return (usable_cores(),) if self.threads is None else _numbers("--threads", self.threads)

    def batches(self) -> tuple[int, ...]:
        """The batches; raises InputError as `thread_counts`."""
        return _numbers("--batch", self.batch)


@dataclass(frozen=True)
class NetworkOptions:
    """Networks by name."""

    panel = "Networks by name"

    backbones: Annotated[
        str | None,
        typer.Option(
            metavar="LIST",
            help="Measure networks by name, such as r50,r101,x101-32x8d,edge-n, beside the paper's"
            " table. Those without a file in --models are first exported with untrained weights,"
            " minutes each, and kept for the next time; or run `edgetree export` before and give"
            " its files as MODEL.",
        ),
    ] = None
    models: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="With --backbones: folder of NAME-PRECISION-WIDTHxHEIGHT.onnx files.",
            show_default="your cache folder",
        ),
    ] = None
    precision: Annotated[
        str | None,
        typer.Option(
            metavar="LIST",
            help="With --backbones: of fp32, fp16 and int8.",
            show_default="fp32",
        ),
    ] = None
    size: Annotated[
        str | None,
        typer.Option(
            metavar="LIST",
            help="With --backbones: input sizes in px, such as 640x384,800x800.",
            show_default="800x800",
        ),
    ] = None
    proposals: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="With --backbones: region proposals per frame.",
            show_default="each network's",
        ),
    ] = None

    def network_files(self, provider: str) -> NetworkFiles | None:
        """The files of the networks; None without --backbones.

        Raises:
            InputError: An option is invalid, or given without --backbones.
        """
        from basetree.errors import InputError
        from edgetree.bench.files import NetworkFiles, cache_folder

        if self.backbones is None:
            names = ("models", "precision", "size", "proposals")
            given = [f"--{name}" for name in names if getattr(self, name) is not None]
            if given:
                raise InputError(f"{', '.join(given)} given without --backbones: expected both")
            return None
        return NetworkFiles(
            _names(self.backbones),
            self.models or cache_folder(),
            _names(self.precision or "fp32"),
            tuple(_size(text) for text in _names(self.size or "800x800")),
            self.proposals,
            provider,
        )


@dataclass(frozen=True)
class BenchFiles:
    """Where the result goes."""

    panel = RESULTS

    out: Annotated[
        Path | None,
        typer.Option(metavar="FILE.json", help="Write the result, for `edgetree compare`."),
    ] = None
    csv: Annotated[Path | None, typer.Option(metavar="FILE.csv", help="Write the rows as CSV.")] = (
        None
    )
    markdown: Annotated[Path | None, typer.Option(help="Write the rows as a Markdown table.")] = (
        None
    )
    report: Annotated[Path | None, typer.Option(help="Write an HTML page with charts.")] = None


def _names(text: str) -> tuple[str, ...]:
    return tuple(part.strip() for part in text.split(","))


def _numbers(option: str, text: str) -> tuple[int, ...]:
    from basetree.errors import InputError

    numbers = tuple(int(part) if part.isdecimal() else 0 for part in _names(text))
    if min(numbers) < 1 or len(set(numbers)) != len(numbers):
        raise InputError(
            f"{option} is {text!r}: expected distinct whole numbers from 1 on, such as 1,2"
        )
    return numbers


def _size(text: str) -> tuple[int, int]:
    from basetree.errors import InputError

    width, _, height = text.partition("x")
    if not (width.isdecimal() and height.isdecimal()):
        raise InputError(f"--size is {text!r}: expected WIDTHxHEIGHT in px, such as 640x384")
    return int(width), int(height)
