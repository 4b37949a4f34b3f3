"""Results as text, CSV, Markdown and page: the figures of the JSON, whole and readable."""

from __future__ import annotations

import csv
import json
import re
from html.parser import HTMLParser
from io import StringIO
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Any

import pytest
from bench_results import ACCURACY, result_of, row_of

from basetree.errors import InputError
from edgetree.bench.page import page_html
from edgetree.bench.paper_table import PAPER
from edgetree.bench.result import csv_text, markdown_text, notes
from edgetree.bench.stages import STAGES
from edgetree.bench.stored import read_result
from edgetree.bench.text_table import text_lines
from edgetree.bench.winner import fastest_rows

NAMES = ["r50", "r101", "x101-32x4d", "x101-32x8d", "edge-n"]


def paper_text() -> str:
    return "\n".join(text_lines(result_of([row_of(name) for name in NAMES], list(NAMES))))


def row_in(text: str, name: str) -> list[str]:
    """The last line of a text that begins with a name: that of the paper's table."""
    return [line.split()[1:] for line in text.splitlines() if line.startswith(f"{name} ")][-1]


def test_each_row_is_compared_with_the_paper() -> None:
    text = paper_text()
    counts = "25.6 {} 3.86 {} 124.7 1000 510.4 1020.8 12346 0.08 {} - {}"
    assert row_in(text, "r50") == counts.format("25.6", "3.86", "18", "55.2").split()
    assert row_in(text, "r101") == counts.format("44.7", "7.58", "15", "56.8").split()
    assert row_in(text, "x101-32x4d") == counts.format("44.0", "7.99", "10", "58.3").split()
    assert row_in(text, "edge-n") == counts.format("-", "-", "-", "-").split()
    assert "the paper counts ResNeXt-101 32x4d; its published code and weights are 32x8d" in text
    assert "FLOPs: 2 per multiply-add" in text
    assert "Untrained, for speed only: edge-n, r101, r50, x101-32x4d, x101-32x8d." in text


def test_the_tables_fit_a_terminal_of_100_columns() -> None:
    lines = paper_text().splitlines()
    assert max(map(len, lines[: 1 + len(NAMES)])) <= 100
    header = next(index for index, line in enumerate(lines) if line.startswith("backbone"))
    table = lines[header : header + 1 + len(NAMES)]
    assert {len(line) for line in table} == {len(lines[header])}
    assert len(lines[header]) <= 100


def test_the_shipped_models_fit_a_terminal_of_80_columns() -> None:
    row = {**row_of("edge-n-depth", accuracy=ACCURACY), "precision": "int8", "input_px": [640, 384]}
    times = {"p50_ms": 70.1, "p90_ms": 74.3, "p99_ms": 99.9, "fps": 14.3, "share_of_peak": 0.16}
    head, line, *_ = text_lines(result_of([{**row, **times, "peak_memory_mib": 172.0}]))
    assert "bat" not in head
    assert len(head) == len(line) <= 80
    assert "bat" in next(iter(text_lines(result_of([{**row, "batch": 4}]))))


def test_a_result_without_networks_of_the_paper_has_no_papers_table() -> None:
    text = "\n".join(text_lines(result_of([row_of(accuracy=ACCURACY)])))
    assert "paper" not in text
    assert "58.3" in text
    assert "decode 1.5, pre 2.5, trunk 3.5" in text
    assert "Peak of this machine with 2 threads" in text


def test_the_csv_has_every_row_with_its_stages_and_accuracy() -> None:
    rows = list(
        csv.DictReader(StringIO(csv_text(result_of([row_of(accuracy=ACCURACY), row_of()]))))
    )
    assert [row["box_ap"] for row in rows] == ["58.34", ""]
    assert rows[0]["p50_ms"] == "12345.6"
    assert (rows[0]["width_px"], rows[0]["height_px"]) == ("800", "800")
    assert float(rows[0]["measure_ms"]) == 1.5 + STAGES.index("measure")


def test_the_markdown_table_is_even() -> None:
    text = markdown_text(result_of([row_of(accuracy=ACCURACY), row_of(share_of_peak=None)]))
    table = [line for line in text.splitlines() if line.startswith("|")]
    assert len({line.count("|") for line in table}) == 1
    assert "| 42 % | 58.3 | 15 |" in table[2]
    assert "Median of 3 rounds of 1 s in turn" in text


class _Cells(HTMLParser):
    """The cells of all tables of a page, by row."""

    def __init__(self) -> None:
        super().__init__()
        self.rows: list[list[str]] = []
        self._inside = False

    def handle_starttag(self, tag: str, attrs: Any) -> None:
        if tag == "tr":
            self.rows.append([])
        self._inside = tag in ("td", "th")

    def handle_data(self, data: str) -> None:
        if self._inside:
            self.rows[-1].append(data)


