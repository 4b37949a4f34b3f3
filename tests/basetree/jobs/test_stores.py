"""Stores: folders, object stores that fail now and then or are full, and what is refused."""

import errno
import os
import pickle
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from basetree.errors import MissingPackage
from basetree.jobs import (
    Job,
    LocalStore,
    Progress,
    Shard,
    StoreError,
    copy_folder,
    fetch,
    is_url,
    open_store,
    read_manifests,
    run_shard,
)

MEMORY = "memory://forest/job"


@pytest.fixture(params=["folder", "memory"])
def place(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """A folder, and an object store in memory."""
    if request.param == "folder":
        return str(tmp_path / "store")
    memory = pytest.importorskip("fsspec").filesystem("memory")
    if memory.exists("/forest"):
        memory.rm("/forest", recursive=True)
    return MEMORY


def test_what_is_written_is_there(place: str) -> None:
    store = open_store(place)
    assert store.sizes("parts") == {}
    store.write("parts/a.json", b"one")
    store.write("parts/deeper/b.json", b"two")
    store.write("top.json", b"three!")
    store.write("parts/a.json", b"another")
    assert store.sizes("parts") == {"parts/a.json": 7}
    assert store.sizes("") == {"top.json": 6}
    assert store.read("parts/a.json") == b"another"
    store.remove("parts/a.json")
    store.remove("parts/a.json")
    assert store.sizes("parts") == {}


def test_a_missing_file_is_one_clear_line(place: str) -> None:
    with pytest.raises(StoreError, match=r"store/no\.json|job/no\.json"):
        open_store(place).read("no.json")


def test_files_are_copied_in_both_directions(place: str, tmp_path: Path) -> None:
    (tmp_path / "made" / "in").mkdir(parents=True)
    (tmp_path / "made" / "in" / "a.bin").write_bytes(b"\0\1")
    store = open_store(place)
    copy_folder(tmp_path / "made", store)
    (copy,) = fetch(store, ["in/a.bin"], tmp_path / "fetched")
    assert copy.read_bytes() == b"\0\1"


def test_a_url_survives_being_a_path() -> None:
    pytest.importorskip("fsspec")
    assert is_url(Path("s3://bucket/folder"))
    assert not is_url(Path("/data/s3:/x"))
    assert not is_url("C:/data")
    assert open_store(Path(MEMORY)).where == MEMORY
    assert pickle.loads(pickle.dumps(open_store(MEMORY))).where == MEMORY


@pytest.mark.parametrize("url", ["ftp://host/folder", "http://host/folder", "rtsp://camera/1"])
def test_stores_without_whole_files_are_refused(url: str) -> None:
    with pytest.raises(StoreError, match=f"unknown kind of store '{url[:3]}"):
        open_store(url)


def test_a_missing_package_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "fsspec.py").write_text("raise ImportError('no fsspec', name='fsspec')")
    code = "from fleet import open_store; open_store('s3://bucket/folder')"
    path = f"{tmp_path}{os.pathsep}{Path(__file__).parents[3]}"
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    assert MissingPackage.__name__ in done.stderr
    assert (
        "the store s3://bucket/folder needs the package fsspec: install it with pip" in done.stderr
    )


def test_a_full_disk_is_one_clear_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(StoreError, match=r"a\.json: no space left in the store; finished parts"):
        LocalStore(tmp_path).write("a.json", b"text")
    assert list(tmp_path.iterdir()) == []


class Failing:
    """A file system whose first requests fail."""

    def __init__(self, error: Exception, times: int) -> None:
        self.error, self.left, self.asked = error, times, 0

    def cat_file(self, path: str) -> bytes:
        self.asked += 1
        self.left -= 1
        if self.left >= 0:
            raise self.error
        return b"content"


@pytest.fixture
def failing(monkeypatch: pytest.MonkeyPatch) -> Callable[[Exception, int], tuple[Any, Failing]]:
    """Makes an object store whose first requests fail, and which does not wait."""
    pytest.importorskip("fsspec")
    from basetree.jobs import object_store

    monkeypatch.setattr(object_store.time, "sleep", lambda seconds: None)

    def make(error: Exception, times: int) -> tuple[Any, Failing]:
        store, files = open_store(MEMORY), Failing(error, times)
        vars(store)["_opened"] = (files, "/forest")
        return store, files

    return make


@pytest.mark.parametrize(
    "error",
    [OSError(errno.EBUSY, "Slow down"), ConnectionResetError("reset"), TimeoutError("too late")],
)
def test_a_passing_failure_is_repeated(failing: Any, error: Exception) -> None:
    store, files = failing(error, 3)
    assert store.read("a") == b"content"
    assert files.asked == 4


def test_a_lasting_failure_ends_with_its_reason(failing: Any) -> None:
    store, files = failing(OSError(errno.EBUSY, "Slow down"), 1000)
    with pytest.raises(StoreError, match=r"forest/job/a: cannot be read after 9 attempts .*Slow"):
        store.read("a")
    assert files.asked == 9


def test_a_refusal_is_not_repeated(failing: Any) -> None:
    store, files = failing(PermissionError(errno.EACCES, "Access Denied"), 1000)
    with pytest.raises(StoreError, match=r"cannot be read \(.*Access Denied"):
        store.read("a")
    assert files.asked == 1


def test_a_full_store_is_not_asked_again(failing: Any) -> None:
    store, files = failing(OSError(errno.ENOSPC, "Storage full"), 1000)
    with pytest.raises(StoreError, match="forest/job/a: no space left in the store; finished"):
        store.read("a")
    assert files.asked == 1


def unit_text(unit: int) -> bytes:
    return b"x" * 1000 + str(unit).encode()


def test_a_job_on_s3_whose_server_fails_now_and_then(
    s3: Any, job: Callable[..., Job], quiet: Progress, monkeypatch: pytest.MonkeyPatch
) -> None:
    from basetree.jobs import object_store

    monkeypatch.setattr(object_store, "_FIRST_WAIT_S", 0.01)
    s3.unavailable_every = 4
    store = open_store("s3://forest/run 1")
    for number in (1, 2):
        run_shard(job(store), lambda: unit_text, Shard(number, 2), quiet)
    assert list(read_manifests([store], ("test",))) == [unit_text(unit) for unit in range(4)]
    assert len(s3.requests) > 16  # several of them answered with 503


def test_a_full_object_store_is_one_clear_line(
    s3: Any, job: Callable[..., Job], quiet: Progress
) -> None:
    store = open_store("s3://forest/run")

    def fills(unit: int) -> bytes:
        s3.is_full = unit == 2
        return unit_text(unit)

    with pytest.raises(StoreError, match=r"^s3://forest/run/parts/000002\.json: no space left"):
        run_shard(job(store), lambda: fills, Shard(), quiet)
    s3.is_full = False
    done: list[int] = []

    def goes_on(unit: int) -> bytes:
        done.append(unit)
        return unit_text(unit)

    run_shard(job(store), lambda: goes_on, Shard(), quiet)
    assert done == [2, 3]


def test_a_bucket_that_does_not_exist_is_one_clear_line(
    s3: Any, job: Callable[..., Job], quiet: Progress
) -> None:
    with pytest.raises(StoreError, match=r"s3://nowhere/run/shards/job\.json: cannot be written"):
        run_shard(job(open_store("s3://nowhere/run")), lambda: unit_text, Shard(), quiet)
