"""Records of trainings, caches and shards with values of another kind: read, or one line."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from json_faults import faults

from basetree.errors import InputError
from perceptree.data import read_split
from perceptree.data.cache import open_cache, read_cache
from perceptree.evaluation.shards import read_predictions
from perceptree.models import make_spec
from perceptree.simulator import SimulatorSettings
from perceptree.simulator.photographs import dataset_credits
from perceptree.simulator.settings.reading import read_settings
from perceptree.tables.build import read_tables
from perceptree.training.credits import joined_credits
from perceptree.training.plot import read_curves

ENTRIES = [
    {"step": 10, "elapsed_s": 2.5, "losses": {"box": 1.5}, "rate": 0.1, "frames_per_s": 3.0}
    | {"waiting_share": 0.5},
    {"step": 10, "elapsed_s": 3.5, "val": {"box_ap": 1.5, "mask_ap": None, "keypoint_ap": 2.0}},
]
PREDICTIONS = [
    {"boxes": [[1, 2, 3, 4]], "scores": [0.5], "keypoints": [[[1, 2, 0.5]] * 5]}
    | {"masks": [{"size": [4, 8], "counts": "48d0"}]},
]
SETTINGS = {"stand": {"stems_per_ha": [400, 500]}, "camera": {"mast_share": 0.5}}
CREDITS = {"sha256": "a", "textures": [{"kind": "bark", "licence": "CC0", "names": ["a"]}]}


def read_all(content: Any, path: Path, read: Callable[[Path], object], text: Any) -> int:
    """Read every faulty variant of a content; return how many were refused."""
    refused = 0
    for what, changed in faults(content):
        path.write_text(text(changed))
        try:
            read(path)
        except InputError as error:
            refused += 1
            assert "expected" in str(error) or "not " in str(error), what  # noqa: PT017
        except Exception as error:  # noqa: BLE001 - what was changed is told
            pytest.fail(f"{what}: {error!r}")
    return refused


def _lines(entries: list[Any]) -> str:
    return "".join(json.dumps(entry) + "\n" for entry in entries)


@pytest.mark.parametrize(
    ("content", "name", "read", "text"),
    [
        (ENTRIES, "log.jsonl", lambda path: read_curves(path.parent, "run"), _lines),
        (PREDICTIONS, "part", lambda path: read_predictions(path.read_bytes(), "a"), json.dumps),
        (SETTINGS, "s.json", lambda path: read_settings(path, SimulatorSettings()), json.dumps),
        (CREDITS, "settings.json", dataset_credits, json.dumps),
        ({"schema": "perceptree.tables/1", "tables": {}}, "t.json", read_tables, json.dumps),
    ],
    ids=["log", "predictions", "settings", "credits", "tables"],
)
def test_any_value_of_another_kind_is_read_or_named(
    content: Any, name: str, read: Callable[[Path], object], text: Any, tmp_path: Path
) -> None:
    assert read_all(content, tmp_path / name, read, text) > 5
    (tmp_path / name).write_bytes(b"\xff\xfe\xfd")
    with pytest.raises(InputError):
        read(tmp_path / name)
    if name != "log.jsonl":  # whose last line may be incomplete
        (tmp_path / name).write_text("[" * 100_000)
        with pytest.raises(InputError):
            read(tmp_path / name)


@pytest.mark.parametrize("step", [1.5, -1, True, 10**400])
def test_a_step_that_is_none_is_named(step: Any, tmp_path: Path) -> None:
    (tmp_path / "log.jsonl").write_text(_lines([ENTRIES[0] | {"step": step}, *ENTRIES]))
    with pytest.raises(InputError, match=r"log\.jsonl: line 1 is no log entry"):
        read_curves(tmp_path, "run")


def test_credits_of_another_kind_are_not_passed_on() -> None:
    known = {"pretrained": [{"weights": "a"}], "photographs": "all"}
    assert joined_credits([known, {"pretrained": [3]}, {}]) == {"pretrained": [{"weights": "a"}]}


def test_a_damaged_cache_is_made_anew(posts: Path, tmp_path: Path) -> None:
    frames, spec = read_split(posts, "train"), make_spec("edge-n", "rgb", 64, 96)
    folder = tmp_path / "cache"
    expected = [sample.boxes.tolist() for sample in open_cache(frames, spec, folder)]
    whole = {file.name: file.read_bytes() for file in folder.iterdir()}
    record = json.loads(whole["cache.json"])
    damaged = [("cache.json", json.dumps(record | {name: []}).encode()) for name in record]
    damaged += [(name, content[: len(content) // 2]) for name, content in whole.items()]
    damaged += [(name, b"") for name in whole]
    for name, content in damaged:
        (folder / name).write_bytes(content)
        assert read_cache(folder) is None or name == "cache.json", name
        again = open_cache(frames, spec, folder)
        assert [sample.boxes.tolist() for sample in again] == expected, name


def test_rows_of_a_cache_that_lead_nowhere_are_noticed(posts: Path, tmp_path: Path) -> None:
    frames, folder = read_split(posts, "train"), tmp_path / "cache"
    starts = open_cache(frames, make_spec("edge-n", "rgb", 64, 96), folder)._tree_starts.copy()
    for place, value in ((0, 1), (2, 10**6), (-1, 3), (1, -5)):
        changed = starts.copy()
        changed[place] = value
        np.save(folder / "tree_starts.npy", changed)
        assert read_cache(folder) is None
