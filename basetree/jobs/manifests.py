"""Manifests of shards: which parts a shard has written, and merging the parts of all shards."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from basetree.jobs.errors import JobError, StoreError
from basetree.jobs.job import JOB_FILE, Job
from basetree.jobs.shard import Shard
from basetree.jobs.stores import Store

_SCHEMA = "edgetree.shard/1"
_MOST_NAMED = 5


def write_manifest(job: Job, shard: Shard, digests: Mapping[int, str]) -> None:
    """Write the manifest of a shard whose units are finished.

    Args:
        job: The job.
        shard: The shard.
        digests: SHA-256 of parts that are known, by the number of the unit; the others are read.

    Raises:
        StoreError: If a part cannot be read, or the manifest not written.
    """
    record = {
        "schema": _SCHEMA,
        "kind": job.kind,
        "job": job.digest,
        "frames": job.frames,
        "block": job.block,
        "folder": job.folder,
        "identity": job.identity,
        "shard": str(shard),
        "parts": {
            str(unit): digests.get(unit) or _digest(job.store.read(job.part(unit)))
            for unit in shard.units(job.units)
        },
    }
    job.store.write(shard.file, json.dumps(record, indent=1).encode())


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


@dataclass(frozen=True)
class MergedParts:
    """The parts of all shards of a job, in the order of the units.

    Attributes:
        job: The job, with the store of its first manifest.
        parts: Store and SHA-256 of each part, by the number of the unit.
    """

    job: Job
    parts: dict[int, tuple[Store, str]]

    def __iter__(self) -> Iterator[bytes]:
        """Yield the content of one part after the other.

        Raises:
            StoreError: If a part cannot be read.
            JobError: If it is not the part that its shard wrote.
        """
        for unit in range(self.job.units):
            yield self.read(unit)

    def read(self, unit: int) -> bytes:
        """Return the content of a unit's part."""
        store, digest = self.parts[unit]
        name = self.job.part(unit)
        content = store.read(name)
        if _digest(content) != digest:
            raise JobError(
                f"{store.where}/{name}: is not what its shard wrote; remove it and run the shard"
                " again"
            )
        return content


def read_manifests(stores: Sequence[Store], kinds: Sequence[str]) -> MergedParts:
    """Read the manifests of all shards of a job.

    Args:
        stores: Where the shards are.
        kinds: Kinds of jobs that are expected.

    Raises:
        JobError: If shards are missing, or belong to different jobs.
        StoreError: If a store cannot be read.
    """
    first: Job | None = None
    shards: list[Shard] = []
    parts: dict[int, tuple[Store, str]] = {}
    for store in stores:
        for name in sorted(store.sizes("shards")):
            if name == JOB_FILE:
                continue
            job, shard, found = _read(store, name)
            first = first or job
            if job.digest != first.digest:
                raise JobError(
                    f"{store.where}/{name}: is of another job than the shards in"
                    f" {first.store.where}; expected shards of one job"
                )
            shards.append(shard)
            parts |= {unit: (store, digest) for unit, digest in found.items()}
    if first is None:
        where = ", ".join(store.where for store in stores)
        raise JobError(f"{where}: no shard is finished; expected a manifest in shards/ there")
    if first.kind not in kinds:
        raise JobError(
            f"{first.store.where}: holds shards of {first.kind}; expected {' or '.join(kinds)}"
        )
    _check_all(first, shards, parts)
    return MergedParts(first, parts)


def _read(store: Store, name: str) -> tuple[Job, Shard, dict[int, str]]:
    try:
        record = json.loads(store.read(name))
        if record["schema"] != _SCHEMA:
            raise ValueError(f"schema {record['schema']}")
        fields = ("kind", "identity", "frames", "block", "folder")
        job = Job(store, *(record[field] for field in fields))
        parts = {int(unit): str(digest) for unit, digest in record["parts"].items()}
        return job, Shard.parse(record["shard"]), parts
    except (ValueError, TypeError, KeyError, AttributeError, JobError) as error:
        raise StoreError(
            f"{store.where}/{name}: is not a manifest of a shard ({error}); expected {_SCHEMA}"
        ) from error


def _check_all(job: Job, shards: list[Shard], parts: dict[int, tuple[Store, str]]) -> None:
    """Raise JobError if units are in no shard."""
    missing = [unit for unit in range(job.units) if unit not in parts]
    if not missing:
        return
    count = max(shard.count for shard in shards)
    wanted = sorted({unit % count + 1 for unit in missing})
    names = ", ".join(f"{number}/{count}" for number in wanted[:_MOST_NAMED])
    more = "" if len(wanted) <= _MOST_NAMED else f" and {len(wanted) - _MOST_NAMED} more"
    raise JobError(
        f"{job.store.where}: {len(missing)} of {job.units} parts are missing; run the"
        f" shard{'s' * (len(wanted) > 1)} {names}{more} to the end, and merge again"
    )
