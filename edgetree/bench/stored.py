"""Read a result of `edgetree bench` from its file: what `edgetree compare` needs of it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from msgspec import Meta

from basetree.counts import counted
from basetree.files.json import read_json
from edgetree.bench.cells import machine_words
from edgetree.bench.result import SCHEMA

_Count = Annotated[int, Meta(ge=1, le=2**31)]
_Milliseconds = Annotated[float, Meta(ge=1e-6, le=1e9)]
_Percent = Annotated[float, Meta(ge=0, le=100)]


@dataclass(frozen=True)
class StoredRound:
    """One round: the median time of a frame."""

    p50_ms: _Milliseconds


@dataclass(frozen=True)
class StoredAccuracy:
    """Average precisions in percent, None where not measured, and the frames that they are of."""

    frames: str
    box_ap: _Percent | None = None
    mask_ap: _Percent | None = None
    keypoint_ap: _Percent | None = None


@dataclass(frozen=True)
class StoredRow:
    """One model in one setting.

    Attributes:
        name: Name of the model.
        precision: Its precision.
        input_px: Width and height of its input.
        provider: What ran it.
        threads: Threads of one inference.
        batch: Frames of one inference.
        rounds: The rounds, at least one.
        accuracy: Its accuracy; None if it was not measured.
    """

    name: str
    precision: str
    input_px: tuple[_Count, _Count]
    provider: str
    threads: _Count
    batch: _Count
    rounds: Annotated[tuple[StoredRound, ...], Meta(min_length=1)]
    accuracy: StoredAccuracy | None = None

    @property
    def key(self) -> str:
        """What rows of two results must have in common to be compared."""
        width, height = self.input_px
        return (
            f"{self.name} {self.precision} {width}x{height} {self.provider},"
            f" {counted(self.threads, 'thread')}, batch {self.batch}"
        )


@dataclass(frozen=True)
class StoredMachine:
    """The machine that measured."""

    processor: str | None
    usable_cores: _Count

    def __str__(self) -> str:
        return machine_words(self.processor, self.usable_cores)


@dataclass(frozen=True)
class StoredResult:
    """The machine, and the rows."""

    environment: StoredMachine
    rows: tuple[StoredRow, ...]


def read_result(path: Path) -> StoredResult:
    """Read a result of `edgetree bench --out`.

    Raises:
        InputError: The file cannot be read, is not JSON, has another schema, or a field is wrong.
    """
    return read_json(path, SCHEMA, StoredResult, "a result of `edgetree bench --out`")
