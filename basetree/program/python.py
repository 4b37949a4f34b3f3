"""The Python that runs: versions of its packages, and code in a process of its own."""

from __future__ import annotations

import importlib.metadata
import subprocess
import sys


def installed_version(package: str) -> str | None:
    """Version of an installed package; None if it is not installed."""
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None


def run_python(
    *arguments: str, given: str | None = None, limit_s: float | None = None
) -> subprocess.CompletedProcess[str]:
    """Run this Python in a process of its own, and wait for its end.

    Args:
        arguments: Arguments of Python, such as "-m" and a module.
        given: Text for its standard input.
        limit_s: Longest time that it may take.

    Raises:
        subprocess.TimeoutExpired: It takes longer.
    """
    return subprocess.run(
        [sys.executable, *arguments],
        input=given,
        capture_output=True,
        text=True,
        check=False,
        timeout=limit_s,
    )
