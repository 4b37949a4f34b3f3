"""Jobs in shards: what each does, going on after a stop, manifests and merging."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from basetree.jobs import (
    Job,
    JobError,
    LocalStore,
    Progress,
    Shard,
    StoreError,
    read_manifests,
    run_shard,
)

MakeJob = Callable[..., Job]


def unit_text(unit: int) -> bytes:
    return f"unit {unit}".encode()


def run_all(job: Job, count: int, quiet: Progress) -> None:
    for number in range(1, count + 1):
        run_shard(job, lambda: unit_text, Shard(number, count), quiet)


@pytest.mark.parametrize(
    "text", ["0/4", "5/4", "1", "1/0", "a/b", "1/4/2", "-1/4", "1/1000000", ""]
)
def test_a_wrong_shard_is_refused_in_one_line(text: str) -> None:
    with pytest.raises(JobError, match=r"--shard is .* such as 3/64") as caught:
        Shard.parse(text)
    assert repr(text) in str(caught.value)


@pytest.mark.parametrize("count", [1, 2, 3, 4, 7])
def test_shards_do_every_unit_once(count: int) -> None:
    units = [unit for n in range(1, count + 1) for unit in Shard(n, count).units(5)]
    assert sorted(units) == list(range(5))


@pytest.mark.parametrize("count", [1, 3, 6])
def test_merged_parts_are_in_order_whatever_the_number_of_shards(
    tmp_path: Path, job: MakeJob, quiet: Progress, count: int
) -> None:
    store = LocalStore(tmp_path)
    run_all(job(store), count, quiet)
    assert list(read_manifests([store], ("test",))) == [unit_text(unit) for unit in range(4)]


def test_shards_of_different_places_are_merged(
    tmp_path: Path, job: MakeJob, quiet: Progress
) -> None:
    stores = [LocalStore(tmp_path / name) for name in ("a", "b")]
    for number, store in enumerate(stores, start=1):
        run_shard(job(store), lambda: unit_text, Shard(number, 2), quiet)
    assert list(read_manifests(stores, ("test",))) == [unit_text(unit) for unit in range(4)]


def test_a_stopped_shard_goes_on(tmp_path: Path, job: MakeJob, quiet: Progress) -> None:
    done: list[int] = []

    def stops_at_2(unit: int) -> bytes:
        if unit == 2:
            raise KeyboardInterrupt
        done.append(unit)
        return unit_text(unit)

    def goes_on(unit: int) -> bytes:
        done.append(unit)
        return unit_text(unit)

    whole = job(LocalStore(tmp_path))
    with pytest.raises(KeyboardInterrupt):
        run_shard(whole, lambda: stops_at_2, Shard(), quiet)
    with pytest.raises(JobError, match="no shard is finished"):
        read_manifests([whole.store], ("test",))
    run_shard(whole, lambda: goes_on, Shard(), quiet)
    assert done == [0, 1, 2, 3]
    assert list(read_manifests([whole.store], ("test",))) == [unit_text(unit) for unit in range(4)]


def test_a_finished_shard_starts_no_worker(tmp_path: Path, job: MakeJob, quiet: Progress) -> None:
    run_all(job(LocalStore(tmp_path)), 1, quiet)
    before = (tmp_path / Shard().file).read_bytes()

    def start() -> Callable[[int], bytes]:
        raise AssertionError("a worker is started")

    run_shard(job(LocalStore(tmp_path)), start, Shard(), quiet)
    assert (tmp_path / Shard().file).read_bytes() == before


def test_missing_shards_are_named(tmp_path: Path, job: MakeJob, quiet: Progress) -> None:
    store = LocalStore(tmp_path)
    run_shard(job(store), lambda: unit_text, Shard(2, 3), quiet)
    with pytest.raises(JobError, match="3 of 4 parts are missing; run the shards 1/3, 3/3 to"):
        read_manifests([store], ("test",))


@pytest.mark.parametrize("change", [{"identity": {"seed": 2}}, {"frames": 12}, {"kind": "other"}])
def test_a_store_of_another_job_is_refused(
    tmp_path: Path, job: MakeJob, quiet: Progress, change: dict[str, object]
) -> None:
    run_all(job(LocalStore(tmp_path)), 1, quiet)
    with pytest.raises(JobError, match="holds parts of another job"):
        run_all(job(LocalStore(tmp_path), **change), 1, quiet)


def test_shards_of_different_jobs_are_not_merged(
    tmp_path: Path, job: MakeJob, quiet: Progress
) -> None:
    a, b = LocalStore(tmp_path / "a"), LocalStore(tmp_path / "b")
    run_all(job(a), 1, quiet)
    run_all(job(b, identity={"seed": 2}), 1, quiet)
    with pytest.raises(JobError, match="another job than the shards in"):
        read_manifests([a, b], ("test",))
    with pytest.raises(JobError, match="holds shards of test; expected kind"):
        read_manifests([a], ("kind",))


def test_a_changed_part_is_seen(tmp_path: Path, job: MakeJob, quiet: Progress) -> None:
    run_all(job(LocalStore(tmp_path)), 1, quiet)
    (tmp_path / "parts" / "000002.json").write_bytes(b"unit 3")
    with pytest.raises(JobError, match=r"000002\.json: is not what its shard wrote"):
        list(read_manifests([LocalStore(tmp_path)], ("test",)))


@pytest.mark.parametrize("content", ["", "[]", '{"schema": "edgetree.shard/2"}', '{"parts": 3}'])
def test_a_broken_manifest_is_one_clear_line(
    tmp_path: Path, job: MakeJob, quiet: Progress, content: str
) -> None:
    run_all(job(LocalStore(tmp_path)), 1, quiet)
    (tmp_path / Shard().file).write_text(content)
    with pytest.raises(StoreError, match="is not a manifest of a shard"):
        read_manifests([LocalStore(tmp_path)], ("test",))


def test_a_manifest_says_what_was_done(tmp_path: Path, job: MakeJob, quiet: Progress) -> None:
    run_shard(job(LocalStore(tmp_path)), lambda: unit_text, Shard(2, 3), quiet)
    record = json.loads((tmp_path / "shards" / "000002-of-000003.json").read_text())
    assert record["shard"] == "2/3"
    assert list(record["parts"]) == ["1"]
    assert record["identity"] == {"seed": 1}
