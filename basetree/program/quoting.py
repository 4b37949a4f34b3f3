"""Words of commands that are printed to be copied into a shell."""

from __future__ import annotations

import shlex


def quoted(value: object) -> str:
    """A value quoted for the shell."""
    return shlex.quote(str(value))
