"""Manifests of shards that were damaged or come from strangers."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import pytest

from basetree.jobs import JobError, LocalStore, StoreError, read_manifests
from basetree.jobs.shard import Shard


def store_with(where: Path, /, **changes: Any) -> LocalStore:
    """A finished job of one unit, with other fields in its manifest."""
    store = LocalStore(where)
    store.write("parts/000000.json", b"unit")
    record = {
        "schema": "edgetree.shard/1",
        "kind": "test",
        "identity": {"seed": 1},
        "frames": 3,
        "block": 4,
        "folder": "parts",
        "shard": "1/1",
        "parts": {"0": hashlib.sha256(b"unit").hexdigest()},
    }
    store.write(Shard().file, json.dumps(record | changes).encode())
    return store


def test_a_whole_manifest_is_read(tmp_path: Path) -> None:
    assert list(read_manifests([store_with(tmp_path, later=[1])], ("test",))) == [b"unit"]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"block": 0}, "block is 0, expected a whole number of at least 1"),
        ({"block": "x"}, "block is 'x', expected a whole number"),
        ({"block": 0.5}, "block is 0.5, expected a whole number"),
        ({"block": {}}, "block is an object, expected a whole number"),
        ({"frames": -1}, "frames is -1, expected a whole number of at least 0"),
        ({"frames": 10**12}, "1 parts, expected the 250000000000 of shard 1/1"),
        ({"frames": 10**400}, "is not a number of 64 bits"),
        ({"frames": 10**12, "shard": "1/100000"}, "1 parts, expected the 2500000 of shard"),
        ({"shard": "1/3"}, None),
        ({"shard": "0/1"}, "--shard is '0/1'"),
        ({"shard": 1}, "shard is 1, expected text"),
        ({"parts": {}}, "0 parts, expected the 1 of shard 1/1 of 3 frames"),
        ({"parts": {"1": "0" * 64}}, "1 parts, expected the 1 of shard 1/1"),
        ({"parts": {"0": "0"}}, r"parts\[...\]: expected text matching"),
        ({"parts": []}, "parts is a list of 0 items, expected an object"),
        ({"identity": 3}, "identity is 3, expected an object"),
        ({"folder": "../../etc"}, "folder '../../etc' is not inside the store"),
        ({"folder": "/etc"}, "folder '/etc' is not inside the store"),
        ({"folder": None}, "folder is null, expected text"),
    ],
)
def test_a_manifest_that_no_shard_writes_is_one_line(
    tmp_path: Path, changes: dict[str, Any], message: str | None
) -> None:
    store = store_with(tmp_path, **changes)
    if message is None:
        assert list(read_manifests([store], ("test",))) == [b"unit"]
        return
    with pytest.raises(StoreError, match=message) as raised:
        read_manifests([store], ("test",))
    assert str(raised.value).startswith(f"{tmp_path}/shards/000001-of-000001.json: is not a man")


@pytest.mark.parametrize(
    "content", [b"{", b"\xff", b"[" * 100_000, b'{"schema": "edgetree.shard/1", "a": 1, "a": 2}']
)
def test_another_text_is_one_line(tmp_path: Path, content: bytes) -> None:
    store = store_with(tmp_path)
    store.write(Shard().file, content)
    with pytest.raises(StoreError, match="is not a manifest of a shard"):
        read_manifests([store], ("test",))


def test_a_large_manifest_is_not_read(tmp_path: Path) -> None:
    store = store_with(tmp_path)
    with (tmp_path / Shard().file).open("wb") as stream:
        stream.truncate(2**40)
    with pytest.raises(StoreError, match="1099511627776 bytes, at most 16777216"):
        read_manifests([store], ("test",))


def test_very_many_missing_shards_are_counted_without_a_list(tmp_path: Path) -> None:
    digest = {"0": hashlib.sha256(b"unit").hexdigest()}
    store = store_with(tmp_path, frames=400_000, shard="1/100000", parts=digest)
    with pytest.raises(JobError, match=r"99999 of 100000 parts .* 6/100000 and 99994 more to"):
        read_manifests([store], ("test",))


@pytest.mark.parametrize("target", ["/dev/zero", "."])
def test_a_part_that_is_no_regular_file_is_not_read(tmp_path: Path, target: str) -> None:
    store = store_with(tmp_path)
    (tmp_path / "parts/000000.json").unlink()
    (tmp_path / "parts/000000.json").symlink_to(target)
    with pytest.raises(StoreError, match=r"000000\.json: cannot be read .*expected a regular file"):
        list(read_manifests([store], ("test",)))
