"""Build a table run by run; finished runs are kept and the table is written after each."""

from __future__ import annotations

import dataclasses
import json
import os
import statistics
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from basetree.errors import SettingsError
from basetree.files.regular import read_regular
from basetree.files.writing import write_text
from perceptree.errors import CheckpointError
from perceptree.tables.page import markdown
from perceptree.tables.paper import TABLE_MEASURES
from perceptree.tables.plan import Claim, Row, TableModel, TableSettings
from perceptree.tables.results import Result, TableData, Watch, check_specs, make_result
from perceptree.tables.verdict import judge
from perceptree.training import Engine

JSON_FILE, PAGE_FILE = "tables.json", "tables.md"
_SCHEMA = "perceptree.tables/1"

Results = Mapping[TableModel, Sequence[Result]]
Record = dict[str, Any]


def build_table(
    settings: TableSettings,
    data: Path,
    test: Path,
    out: Path,
    engine: Engine,
    watch: Watch | None = None,
) -> Record:
    """Train and evaluate every run of a table.

    `tables.json` and `tables.md` in `out` are updated after each run; they may hold both
    tables. Finished runs are reused. All models are trained for one seed before the next seed, so
    that a complete table is available early.

    Args:
        settings: The table.
        data: Folder of the training data.
        test: Folder of the test data.
        out: Folder of the runs and the tables.
        engine: Device and precision.
        watch: Progress callbacks.

    Returns:
        The table as JSON values.

    Raises:
        DatasetError: If data are missing or incomplete.
        SettingsError: If a setting is invalid.
        CheckpointError: If `out` holds other runs. Errors are raised before the first training
            where possible.
    """
    if int(os.environ.get("WORLD_SIZE", "1")) > 1:
        raise SettingsError("WORLD_SIZE is above 1: expected a single process for tables")
    watch = watch or Watch()
    check_specs(settings)
    opened = TableData.open(data, test, watch.preparing)
    known = read_tables(out / JSON_FILE)
    results: dict[TableModel, list[Result]] = {row.model: [] for row in settings.rows()}
    total = len(results) * len(settings.seeds)
    runs = [(seed, model) for seed in settings.seeds for model in results]
    record: Record = {}
    for number, (seed, model) in enumerate(runs, start=1):
        watch.run(f"{model.name}-seed{seed}", number, total)
        results[model].append(make_result(settings, model, seed, opened, out, engine, watch))
        record = record_of(settings, results)
        known["tables"][str(settings.table)] = record
        write_text(out / JSON_FILE, json.dumps(known, indent=1))
        write_text(out / PAGE_FILE, markdown(known["tables"]))
    return record


def read_tables(path: Path) -> Record:
    """Read the finished tables of a folder; none if there is no file.

    Raises:
        CheckpointError: If the file holds something else.
    """
    if not path.exists():
        return {"schema": _SCHEMA, "tables": {}}
    try:
        known = json.loads(read_regular(path))
        if known["schema"] == _SCHEMA and markdown(known["tables"]):
            return dict(known)
    except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError):
        pass
    raise CheckpointError(f"{path}: not a tables file of this project, expected another folder")


def record_of(settings: TableSettings, results: Results) -> Record:
    """Return the table of the finished runs, at least one, as JSON values."""
    done = [result for of_model in results.values() for result in of_model]
    return {
        "table": settings.table,
        "finished_runs": len(done),
        "runs": len(results) * len(settings.seeds),
        "conditions": _conditions(settings, done),
        "rows": [_row(row, settings, results[row.model]) for row in settings.rows()],
        "claims": [_claim(claim, results) for claim in settings.claims()],
    }


def _conditions(settings: TableSettings, done: Sequence[Result]) -> Record:
    """Return the common conditions of all runs; lists where the runs may differ."""

    first = done[0]
    specs = [result["training"]["spec"] for result in done]
    return {
        "data": first["training"]["data"]["folder"],
        "frames": first["made"]["frames"],
        "test": first["test"]["folder"],
        "test_frames": first["metrics"]["frames"],
        "test_trees": first["metrics"]["trees"],
        "recipes": sorted({settings.recipe_of(row.model) for row in settings.rows()}),
        "schedule": "cosine",
        "steps": settings.steps,
        "minutes": settings.minutes,
        "batches": _distinct(r["training"]["settings"]["batch"] for r in done),
        "inputs_px": _distinct([spec["width"], spec["height"]] for spec in specs),
        "starting_weights": _distinct(r["training"]["init"]["name"] for r in done),
        "precisions": _distinct(r["made"]["precision"] for r in done),
        "devices": _distinct(r["made"]["device"] for r in done),
        "seeds": list(settings.seeds),
    }


def _distinct(values: Iterable[Any]) -> list[Any]:
    found: list[Any] = []
    for value in values:
        if value not in found:
            found.append(value)
    return found


def _scores(results: Sequence[Result], measure: str) -> list[float]:
    """Return one score per seed; empty if the model has no such branch."""
    values = (result["metrics"][measure] for result in results)
    return [float(value) for value in values if value is not None]


def _row(row: Row, settings: TableSettings, results: Sequence[Result]) -> Record:
    measures = {
        measure: _summary(_scores(results, measure)) for measure in TABLE_MEASURES[settings.table]
    }
    return {
        "tasks": row.model.tasks,
        "model": row.model.preset,
        "modality": row.model.modality,
        "seeds": [result["training"]["settings"]["seed"] for result in results],
        "steps": [result["made"]["steps"] for result in results],
        "scores": measures,
        "paper": None if row.paper is None else dataclasses.asdict(row.paper),
    }


def _summary(values: Sequence[float]) -> Record | None:
    """Return the mean and, for several seeds, the sample standard deviation."""
    if not values:
        return None
    deviation = statistics.stdev(values) if len(values) > 1 else None
    return {"each": list(values), "mean": statistics.fmean(values), "deviation": deviation}


def _claim(claim: Claim, results: Results) -> Record:
    scores = {model: _scores(of_model, claim.measure) for model, of_model in results.items()}
    verdict = judge(scores[claim.model], scores[claim.other], scores.values(), claim.rises)
    return {
        "claim": claim.text,
        "measure": claim.measure,
        "paper_difference": claim.paper_difference,
        **dataclasses.asdict(verdict),
    }
