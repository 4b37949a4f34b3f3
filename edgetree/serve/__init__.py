"""A local service: other programs hand frames to `edgetree live`, and get metres back.

    from edgetree.serve import Client

    with Client("tcp://127.0.0.1:8430") as client:
        for frame in frames:
            print(client.measure(frame)["trees"])

Messages are JSON with the pixels beside it, over ZeroMQ: `messages.schema.json` in this folder is
their JSON Schema. Names are imported on first use; ZeroMQ is the extra `serve`.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from edgetree.serve.client import Client
    from edgetree.serve.service import Service

__all__ = ["Client", "Service"]

_MODULES = {"Client": "client", "Service": "service"}


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
