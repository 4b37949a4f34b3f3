"""The base class of settings, which checks them by their metadata."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import Field, fields
from typing import Any, ClassVar, NoReturn

from basetree.errors import EdgetreeError, SettingsError
from basetree.settings.metadata import Metadata, complaint


class Settings:
    """Base of frozen dataclasses of settings: values are checked when an instance is built.

    What a field may be is in its metadata. None is valid where the type of the field has it.

    A subclass may name `each`, metadata of all fields that have none of their own, and `error`,
    the error that is raised in place of SettingsError:

        class Counts(Settings, each=limits(0, 50), error=InputError): ...

    Raises:
        SettingsError: If a value is not what its field expects, or does not fit the others. The
            message is "NAME is VALUE: expected ...".
    """

    _each: ClassVar[Metadata] = {}
    _error: ClassVar[type[EdgetreeError]] = SettingsError
    _before_expected: ClassVar[str] = ": "

    def __init_subclass__(
        cls, *, each: Metadata | None = None, error: type[EdgetreeError] | None = None
    ) -> None:
        super().__init_subclass__()
        cls._each = cls._each if each is None else each
        cls._error = error or cls._error

    def __post_init__(self) -> None:
        for entry in fields(self):  # type: ignore[arg-type]
            value = getattr(self, entry.name)
            if isinstance(value, Settings) or (value is None and "None" in str(entry.type)):
                continue
            metadata = metadata_of(type(self), entry)
            found = complaint(metadata.get("label", entry.name), value, metadata)
            if found is not None:
                self._refuse(*found)
        self._check_together()

    def _check_together(self) -> None:
        """Check what depends on several settings; called after the check of each."""

    @classmethod
    def _refuse(cls, found: str, expected: str) -> NoReturn:
        raise cls._error(f"{found}{cls._before_expected}expected {expected}")


def metadata_of(settings: type, entry: Field[Any]) -> Mapping[str, Any]:
    """The metadata of a field of a dataclass, or those that all its fields share."""
    shared: Metadata = getattr(settings, "_each", {})
    return entry.metadata or shared


def check_value(name: str, value: Any, expected: Metadata) -> None:
    """Check one value that is no field of settings.

    Args:
        name: Name of the value, for the message.
        value: The value.
        expected: What it may be, such as `limits(0, 1)`.

    Raises:
        SettingsError: If the value is something else.
    """
    found = complaint(name, value, expected)
    if found is not None:
        raise SettingsError("{}: expected {}".format(*found))
