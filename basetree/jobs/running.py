"""Run the units of a job."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable
from typing import TypeAlias

from basetree.jobs.job import Job
from basetree.jobs.manifests import write_manifest
from basetree.jobs.progress import Progress
from basetree.jobs.shard import Shard

Worker: TypeAlias = Callable[[int], bytes]
"""Does the unit of a number, and returns the content of its part."""
Start: TypeAlias = Callable[[], Worker]
"""Makes a worker, with a model or textures; sent to the machines that work."""


def do_unit(job: Job, worker: Worker, unit: int) -> tuple[str, float]:
    """Do a unit and write its part.

    Returns:
        SHA-256 of the part and the seconds that it took.
    """
    start_s = time.monotonic()
    content = worker(unit)
    job.store.write(job.part(unit), content)
    return hashlib.sha256(content).hexdigest(), time.monotonic() - start_s


def run_shard(job: Job, start: Start, shard: Shard, progress: Progress) -> None:
    """Do the units of a shard that are not finished, in this process, and write its manifest.

    Args:
        job: The job.
        start: Makes the worker, if there is something to do.
        shard: The shard.
        progress: Told of every finished unit.

    Raises:
        JobError: If the store holds parts of another job.
        StoreError: If it cannot be read or written.
    """
    finished = job.open()
    units = shard.units(job.units)
    progress.begin(
        sum(job.frames_of(unit) for unit in units),
        sum(job.frames_of(unit) for unit in units if unit in finished),
    )
    missing = [unit for unit in units if unit not in finished]
    worker = start() if missing else None
    digests = {}
    for unit in missing:
        assert worker is not None
        digests[unit], taken_s = do_unit(job, worker, unit)
        progress.add(job.frames_of(unit), taken_s)
    write_manifest(job, shard, digests)
