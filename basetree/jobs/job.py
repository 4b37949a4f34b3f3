"""Jobs: work on frames, cut into units whose results are parts in a store."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from typing import Any

from basetree.jobs.errors import JobError
from basetree.jobs.stores import Store

JOB_FILE = "shards/job.json"


@dataclass(frozen=True)
class Job:
    """Work on frames.

    Attributes:
        store: Where the parts are.
        kind: Name of the work, such as "perceptree.synth".
        identity: Everything that decides on the parts' content, as JSON values.
        frames: Number of frames.
        block: Frames of a unit; the last unit may have fewer.
        folder: Folder of the parts in the store.
    """

    store: Store
    kind: str
    identity: dict[str, Any]
    frames: int
    block: int
    folder: str = "parts"

    @property
    def units(self) -> int:
        """Number of units."""
        return -(-self.frames // self.block)

    @property
    def digest(self) -> str:
        """SHA-256 of all that makes two jobs the same."""
        content = [self.kind, self.identity, self.frames, self.block]
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()

    def frames_of(self, unit: int) -> int:
        """Number of frames of a unit."""
        return min(self.block, self.frames - unit * self.block)

    def part(self, unit: int) -> str:
        """Name of a unit's part in the store."""
        return f"{self.folder}/{unit:06d}.json"

    def open(self) -> set[int]:
        """Begin the job in its store, or go on with it.

        Returns:
            Numbers of the units whose parts are there.

        Raises:
            JobError: If the store holds parts of another job.
            StoreError: If it cannot be read or written.
        """
        record = {
            "schema": "edgetree.job/1",
            "kind": self.kind,
            "job": self.digest,
            "frames": self.frames,
            "block": self.block,
            "identity": self.identity,
        }
        content = json.dumps(record, indent=1).encode()
        if JOB_FILE in self.store.sizes("shards"):
            if self.store.read(JOB_FILE) != content:
                raise JobError(
                    f"{self.store.where}: holds parts of another job, see {JOB_FILE} there;"
                    " expected the same data, model and options, or an empty place"
                )
        else:
            self.store.write(JOB_FILE, content)
        present = self.store.sizes(self.folder)
        return {unit for unit in range(self.units) if self.part(unit) in present}
