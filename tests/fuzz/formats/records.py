"""JSON that programs write and people edit: results, kits, cards, shards, labels of drives."""

from __future__ import annotations

import hashlib
import json
import sys
from pathlib import Path
from typing import Any

from basetree.jobs import LocalStore, read_manifests
from edgetree.bench.compare import compare_results
from edgetree.bench.stored import read_result
from edgetree.conformance import compare_results as compare_trees
from edgetree.conformance import read_kit, read_results
from edgetree.conformance.kit import KIT_SCHEMA, read_expected, read_frame
from edgetree.conformance.results import RESULTS_SCHEMA
from edgetree.model_file.card import CARD_SCHEMA, read_card
from edgetree.shards.merging import Outputs, merge_frames
from edgetree.sources.drive import open_drive
from formats.form import Format

sys.path.insert(0, str(Path(__file__).parents[2] / "support"))
import bench_results

_BENCH = bench_results.result_of([bench_results.row_of(accuracy=bench_results.ACCURACY)])
_FRAME = {"name": "a", "file": "frames/a.raw", "width": 4, "height": 2, "channels": 1}
_BOTH = _FRAME | {"name": "b", "file": "frames/b.raw", "channels": 3, "depth_file": "frames/a.raw"}
_TEXTS = dict.fromkeys(("model", "model_sha256", "name", "precision", "project_version"), "x")
_KIT = {
    "schema": KIT_SCHEMA,
    **_TEXTS,
    "input_width": 64,
    "input_height": 32,
    "score_threshold": 0.15,
    "frames": [_FRAME, _BOTH],
}
_POINTS = [[1.0, 2.0, 0.5]] * 5
_TREE = {"score": 0.9, "box_px": [1, 2, 30, 40], "keypoints_px": _POINTS, "mask": [0.5] * 784}
_FOUND = {
    "schema": RESULTS_SCHEMA,
    **dict.fromkeys(("model_sha256", "runtime", "runtime_version", "processor"), "x"),
    "frames": [
        {"name": "a", "trees": [_TREE], "covered": [{"by": 0, "tree": _TREE}]},
        {"name": "b", "trees": []},
    ],
}
_MODEL = b"a model"
_CARD = {
    "schema": CARD_SCHEMA,
    "model_sha256": hashlib.sha256(_MODEL).hexdigest(),
    "for": "pines",
    "test": {"average_precision": {"boxes": 61.2, "masks": None, "keypoints": 50}},
    "speed": {"detect_p50_ms": 31.0},
}
_PART = {
    "schema": "edgetree.part/1",
    "frames": [{"name": "a", "trees": [{"tree": 1}]}],
    **dict.fromkeys(("csv", "profiles"), "a,1"),
    "left_out": ["b.jpg: no picture"],
}
_SHARD = {
    "schema": "edgetree.shard/1",
    "kind": "test",
    "identity": {"seed": 1},
    "frames": 7,
    "block": 4,
    "folder": "parts",
    "shard": "1/2",
    "parts": {"0": hashlib.sha256(json.dumps(_PART).encode()).hexdigest()},
}
_IMAGE = {
    "file_name": "images/000000.jpg",
    "depth_file": "depth/000000.png",
    "imu_file": "imu/000004.csv",
    "time_s": 0.5,
    "camera": {"width": 64, "height": 48, "fx": 60.0, "fy": 60.0, "cx": 31.5, "cy": 23.5},
    "up_camera": [0.0, -1.0, 0.0],
    "pose_world": {"origin_m": [0, 0, 2], "rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]]},
}


def _bytes(value: Any) -> bytes:
    return json.dumps(value).encode()


def _write(path: Path, content: bytes) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
    return path


def _compare_bench(path: Path) -> object:
    good = read_result(_write(path.with_name("old.json"), _bytes(_BENCH)))
    change = compare_results(good, read_result(path))
    return json.dumps(change.to_dict(), allow_nan=False), list(change.lines())


def _kit_beside(path: Path) -> Path:
    folder = path.with_name("kit")
    _write(folder / "frames/a.raw", bytes(16))
    _write(folder / "frames/b.raw", bytes(24))
    _write(folder / "expected.json", _bytes(_FOUND))
    return _write(folder / "kit.json", _bytes(_KIT)).parent


def _read_kit(path: Path) -> object:
    folder = _kit_beside(path)
    _write(folder / "kit.json", path.read_bytes())
    return [read_frame(folder, frame) for frame in read_kit(folder).frames]


def _compare_found(path: Path) -> object:
    return compare_trees(_kit_beside(path), read_results(path))


def _compare_expected(path: Path) -> object:
    folder = _kit_beside(path)
    _write(folder / "expected.json", path.read_bytes())
    found = read_expected(folder)
    return compare_trees(folder, found)


def _read_card(path: Path) -> object:
    return read_card(path, _write(path.with_name("model.onnx"), _MODEL))


def _store(path: Path, shard: dict[str, Any] | bytes, part: bytes) -> LocalStore:
    folder = path.with_name("store")
    content = shard if isinstance(shard, bytes) else _bytes(shard)
    _write(folder / "shards/000001-of-000002.json", content)
    _write(folder / "parts/000000.json", part)
    return LocalStore(folder)


def _read_shard(path: Path) -> object:
    return list(read_manifests([_store(path, path.read_bytes(), _bytes(_PART))], ("test",)))


def _merge(path: Path) -> object:
    content = path.read_bytes()
    digests = {"0": hashlib.sha256(content).hexdigest()}
    store = _store(path, _SHARD | {"frames": 4, "shard": "1/1", "parts": digests}, content)
    outputs = Outputs(*(path.with_name(f"merged.{name}") for name in ("jsonl", "csv", "profiles")))
    return merge_frames(read_manifests([store], ("test",)), outputs, lines_to_stdout=False)


def _play(path: Path) -> object:
    folder = path.with_name("drive")
    _write(folder / "imu/000004.csv", b"")
    _write(folder / "test_RGB.json", path.read_bytes())
    return list(open_drive(folder))


FORMATS = {
    "bench.json": Format((_bytes(_BENCH),), _compare_bench),
    "kit.json": Format((_bytes(_KIT),), _read_kit),
    "found.json": Format((_bytes(_FOUND),), _compare_found),
    "expected.json": Format((_bytes(_FOUND),), _compare_expected),
    "card.json": Format((_bytes(_CARD),), _read_card),
    "shard.json": Format((_bytes(_SHARD),), _read_shard, refused="1 of 2 parts are missing"),
    "part.json": Format((_bytes(_PART),), _merge),
    "drive.json": Format((_bytes({"images": [_IMAGE]}),), _play),
}
