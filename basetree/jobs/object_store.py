"""A store in an object store, through `fsspec`: retries, and one clear line when it is full."""

from __future__ import annotations

import errno
import random
import time
from collections.abc import Callable
from functools import cached_property
from typing import Any, Final, TypeVar

from basetree.errors import MissingPackage
from basetree.jobs.errors import FULL, StoreError, full_store, install_hint

_T = TypeVar("_T")

# Their files appear whole.
PROTOCOLS: Final = ("s3", "s3a", "gs", "gcs", "abfs", "az", "memory")
_ATTEMPTS: Final = 9
_FIRST_WAIT_S, _LONGEST_WAIT_S = 0.1, 10.0
_FULL_CODES: Final = ("storagefull", "quotaexceeded", "insufficientstorage", "507")
_NEVER_RETRIED: Final = (FileNotFoundError, PermissionError, FileExistsError, IsADirectoryError)
_WRONG: Final = (errno.EINVAL, errno.ENOSYS, errno.EPERM)


class ObjectStore:
    """Files below a URL. Requests that fail for a passing reason, such as 503, are repeated.

    Args:
        url: Such as s3://bucket/folder.

    Raises:
        StoreError: If the protocol is not known.
        MissingPackage: If the package for it is not installed.
    """

    def __init__(self, url: str) -> None:
        self._url = url
        protocol = url.partition(":")[0].lower()
        if protocol not in PROTOCOLS:
            raise StoreError(
                f"{url}: unknown kind of store {protocol!r}: expected a folder, or a URL that"
                f" starts with {', '.join(PROTOCOLS[:-1])}"
            )
        _ = self._opened  # to find out at once what is not installed

    def __reduce__(self) -> tuple[Any, ...]:
        return ObjectStore, (self._url,)

    @property
    def where(self) -> str:
        """The URL."""
        return self._url

    @cached_property
    def _opened(self) -> tuple[Any, str]:
        """The file system of fsspec and the path in it."""
        try:
            from fsspec.core import url_to_fs

            files, root = url_to_fs(self._url, use_listings_cache=False)
        except ImportError as error:
            package = getattr(error, "name", None) or "fsspec"
            raise MissingPackage(install_hint(f"the store {self._url}", package)) from error
        return files, str(root).rstrip("/")

    def write(self, name: str, data: bytes) -> None:
        """Write or replace a file."""
        files, root = self._opened
        self._retried(name, "written", lambda: files.pipe_file(f"{root}/{name}", data))

    def read(self, name: str) -> bytes:
        """Return the content of a file."""
        files, root = self._opened
        return bytes(self._retried(name, "read", lambda: files.cat_file(f"{root}/{name}")))

    def remove(self, name: str) -> None:
        """Remove a file, if it exists."""
        files, root = self._opened
        self._retried(name, "removed", lambda: files.rm_file(f"{root}/{name}"), absent_is=None)

    def sizes(self, folder: str) -> dict[str, int]:
        """Names of the files directly in a folder, with their bytes."""
        files, root = self._opened
        entries = self._retried(
            folder, "read", lambda: files.ls(f"{root}/{folder}", detail=True), absent_is=[]
        )
        return {
            f"{folder}/{str(entry['name']).rpartition('/')[2]}".lstrip("/"): int(entry["size"])
            for entry in entries
            if entry["type"] == "file"
        }

    def _retried(
        self, name: str, done: str, operation: Callable[[], _T], absent_is: Any = StoreError
    ) -> _T:
        """Do an operation, again after a wait if it fails for a passing reason."""
        wait_s = _FIRST_WAIT_S
        for attempt in range(1, _ATTEMPTS + 1):
            try:
                return operation()
            except Exception as error:
                if isinstance(error, FileNotFoundError) and absent_is is not StoreError:
                    found: _T = absent_is
                    return found
                if _is_full(error):
                    raise full_store(f"{self._url}/{name}") from error
                if attempt == _ATTEMPTS or not _may_pass(error):
                    reason = " ".join(str(error).split()) or type(error).__name__
                    tried = f" after {attempt} attempts" if attempt > 1 else ""
                    raise StoreError(
                        f"{self._url}/{name}: cannot be {done}{tried} ({reason})"
                    ) from error
            time.sleep(wait_s * random.uniform(0.5, 1.0))
            wait_s = min(2 * wait_s, _LONGEST_WAIT_S)
        raise AssertionError("unreachable")


def _is_full(error: BaseException) -> bool:
    """Whether the store has no space left, by the error or the answer that caused it."""
    if isinstance(error, OSError) and error.errno in FULL:
        return True
    return any(word in _answer_code(error).lower() for word in _FULL_CODES)


def _answer_code(error: BaseException) -> str:
    """The code in the store's answer, such as "XMinioStorageFull"; empty if there is none."""
    answer = getattr(error.__cause__ or error, "response", None)
    if not isinstance(answer, dict):
        return ""
    status = answer.get("ResponseMetadata", {}).get("HTTPStatusCode", "")
    return f"{answer.get('Error', {}).get('Code', '')} {status}"


def _may_pass(error: BaseException) -> bool:
    """Whether a request may succeed if it is repeated."""
    if isinstance(error, _NEVER_RETRIED) or "credentials" in type(error).__name__.lower():
        return False
    if isinstance(error, OSError):
        return error.errno not in _WRONG
    # Errors of connections in the libraries below fsspec.
    return type(error).__module__.partition(".")[0] in ("aiohttp", "aiobotocore", "botocore")
