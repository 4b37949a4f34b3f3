"""Render tables as Markdown that is aligned for terminals."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from perceptree.tables.paper import CONDITIONS, MEASURES, NOTES, TABLE_MEASURES
from perceptree.tables.verdict import RULE

Record = Mapping[str, Any]

_NONE = "–"
_MODALITIES = {"rgb": "RGB", "depth": "Depth"}


def markdown(tables: Mapping[str, Record]) -> str:
    """Render all tables as one page."""
    parts = ["\n".join(table_lines(tables[number])) for number in sorted(tables)]
    return "\n\n".join(parts) + "\n"


def table_lines(record: Record) -> Iterator[str]:
    """Yield the lines of one table with its conditions and the paper's claims."""
    number = record["table"]
    yield f"# Table {number} of the paper: our results and the paper's"
    yield ""
    yield (
        "Our runs and the paper's differ in data, networks and schedule: compare differences"
        " within our results or within the paper's, not numbers between the two."
    )
    yield ""
    yield from _our_conditions(record["conditions"])
    yield f"- The paper (Grondin et al., 2022): {CONDITIONS['data']}; {CONDITIONS['schedule']};"
    yield f"  {CONDITIONS['seeds']}. {NOTES[number]}"
    if record["finished_runs"] < record["runs"]:
        yield (
            f"- {record['finished_runs']} of {record['runs']} runs are finished so far; repeat the"
            " command to continue."
        )
    yield ""
    yield from _aligned(_rows(record, TABLE_MEASURES[number]))
    yield ""
    yield "The paper's claims:"
    yield ""
    yield from _aligned(_claims(record["claims"]))
    yield ""
    yield RULE


def _our_conditions(found: Record) -> Iterator[str]:
    amount, unit = (
        (found["steps"], "step") if found["minutes"] is None else (found["minutes"], "minute")
    )
    budget = f"{amount:,g} {unit}{'' if amount == 1 else 's'}"
    sizes = _listed(f"{width}x{height}" for width, height in found["inputs_px"])
    seeds = len(found["seeds"])
    yield (
        f"- Ours: trained on {found['frames']:,} frames of {found['data']}, tested on the"
        f" {found['test_frames']:,} test frames ({found['test_trees']:,} trees) of"
        f" {found['test']};"
    )
    yield (
        f"  {budget} per run with batches of {_listed(found['batches'])}, input {sizes} px, recipe"
        f" {_listed(found['recipes'])} with a {found['schedule']} schedule, from"
        f" {_listed(found['starting_weights'])} weights, {_listed(found['precisions'])} on"
        f" {_listed(found['devices'])};"
    )
    yield f"  {'seed' if seeds == 1 else 'seeds'} {_listed(found['seeds'])}: " + (
        "one run each, without a standard deviation."
        if seeds == 1
        else "mean ± standard deviation over the seeds."
    )


def _listed(values: Any) -> str:
    return ", ".join(str(value) for value in values)


def _rows(record: Record, measures: Sequence[str]) -> Iterator[list[str]]:
    heads = [MEASURES[measure] for measure in measures]
    yield ["ours", "tasks", "seeds", "steps", *heads, "the paper's", *heads]
    for row in record["rows"]:
        paper = row["paper"]
        steps = row["steps"]
        yield [
            f"{row['model']}, {_MODALITIES[row['modality']]}",
            row["tasks"],
            str(len(row["seeds"])),
            f"{sum(steps) / len(steps):,.0f}" if steps else _NONE,
            *(_score(row["scores"][measure]) for measure in measures),
            _NONE if paper is None else f"{paper['backbone']}, {paper['modality']}",
            *(_paper_score(paper, measure) for measure in measures),
        ]


def _score(summary: Record | None) -> str:
    if summary is None:
        return _NONE
    spread = summary["deviation"]
    return f"{summary['mean']:.1f}" + ("" if spread is None else f" ± {spread:.1f}")


def _paper_score(paper: Record | None, measure: str) -> str:
    if paper is None or measure not in paper["scores"]:
        return _NONE
    return f"{paper['scores'][measure]:.2f}"


def _claims(claims: Sequence[Record]) -> Iterator[list[str]]:
    yield ["claim", "the paper's difference", "our difference", "95 % interval", "ours"]
    for claim in claims:
        interval = claim["interval"]
        yield [
            claim["claim"],
            _signed(claim["paper_difference"], 2),
            _signed(claim["difference"], 1),
            _NONE if interval is None else f"± {interval:.1f}",
            claim["word"],
        ]


def _signed(value: float | None, digits: int) -> str:
    return _NONE if value is None else f"{value:+.{digits}f}"


def _aligned(rows: Iterator[list[str]]) -> Iterator[str]:
    """Yield a Markdown table with aligned columns."""
    table = list(rows)
    widths = [max(len(row[column]) for row in table) for column in range(len(table[0]))]
    for number, row in enumerate(table):
        cells = (cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        yield f"| {' | '.join(cells)} |"
        if number == 0:
            yield f"| {' | '.join('-' * width for width in widths)} |"
