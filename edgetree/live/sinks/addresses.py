"""Addresses of controllers and brokers, as text."""

from __future__ import annotations

import re

from basetree.errors import InputError

__all__ = ["host_and_port"]


def host_and_port(text: str, default_port: int | None = None) -> tuple[str, int]:
    """Split an address such as "192.168.1.20:9000" or "[fe80::1]:9000".

    Raises:
        InputError: it is not of this form.
    """
    found = re.fullmatch(r"(\[[0-9A-Fa-f:.%\w]+\]|[^\s:/\[\]]+)(?::(\d{1,5}))?", text)
    port = found[2] if found is not None and found[2] is not None else default_port
    if found is None or port is None or not 1 <= int(port) <= 65535:
        example = "192.168.1.20:9000" if default_port is None else f"192.168.1.20:{default_port}"
        raise InputError(f"the address is {text!r}: expected HOST:PORT, such as {example}")
    return found[1].strip("[]"), int(port)
