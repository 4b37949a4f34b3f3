"""Tables as Markdown: our results and the paper's, conditions, claims."""

import json
from collections.abc import Callable
from typing import Any

import pytest

from perceptree.tables import table_lines
from perceptree.tables.page import markdown

MadeTable = Callable[..., dict[str, Any]]


def row_of(lines: list[str], *starts: str) -> list[str]:
    """Return the cells of the only row that starts with these cells."""
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    (found,) = [row for row in rows if tuple(row[: len(starts)]) == starts]
    return found


def test_a_row_has_our_scores_and_the_papers(made_table: MadeTable) -> None:
    lines = list(table_lines(made_table()))
    assert row_of(lines, "edge-n, Depth", "keypoint & mask")[2:] == [
        "2",
        "900",
        "47.1 ± 0.1",
        "40.2 ± 0.1",
        "60.1 ± 0.1",
        "X-101, RGB",
        "58.34",
        "31.77",
        "80.19",
    ]
    assert row_of(lines, "edge-n, Depth", "mask-only")[6] == "–"
    assert row_of(lines, "edge-n, RGB", "keypoint & mask")[4] == "30.1 ± 0.1"


def test_every_claim_of_the_paper_is_judged(made_table: MadeTable) -> None:
    claims = {claim["claim"]: claim for claim in made_table()["claims"]}
    words = {text.partition(" (")[0]: claim["word"] for text, claim in claims.items()}
    assert words == {
        "the mask branch raises AP bb": "disagrees",
        "the mask branch raises AP kp": "agrees",
        "the keypoint branch lowers AP bb": "agrees",
        "the keypoint branch lowers AP mask": "undecided",
        "edge-n: depth has a higher AP bb than RGB": "agrees",
    }
    signed = [round(claim["paper_difference"], 2) for claim in claims.values()]
    assert signed == [0.63, 0.06, -0.91, -0.88, 5.56]
    assert [round(claim["difference"], 2) for claim in claims.values()] == [
        -2.0,
        5.0,
        -3.0,
        0.1,
        17.0,
    ]


def test_one_seed_decides_nothing_and_has_no_deviation(made_table: MadeTable) -> None:
    record = made_table(seeds=1)
    assert {claim["word"] for claim in record["claims"]} == {"undecided"}
    lines = list(table_lines(record))
    assert row_of(lines, "edge-n, Depth", "mask-only")[4] == "50.0"


def test_conditions_of_both_are_listed(made_table: MadeTable) -> None:
    text = " ".join(table_lines(made_table()))
    for part in (
        "trained on 9,000 frames of forest",
        "400 test frames (1,600 trees) of frozen",
        "10 minutes per run",
        "batches of 8",
        "640x384 px",
        "recipe scratch",
        "cosine",
        "random weights",
        "fp32 on 2 CPU cores",
        "seeds 0, 1: mean ± standard deviation",
        "SynthTree43k: 40,000 training frames",
        "table 3 is for ResNeXt-101 on RGB",
    ):
        assert part in text, part
    assert "so far" not in text


def test_an_unfinished_table_says_so(made_table: MadeTable) -> None:
    both = {"box_ap": (47.0, 47.2), "mask_ap": (40.1, 40.3), "keypoint_ap": (60.0, 60.2)}
    record = made_table({("depth", "keypoint & mask"): both})
    lines = list(table_lines(record))
    assert "2 of 8 runs are finished so far" in " ".join(lines)
    assert row_of(lines, "edge-n, RGB")[2:7] == ["0", "–", "–", "–", "–"]
    assert {claim["word"] for claim in record["claims"]} == {"undecided"}


def test_table_2_pairs_our_models_with_the_papers(made_table: MadeTable) -> None:
    scores = {
        (modality, "keypoint & mask"): {
            "box_ap": (value, value + 0.1),
            "mask_ap": (value / 2, value / 2),
            "box_ap50": (80, 81),
            "mask_ap50": (70, 70),
        }
        for modality, value in (("rgb", 55.0), ("depth", 50.0))
    }
    record = made_table(scores, table=2, models=("r50", "edge-m"), minutes=None, steps=1)
    lines = list(table_lines(record))
    assert row_of(lines, "r50, Depth")[4:] == [
        "50.0 ± 0.1",
        "25.0 ± 0.0",
        "80.5 ± 0.7",
        "70.0 ± 0.0",
        "R-50, Depth",
        "66.70",
        "31.52",
        "89.67",
        "70.66",
    ]
    assert row_of(lines, "edge-m, RGB")[8:] == ["–"] * 5
    assert [claim["word"] for claim in record["claims"]] == ["disagrees"] * 2
    assert record["claims"][0]["paper_difference"] == pytest.approx(11.5)
    assert record["claims"][1]["paper_difference"] is None
    assert "1 step per run" in " ".join(lines)


def test_both_tables_are_on_one_page(made_table: MadeTable) -> None:
    record = json.loads(json.dumps(made_table()))
    page = markdown({"3": record, "2": record | {"table": 2, "rows": [], "claims": []}})
    assert page.index("# Table 2 of the paper") < page.index("# Table 3 of the paper")
