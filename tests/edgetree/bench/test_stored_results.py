"""Results of `edgetree bench` that people edited, or that were damaged: read, or one line."""

from __future__ import annotations

import json
import random
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from bench_results import ACCURACY, result_of, row_of
from schema_check import check_schema

from basetree.errors import InputError
from edgetree.bench.compare import compare_results
from edgetree.bench.stored import read_result

RESULT = result_of([row_of(accuracy=ACCURACY), row_of("edge-s-rgb", batch=4)])
VALUES = (None, True, 0, -1, 0.5, 1e308, 2**63, "", "x", [], [1], {}, {"a": 1})


def written(folder: Path, result: Any, name: str = "result.json") -> Path:
    path = folder / name
    path.write_text(json.dumps(result))
    return path


@pytest.mark.parametrize(
    ("place", "value", "message"),
    [
        (("rows",), {}, "rows is an object, expected a list"),
        (("rows", 0), 3, r"rows\[0\] is 3, expected an object"),
        (("rows", 0, "input_px"), [640], r"rows\[0\].input_px is a list of 1 items"),
        (("rows", 0, "input_px"), [640, 0], r"input_px\[1\] is 0, expected a whole number of at l"),
        (("rows", 0, "rounds"), [], r"rounds is a list of 0 items, expected a list of at least 1"),
        (("rows", 0, "rounds", 1, "p50_ms"), 0, r"rounds\[1\].p50_ms is 0, expected a number of"),
        (("rows", 0, "rounds", 1, "p50_ms"), "3", r"rounds\[1\].p50_ms is '3', expected a number"),
        (("rows", 1, "name"), None, r"rows\[1\].name is null, expected text"),
        (("rows", 0, "accuracy", "box_ap"), 101, "box_ap is 101, expected a number of at most 100"),
        (("environment",), [], "environment is a list of 0 items, expected an object"),
        (("environment", "usable_cores"), 2.5, "usable_cores is 2.5, expected a whole number"),
    ],
)
def test_a_wrong_field_is_named(
    run_cli: Any, tmp_path: Path, place: tuple[Any, ...], value: Any, message: str
) -> None:
    result = json.loads(json.dumps(RESULT))
    inner = result
    for step in place[:-1]:
        inner = inner[step]
    inner[place[-1]] = value
    path = written(tmp_path, result)
    with pytest.raises(InputError, match=message):
        read_result(path)
    done = run_cli("compare", path, written(tmp_path, RESULT, "new.json"))
    assert (done.code, done.out) == (2, "")
    assert done.err.startswith(f"edgetree: {path}")
    assert len(done.err.splitlines()) == 1


def places(value: Any) -> Iterator[tuple[Any, Any]]:
    """All containers of a JSON value, with each of their keys."""
    if isinstance(value, dict | list):
        for key in value if isinstance(value, dict) else range(len(value)):
            yield value, key
            yield from places(value[key])


@pytest.mark.parametrize("seed", range(4))
def test_every_field_may_be_missing_or_of_another_kind(tmp_path: Path, seed: int) -> None:
    rng = random.Random(seed)
    good = read_result(written(tmp_path, RESULT))
    read = refused = 0
    for number in range(len(list(places(RESULT)))):
        changed = json.loads(json.dumps(RESULT))
        inside, key = list(places(changed))[number]
        if rng.random() < 0.3:
            del inside[key]
        else:
            inside[key] = rng.choice(VALUES)
        try:
            found = compare_results(good, read_result(written(tmp_path, changed, "new.json")))
        except InputError:
            refused += 1
        else:
            assert json.dumps(found.to_dict(), allow_nan=False)
            check_schema(found.to_dict())
            assert list(found.lines())
            read += 1
    assert min(read, refused) > 20
