"""The paper's tables 2 and 3, and what is stored of this project beside them."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from benchmarks.figures.pages import card, stored, table
from perceptree.tables.paper import MEASURES, TABLE_2, TABLE_MEASURES

MODELS = ("edge-n-depth", "edge-s-depth", "edge-n-rgb", "edge-s-rgb")
NONE = "–"


def paper_table_2() -> Iterator[str]:
    """The paper's numbers, by backbone and modality."""
    measures = TABLE_MEASURES[2]
    head = ("Backbone", "Modality", *(MEASURES[name] for name in measures))
    rows = (
        (f"{row.backbone} (`{model}`)", row.modality, *(f"{row.scores[m]:.2f}" for m in measures))
        for (model, _), row in TABLE_2.items()
    )
    return table(head, rows)


def our_models() -> Iterator[str]:
    """The packaged files on the two frozen test sets, by their cards."""
    head = ("Model", "Parameters", "Input px", "`test`", "`field-test`")
    rows = []
    for name in MODELS:
        own = card(name)
        size = "x".join(str(px) for px in own["input_px"])
        sets = (own["test"], own["field_test"])
        scores = (
            " / ".join(f"{ap:.1f}" for ap in found["average_precision"].values()) for found in sets
        )
        rows.append((f"`{name}`", f"{own['parameters'] / 1e6:.1f} M", size, *scores))
    return table(head, rows)


def our_table_3() -> Iterator[str]:
    """The rows of table 3 as trained here, beside the paper's."""
    head = ["Ours", "Tasks", "AP bb", "AP mask", "AP kp", "The paper's X-101 on RGB"]
    rows = []
    for row in stored("table3")["tables"]["3"]["rows"]:
        ours = [
            NONE if value is None else f"{value['mean']:.1f} ± {value['deviation']:.1f}"
            for value in row["scores"].values()
        ]
        theirs = (row["paper"]["scores"].get(name) for name in row["scores"])
        paper = " / ".join(NONE if value is None else f"{value:.2f}" for value in theirs)
        rows.append([f"`{row['model']}`, {row['modality']}", row["tasks"], *ours, paper])
    return table(head, rows)


TABLES: dict[str, Callable[[], Iterator[str]]] = {
    "paper-table-2": paper_table_2,
    "paper-our-models": our_models,
    "paper-our-table-3": our_table_3,
}
