"""The paper's numbers equal those in its LaTeX source."""

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from perceptree.tables.paper import TABLE_2, TABLE_3


@pytest.fixture
def rows(shared_path: Callable[[str], Path]) -> dict[str, list[list[str]]]:
    """The cells of both tables by label, without LaTeX's commands."""
    text = shared_path("paper/paper.tex").read_text("utf-8")
    found = {}
    for label in ("tab:AP_synth", "tab:multi-task_learning"):
        body = text.split(rf"\label{{{label}}}")[1].split(r"\end{tabular}")[0]
        body = re.sub(r"\\multirow\{2\}\{\*\}|\\text\w\w|\\hline|\\cline\{1-4\}", "", body)
        lines = re.sub(r"[{}\t]|\\(?=&)", "", body).replace(r"keypoint \& mask", "both")
        cells = [[cell.strip() for cell in line.split("&")] for line in lines.split(r"\\")]
        found[label] = [row for row in cells if len(row) > 3]
    return found


def numbers(cells: list[str]) -> list[float]:
    return [float(cell) for cell in cells if re.fullmatch(r"[\d.]+", cell)]


def test_table_2_is_the_papers(rows: dict[str, list[list[str]]]) -> None:
    body = rows["tab:AP_synth"][1:]
    assert [row[1] for row in body] == ["RGB", "Depth"] * 3
    assert [numbers(row) for row in body] == [list(row.scores.values()) for row in TABLE_2.values()]
    assert [row.modality for row in TABLE_2.values()] == ["RGB", "Depth"] * 3
    assert [body[n][0] for n in (0, 2, 4)] == [row.backbone for row in TABLE_2.values()][::2]


def test_table_3_is_the_papers(rows: dict[str, list[list[str]]]) -> None:
    body = [row for row in rows["tab:multi-task_learning"] if numbers(row)]
    assert [numbers(row) for row in body] == [list(row.scores.values()) for row in TABLE_3.values()]
    missing = [row.index("-") for row in body if "-" in row]
    assert missing == [3, 2]  # mask-only has no keypoint AP, keypoint-only no mask AP


def test_the_rows_that_both_tables_have_are_equal() -> None:
    both, of_table_2 = TABLE_3["keypoint & mask"], TABLE_2["x101-32x8d", "rgb"]
    assert both.scores["box_ap"] == of_table_2.scores["box_ap"]
    assert both.scores["mask_ap"] == of_table_2.scores["mask_ap"]
