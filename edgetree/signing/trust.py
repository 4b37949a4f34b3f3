"""Trusted keys, and whether signatures are required: one file of the machine, one of each account.

The machine's file is written by root and holds for all accounts. Once it requires signatures, only
its own keys count, so that no account can weaken it.
"""

from __future__ import annotations

import base64
import dataclasses
import os
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from basetree.errors import InputError
from basetree.files.json import json_text
from basetree.files.locking import locked
from basetree.files.writing import write_whole
from edgetree.errors import SignatureError
from edgetree.signing.json_files import read_record
from edgetree.signing.keys import KEY_BYTES, key_id
from edgetree.signing.statement import parse_time

SCHEMA: Final = "edgetree.trust/1"
_EXPECTED: Final = "a file of `edgetree trust`"
_FILE_NAME: Final = "trust.json"
_MACHINE_FOLDER: Final = Path("/etc/edgetree")
_READABLE_BY_ALL: Final = 0o644
_FOLDER_READABLE_BY_ALL: Final = 0o755


@dataclass(frozen=True)
class TrustedKey:
    """A public key whose signatures are accepted.

    Attributes:
        name: Name for people, from the key's file.
        public_key: The 32 bytes of the key in base64.
        valid_until: Last second in which it is accepted, in UTC; None for no end.

    Raises:
        SignatureError: a value is not valid.
    """

    name: str
    public_key: str
    valid_until: str | None = None

    def __post_init__(self) -> None:
        try:
            size = len(self.public_bytes)
        except ValueError as error:
            raise SignatureError(f"public_key is not base64 ({error})") from error
        if size != KEY_BYTES:
            raise SignatureError(f"public_key has {size} bytes: expected {KEY_BYTES}")
        if self.valid_until is not None:
            parse_time(self.valid_until)

    @classmethod
    def of(cls, public_key: bytes, name: str, valid_until: str | None) -> TrustedKey:
        """The entry of a key of 32 bytes."""
        return cls(name, base64.b64encode(public_key).decode(), valid_until)

    @property
    def public_bytes(self) -> bytes:
        """The 32 bytes of the key."""
        return base64.b64decode(self.public_key, validate=True)

    @property
    def id(self) -> str:
        """The key's id, see `key_id`."""
        return key_id(self.public_bytes)


@dataclass(frozen=True)
class TrustFile:
    """Content of a trust file.

    Attributes:
        require_signature: Whether models without an accepted signature are refused.
        keys: The trusted keys.
    """

    require_signature: bool
    keys: tuple[TrustedKey, ...]

    def with_key(self, key: TrustedKey) -> TrustFile:
        """The file with one key more; an entry of the same key is replaced."""
        others = tuple(other for other in self.keys if other.id != key.id)
        return dataclasses.replace(self, keys=(*others, key))

    def without_key(self, wanted: str) -> TrustFile:
        """The file without a key.

        Args:
            wanted: The key's id, or the start of it.

        Raises:
            InputError: No key or several keys match.
        """
        found = [key for key in self.keys if wanted and key.id.startswith(wanted)]
        if len(found) != 1:
            known = ", ".join(key.id for key in self.keys) or "no keys"
            raise InputError(f"--remove is {wanted!r}: expected the id of one key, of {known}")
        kept = tuple(key for key in self.keys if key != found[0])
        return dataclasses.replace(self, keys=kept)


@dataclass(frozen=True)
class Trust:
    """What holds for this account.

    Attributes:
        required_by: The file that requires signatures, or None.
        keys: The keys that count, by id.
        files: The files that were read.
    """

    required_by: Path | None
    keys: dict[str, TrustedKey]
    files: tuple[Path, ...]


def machine_file() -> Path | None:
    """The trust file of the machine, which may not exist; None on Windows."""
    return None if sys.platform == "win32" else _MACHINE_FOLDER / _FILE_NAME


def account_file() -> Path | None:
    """The trust file of this account, which may not exist; None without a usable home folder."""
    if sys.platform == "win32":
        base = os.environ.get("LOCALAPPDATA") or os.path.expanduser(r"~\AppData\Local")
    else:
        base = os.environ.get("XDG_CONFIG_HOME") or os.path.expanduser("~/.config")
    path = Path(base, "edgetree", _FILE_NAME)
    try:
        os.lstat(path)
    except PermissionError:  # the home folder of another account, which sudo may leave set
        return None
    except OSError:
        pass
    return None if base.startswith("~") else path


def own_file() -> Path:
    """The trust file that this account changes: the machine's for root, otherwise its own.

    Raises:
        InputError: The account has no home folder.
    """
    machine = machine_file()
    if machine is not None and os.geteuid() == 0:
        return machine
    own = account_file()
    if own is None:
        raise InputError(
            "this account has no home folder that it can use: expected one, for its trusted keys"
        )
    return own


def read_trust_file(path: Path) -> TrustFile:
    """Read a trust file; one that does not exist has no keys.

    Raises:
        SignatureError: It cannot be read, or is not a trust file.
    """
    found = read_record(TrustFile, path, _EXPECTED, SCHEMA, f"trust file {path}")
    return found or TrustFile(False, ())


def write_trust_file(path: Path, trust: TrustFile) -> None:
    """Write a trust file, which every account can read, and make its folder.

    Raises:
        InputError: It cannot be written.
    """
    _make_folder(path.parent)
    write_whole(path, json_text(SCHEMA, dataclasses.asdict(trust)).encode(), _READABLE_BY_ALL)


def change_trust_file(path: Path, change: Callable[[TrustFile], TrustFile]) -> None:
    """Read, change and write a trust file, without losing what another process changes.

    Raises:
        InputError: It cannot be read or written, or the change is refused.
    """
    _make_folder(path.parent)
    with locked(path):
        write_trust_file(path, change(read_trust_file(path)))


def _make_folder(folder: Path) -> None:
    try:
        if not folder.is_dir():
            folder.mkdir(parents=True)
            folder.chmod(_FOLDER_READABLE_BY_ALL)
    except OSError as error:
        raise InputError(
            f"folder {folder} cannot be made ({error.strerror}): expected a writable folder"
        ) from error


def current_trust() -> Trust:
    """Read what holds for this account.

    Raises:
        SignatureError: a trust file cannot be read, or is not one.
    """
    machine = machine_file()
    files = [] if machine is None else [machine]
    contents = {path: read_trust_file(path) for path in files}
    if not any(content.require_signature for content in contents.values()):
        own = account_file()
        if own is not None:
            files.append(own)
            contents[own] = read_trust_file(own)
    required_by = next((path for path in files if contents[path].require_signature), None)
    keys = {key.id: key for path in reversed(files) for key in contents[path].keys}
    return Trust(required_by, keys, tuple(files))
