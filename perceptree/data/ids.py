"""Ids of any kind, as whole numbers."""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable
from typing import Any

from perceptree.data.entries import Entry
from perceptree.errors import DatasetError

_LARGEST = 2**63


class Ids:
    """The numbers of a file's images or categories.

    Whole numbers are kept. If an id is another text or number, the places of the entries in the
    file stand for their ids.

    Attributes:
        are_places: Whether places stand for the ids.
    """

    def __init__(self, entries: list[Entry], kind: str) -> None:
        """Number entries, all with an id that `key_of` knows.

        Raises:
            DatasetError: If two have the same id.
        """
        keys = [key_of(entry.get("id")) for entry in entries]
        if len(set(keys)) < len(keys):
            shared, times = Counter(keys).most_common(1)[0]
            raise DatasetError(f"{times} {kind} have the id {shared}, expected unique ids")
        self.are_places = not all(isinstance(key, int) for key in keys)
        self._numbers: dict[Hashable, int] = {
            key: key if isinstance(key, int) and not self.are_places else place
            for place, key in enumerate(keys)
        }
        self._by_value: dict[Hashable, int | None] | None = None

    def find(self, value: Any) -> int | None:
        """Return the number of the entry with this id, None if there is none.

        A text of digits and a number are the same id, if just one entry fits.
        """
        key = key_of(value)
        number = self._numbers.get(key)
        if number is not None or key is None:
            return number
        if self._by_value is None:
            self._by_value = {}
            for known, place in self._numbers.items():
                same = _value(known)
                self._by_value[same] = None if same in self._by_value else place
        return self._by_value.get(_value(key))


def key_of(value: Any) -> int | str | None:
    """Return what identifies an id: a whole number or a text; None for anything else."""
    if isinstance(value, float) and value.is_integer():
        value = int(value)
    if isinstance(value, bool) or not isinstance(value, int | str) or value == "":
        return None
    return value if isinstance(value, str) or abs(value) < _LARGEST else str(value)


def _value(key: Hashable) -> Hashable:
    """The number that a text of digits means; other ids unchanged."""
    if isinstance(key, str) and key.strip().isdecimal() and len(key) < 20:
        return int(key)
    return key
