"""`edgetree conformance` makes kits and says in plain lines what differs."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from schema_check import check_schema

Cli = Callable[..., Any]


def test_a_kit_is_made_run_and_checked(run_cli: Cli, tmp_path: Path) -> None:
    kit, results = tmp_path / "kit", tmp_path / "results.json"
    made = run_cli("conformance", "make", "depth", "--out", kit, "--json")
    assert made.code == 0
    record = json.loads(made.out)
    assert check_schema(record) == "edgetree.conformance-make/1"
    assert record["trees"] > 20
    ran = run_cli("conformance", "run", kit, "--out", results, "--threads", 1, "--rounds", 1)
    assert (ran.code, ran.out) == (0, "")
    onto = run_cli("conformance", "run", kit, "--out", kit / "kit.json")
    assert (onto.code, "kit.json of the kit" in onto.err) == (2, True)
    checked = run_cli("conformance", "check", kit, results)
    assert checked.code == 0
    assert checked.out.splitlines()[-1] == "passed: it finds the kit's trees"
    assert "ms a frame, 1 thread" in checked.out

    data = json.loads(results.read_text("utf-8"))
    data["frames"][0]["trees"] = []
    results.write_text(json.dumps(data), "utf-8")
    checked = run_cli("conformance", "check", kit, results)
    assert checked.code == 1
    assert "sample_0: tree 1 is missing (score" in checked.out
    record = json.loads(run_cli("conformance", "check", kit, results, "--json").out)
    assert check_schema(record) == "edgetree.conformance-check/1"
    assert record["passed"] is False
    assert record["unmatched"] == len(record["problems"])


def test_a_wrong_path_is_one_line(run_cli: Cli, tmp_path: Path) -> None:
    done = run_cli("conformance", "check", tmp_path / "kit", tmp_path / "results.json")
    assert done.code == 2
    assert done.err.count("\n") == 1
    (tmp_path / "results.json").write_text("{}", "utf-8")
    done = run_cli("conformance", "check", tmp_path / "kit", tmp_path / "results.json")
    assert done.code == 2
    assert "schema edgetree.conformance-results/1" in done.err


def test_a_kit_that_does_not_test_everything_says_so(
    run_cli: Cli, model: Path, tmp_path: Path
) -> None:
    done = run_cli("conformance", "make", model, "--out", tmp_path / "kit")
    assert done.code == 0
    assert "does not test how programs leave such trees out" in done.err