def test_the_figures_of_the_page_are_those_of_the_result() -> None:
    heat = [{"minute": 0.5 * n, "p50_ms": 20.0, "p99_ms": 25.0, "fps": 50.0} for n in range(1, 4)]
    rows = [row_of("r50", accuracy=ACCURACY, p50_ms=41.237, heat=heat), row_of("<b>")]
    html = "".join(page_html(result_of(rows, ["r50", None])))
    cells = _Cells()
    cells.feed(html)
    speed = dict(zip(cells.rows[0], cells.rows[1], strict=True))
    table = speed | dict(zip(cells.rows[3], cells.rows[4], strict=True))
    assert (table["p50 ms"], table["box AP"], table["memory MiB"]) == ("41.24", "58.3", "3210")
    assert (table["multiply-adds G"], table["parameters M"]) == ("510.40", "124.70")
    assert cells.rows[2][0] == "<b>"
    assert "<b>:" not in html, "names are escaped"
    assert "<script" not in html
    assert "A long run" in html
    assert re.search(r"r50: 41\.2 ms, 58\.3 AP", html)
    assert all(f"{stage}: " in html for stage in STAGES)


def test_the_page_has_no_counts_of_a_classifier_that_is_not_known() -> None:
    cells = _Cells()
    cells.feed("".join(page_html(result_of([row_of("r50", classifier=None)], ["r50"]))))
    (row,) = [each for each in cells.rows if len(each) == 9 and each[0] == "r50"]
    assert row[1:5] == ["-", "25.6", "-", "3.86"]


def test_a_stored_result_is_read_again(tmp_path: Path) -> None:
    path = tmp_path / "result.json"
    result = result_of([row_of("r50")], ["r50"])
    path.write_text(json.dumps(result))
    (row,) = read_result(path).rows
    assert row.key == "r50 float32 800x800 cpu, 2 threads, batch 1"
    assert [each.p50_ms for each in row.rounds] == [12345.6] * 3
    assert result["rows"][0]["paper"]["counted_network"] == "r50"
    assert result["rows"][0]["graph_flops"] == 2 * result["rows"][0]["graph_multiply_adds"]


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        ("{", "is not JSON"),
        ('{"schema": "edgetree.bench/1"}', "'edgetree.bench/1'"),
        ("[]", "list"),
    ],
)
def test_other_files_are_refused(tmp_path: Path, content: str, problem: str) -> None:
    path = tmp_path / "result.json"
    path.write_text(content)
    with pytest.raises(InputError, match=rf"{path}.*{problem}.*schema edgetree.bench/2"):
        read_result(path)


def test_the_papers_counts_are_those_of_the_classifiers() -> None:
    pytest.importorskip("torch")
    from perceptree.models import make_spec
    from perceptree.models.cost import classifier_cost

    for network in ("r50", "r101", "x101-32x4d"):
        spec = make_spec(network, "rgb")
        counted = classifier_cost(spec.backbone, spec.stride_in_1x1)
        assert counted.multiply_adds == pytest.approx(PAPER[network].multiply_adds, rel=0.01)
        assert counted.parameters == pytest.approx(PAPER[network].parameters, rel=0.01)


def timed(name: str, *p50_ms: float) -> Any:
    """A row with these medians of its rounds."""
    rounds = [{"p50_ms": each, "p90_ms": each, "p99_ms": each, "fps": 1.0} for each in p50_ms]
    return row_of(name, p50_ms=median(p50_ms), rounds=rounds)


def test_the_fastest_variant_is_named_if_it_is_faster_than_noise_explains() -> None:
    clear = result_of([timed("quick", 20, 21, 20), timed("slow", 30, 31, 30)])
    assert [row["name"] for row in fastest_rows(clear)] == ["quick"]
    assert "Fastest: quick float32" in next(notes(clear))
    assert "fastest: quick" in "".join(page_html(clear))
    close = result_of([timed("quick", 20, 24, 19), timed("slow", 23, 20, 25)])
    assert len(fastest_rows(close)) == 2
    assert next(notes(close)).startswith("No fastest variant: these are as fast as each other")
    assert "fastest: " not in "".join(page_html(close))
    assert next(notes(result_of([timed("alone", 20, 21)]))).startswith("a processor")


def test_a_busy_machine_names_no_fastest_variant() -> None:
    result = result_of([timed("quick", 20, 21, 20), timed("slow", 30, 31, 30)])
    result["environment"] |= {"busy_cores": 0.9, "cores": 2}
    assert len(fastest_rows(result)) == 1
    result["environment"] |= {"busy_cores": 20.0, "cores": 2}
    assert fastest_rows(result) == []
    expected = "other work put a load of 20.0 on 2 cores in the last minute"
    assert next(notes(result)).startswith(f"Busy machine: {expected}, so that times are too long")
    html = "".join(page_html(result))
    assert "the machine was busy with other work" in html
    assert "fastest: " not in html


def test_names_of_dots_do_not_cover_each_other() -> None:
    rows = [
        row_of(f"forest-{n}", p50_ms=20.0, accuracy=ACCURACY | {"box_ap": 58 + n / 100})
        for n in range(6)
    ]
    html = "".join(page_html(result_of(rows)))
    found = re.findall(r'y="([\d.]+)" text-anchor="(\w+)">forest-\d<', html)
    assert len(found) == 6
    heights = sorted(float(y) for y, _ in found)
    assert all(high - low > 10 for low, high in pairwise(heights))
