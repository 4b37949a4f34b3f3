"""Shards: a job's units shared out among commands that know nothing of each other."""

from __future__ import annotations

import re
from dataclasses import dataclass

from basetree.jobs.errors import JobError

_MAX_SHARDS = 100_000


@dataclass(frozen=True, order=True)
class Shard:
    """One of several equal shares of a job.

    Attributes:
        number: Number of the shard, from 1 on.
        count: Number of all shards.
    """

    number: int = 1
    count: int = 1

    @classmethod
    def parse(cls, text: str) -> Shard:
        """Read a shard such as "3/64".

        Raises:
            JobError: If the text is not of this form.
        """
        found = re.fullmatch(r"(\d{1,6})/(\d{1,6})", text)
        if found:
            number, count = int(found[1]), int(found[2])
            if 1 <= number <= count <= _MAX_SHARDS:
                return cls(number, count)
        raise JobError(
            f"--shard is {text!r}: expected a number and a count from 1 to {_MAX_SHARDS:,}, such as"
            " 3/64 for the third of 64 shards"
        )

    def __str__(self) -> str:
        return f"{self.number}/{self.count}"

    @property
    def file(self) -> str:
        """Name of the shard's manifest in a store."""
        return f"shards/{self.number:06d}-of-{self.count:06d}.json"

    def units(self, count: int) -> range:
        """Numbers of the shard's units, if the job has `count` of them."""
        return range(self.number - 1, count, self.count)
