"""Parts that no shard writes are refused before anything is merged from them."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import pytest

from basetree.jobs import Job, JobError, LocalStore, MergedParts
from edgetree.shards.merging import Outputs, merge_frames

PART = {
    "schema": "edgetree.part/1",
    "frames": [{"name": "a", "trees": [{"tree": 1}, {"tree": 2}]}],
    "csv": "a,1\n",
    "profiles": "",
    "left_out": ["b.jpg: no picture"],
}


def parts_with(folder: Path, content: bytes) -> MergedParts:
    store = LocalStore(folder)
    job = Job(store, "test", {}, 1, 1)
    store.write(job.part(0), content)
    return MergedParts(job, {0: (store, hashlib.sha256(content).hexdigest())})


def test_a_part_is_merged(tmp_path: Path) -> None:
    outputs = Outputs(tmp_path / "a.jsonl", tmp_path / "a.csv")
    parts = parts_with(tmp_path, json.dumps(PART).encode())
    merged = merge_frames(parts, outputs, lines_to_stdout=False)
    assert (merged.frames, merged.trees, merged.left_out) == (1, 2, ["b.jpg: no picture"])
    assert json.loads((tmp_path / "a.jsonl").read_text()) == PART["frames"][0]  # type: ignore[index]
    assert (tmp_path / "a.csv").read_text().splitlines()[-1] == "a,1"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"not json", "Expecting value"),
        (b"\xff", "can't decode"),
        (b"[" * 100_000, "nested too deeply"),
        ([], "it has another schema"),
        (PART | {"schema": "edgetree.part/9"}, "it has another schema"),
        (PART | {"frames": {}}, "frames is an object, expected a list"),
        (PART | {"frames": [3]}, r"frames\[0\] is 3, expected an object"),
        (PART | {"frames": [{}]}, "no field 'trees'"),
        (PART | {"frames": [{"trees": 5}]}, "trees is 5, expected a list"),
        (PART | {"csv": 1}, "csv is 1, expected text"),
        (PART | {"left_out": [1]}, r"left_out\[0\] is 1, expected text"),
        (PART | {"frames": [{"trees": [], "x": 10**400}]}, "is not a number of 64 bits"),
    ],
)
def test_another_part_is_one_line(tmp_path: Path, content: Any, message: str) -> None:
    data = content if isinstance(content, bytes) else json.dumps(content).encode()
    with pytest.raises(JobError, match=message) as raised:
        merge_frames(parts_with(tmp_path, data), Outputs(), lines_to_stdout=False)
    assert "part parts/000000.json is not of schema edgetree.part/1" in str(raised.value)
