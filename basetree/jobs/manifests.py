"""Manifests of shards: which parts a shard has written, and merging the parts of all shards."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Annotated, Any

from msgspec import Meta

from basetree.errors import InputError
from basetree.files.json import build, parse_json
from basetree.files.names import is_inside
from basetree.jobs.errors import JobError, StoreError
from basetree.jobs.job import JOB_FILE, Job
from basetree.jobs.shard import Shard
from basetree.jobs.stores import Store

_SCHEMA = "edgetree.shard/1"
_MOST_NAMED = 5
_LARGEST_BYTES = 16 * 2**20  # a part takes about 80


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
        for name, size in sorted(store.sizes("shards").items()):
            if name == JOB_FILE:
                continue
            job, shard, found = _read(store, name, size)
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


@dataclass(frozen=True)
class _Manifest:
    """The content of a shard's manifest."""

    kind: str
    identity: dict[str, Any]
    frames: Annotated[int, Meta(ge=0)]
    block: Annotated[int, Meta(ge=1)]
    folder: str
    shard: str
    parts: dict[str, Annotated[str, Meta(pattern="^[0-9a-f]{64}$")]]


def _read(store: Store, name: str, size: int) -> tuple[Job, Shard, dict[int, str]]:
    try:
        if size > _LARGEST_BYTES:
            raise ValueError(f"{size} bytes, at most {_LARGEST_BYTES}")
        record = parse_json(store.read(name).decode())
        found = record.get("schema") if isinstance(record, dict) else None
        if found != _SCHEMA:
            raise ValueError(f"schema {found!r:.60}")
        content = build(_Manifest, record, "manifest")
        if not is_inside(content.folder):
            raise ValueError(f"folder {content.folder!r} is not inside the store")
        shard = Shard.parse(content.shard)
        job = Job(
            store, content.kind, content.identity, content.frames, content.block, content.folder
        )
        units = shard.units(job.units)
        if len(content.parts) != len(units) or {*map(str, units)} != content.parts.keys():
            raise ValueError(
                f"{len(content.parts)} parts, expected the {len(units)} of shard {shard} of"
                f" {job.frames} frames"
            )
    except StoreError:
        raise
    except (ValueError, InputError) as error:
        raise StoreError(
            f"{store.where}/{name}: is not a manifest of a shard ({error}); expected {_SCHEMA}"
        ) from error
    return job, shard, {unit: content.parts[str(unit)] for unit in units}


def _check_all(job: Job, shards: list[Shard], parts: dict[int, tuple[Store, str]]) -> None:
    """Raise JobError if units are in no shard."""
    missing = job.units - len(parts)
    if not missing:
        return
    count = max(shard.count for shard in shards)
    unfinished = (
        number
        for number in range(1, count + 1)
        if not all(unit in parts for unit in Shard(number, count).units(job.units))
    )
    names = [f"{number}/{count}" for number in islice(unfinished, _MOST_NAMED)]
    more = sum(1 for _ in unfinished)
    raise JobError(
        f"{job.store.where}: {missing} of {job.units} parts are missing; run the"
        f" shard{'s' * (len(names) > 1)} {', '.join(names)}{f' and {more} more' if more else ''} to"
        " the end, and merge again"
    )
