"""The paper's table of backbones, with measurements on this machine next to the paper's values.

The paper gives the parameters and multiply-adds of the ImageNet classifiers at 224x224 px, and the
frames per second and average precision of the whole detector at 800x800 px. The counts of its X101
are those of ResNeXt-101 32x4d, although its published code and weights are 32x8d.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final

from edgetree.bench.cells import number_text

PAPER_GPU: Final = "RTX 3090"
_GIGA: Final = 1e9
_MEGA: Final = 1e6

Record = Mapping[str, Any]


@dataclass(frozen=True)
class PaperRow:
    """A row of the paper's tables.

    Attributes:
        name: Name of the backbone in the paper.
        counted_network: This project's name of the network that the counts belong to.
        parameters: Parameters of the ImageNet classifier.
        multiply_adds: Multiply-adds of the ImageNet classifier at 224x224 px; the paper calls them
            FLOPs.
        fps: Frames per second of the detector at 800x800 px on `PAPER_GPU`.
        box_ap: Average precision of boxes on simulated frames, by modality.
        mask_ap: Average precision of masks, likewise.
    """

    name: str
    counted_network: str
    parameters: int
    multiply_adds: int
    fps: float
    box_ap: Mapping[str, float]
    mask_ap: Mapping[str, float]

    def to_dict(self) -> dict[str, Any]:
        """The row as a JSON object."""
        return asdict(self)


_X101: Final = PaperRow(
    "X101-FPN",
    "x101-32x4d",
    44_000_000,
    7_990_000_000,
    10.0,
    {"rgb": 58.34, "depth": 63.9},
    {"rgb": 31.77, "depth": 28.86},
)
PAPER: Final[dict[str, PaperRow]] = {
    "r50": PaperRow(
        "R50-FPN",
        "r50",
        25_600_000,
        3_860_000_000,
        18.0,
        {"rgb": 55.2, "depth": 66.7},
        {"rgb": 31.13, "depth": 31.52},
    ),
    "r101": PaperRow(
        "R101-FPN",
        "r101",
        44_700_000,
        7_580_000_000,
        15.0,
        {"rgb": 56.79, "depth": 68.2},
        {"rgb": 31.72, "depth": 31.98},
    ),
    "x101-32x4d": _X101,
    "x101-32x8d": _X101,
}

_WIDTHS: Final = (10, 7, 6, 7, 6, 7, 8, 8, 8, 7, 7, 6, 6, 7)
# Headings, and the number of columns that each spans.
_GROUPS: Final = (("", 1), (" classifier, 224x224 ", 4), (" this file ", 4), (" this machine ", 5))
_QUANTITIES: Final = (
    ("", 1),
    ("params M", 2),
    ("mult-adds G", 2),
    ("params", 1),
    ("pro-", 1),
    ("mult-", 1),
    ("FLOPs", 1),
    ("p50", 1),
    ("FPS", 2),
    ("box AP", 2),
)
_UNITS: Final = (
    "backbone",
    "here",
    "paper",
    "here",
    "paper",
    "M",
    "posals",
    "adds G",
    "G",
    "ms",
    "here",
    "paper",
    "here",
    "paper",
)


def _cells(row: Record) -> list[str]:
    paper, classifier = row["paper"] or {}, row["classifier"] or {}
    p50_ms, fps = row["p50_ms"], row["fps"]
    accuracy = row.get("accuracy") or {}
    return [
        row["network"],
        number_text(classifier.get("parameters"), 1, _MEGA),
        number_text(paper.get("parameters"), 1, _MEGA),
        number_text(classifier.get("multiply_adds"), 2, _GIGA),
        number_text(paper.get("multiply_adds"), 2, _GIGA),
        number_text(row["parameters"], 1, _MEGA),
        number_text(row["proposals"], 0),
        number_text(row["graph_multiply_adds"], 1, _GIGA),
        number_text(row["graph_flops"], 1, _GIGA),
        f"{p50_ms:.{1 if p50_ms < 100 else 0}f}",
        number_text(fps, 1 if fps >= 10 else 2),
        number_text(paper.get("fps"), 0),
        number_text(accuracy.get("box_ap"), 1),
        number_text(paper.get("box_ap", {}).get(row["modality"]), 1),
    ]


def paper_lines(rows: Sequence[Record]) -> Iterator[str]:
    """Rows of networks as text beside the paper's, at most 100 columns wide, with explanations."""
    yield _heading(_GROUPS)
    yield _heading(_QUANTITIES)
    yield _line(_UNITS)
    for row in rows:
        yield _line(_cells(row))
    yield ""
    yield from _notes(rows)


def _heading(spans: tuple[tuple[str, int], ...]) -> str:
    """A line of headings: centred if they span several columns, else right-aligned."""
    parts, begin = [], 0
    for text, count in spans:
        size = sum(_WIDTHS[begin : begin + count])
        ruled = f"  {text:-^{size - 2}}" if text.startswith(" ") else f"{text:^{size}}"
        parts.append(ruled if count > 1 else f"{text:>{size}}")
        begin += count
    return "".join(parts).rstrip()


def _line(cells: Sequence[str]) -> str:
    first, *rest = zip(cells, _WIDTHS, strict=True)
    return f"{first[0]:{first[1]}}" + "".join(f"{text:>{width}}" for text, width in rest)


def _notes(rows: Sequence[Record]) -> Iterator[str]:
    names = {row["network"] for row in rows}
    yield "mult-adds: multiply-adds; FLOPs: 2 per multiply-add. Paper: parameters and multiply-adds"
    yield "of the backbone as ImageNet classifier at 224x224 px, like the columns next to them;"
    yield f"FPS of the whole network at 800x800 px on an {PAPER_GPU}; AP on its simulated frames."
    if names & {"x101-32x4d", "x101-32x8d"}:
        yield "X101: the paper counts ResNeXt-101 32x4d; its published code and weights are 32x8d."
    untrained = sorted({row["network"] for row in rows if not row["trained"]})
    if untrained:
        yield f"Untrained, for speed only: {', '.join(untrained)}."
