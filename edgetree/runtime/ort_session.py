"""Open a model file in onnxruntime, and check that the requested provider is really used."""

from __future__ import annotations

import logging
import re
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any, Final

try:
    import resource
except ImportError:  # Windows
    resource = None  # type: ignore[assignment]

from basetree.errors import InputError
from basetree.files import current_limits
from basetree.files.names import is_utf8
from basetree.files.regular import read_regular
from edgetree.errors import ModelFileError
from edgetree.runtime.providers import (
    AUTO,
    CPU,
    PROVIDERS,
    Provider,
    SessionSettings,
    candidates,
    import_onnxruntime,
)

_log = logging.getLogger(__name__)
_STATM: Final = Path("/proc/self/statm")
# Of address space, which opening real files takes less than half of. A thread reserves its stack
# and a heap of its own.
_MEMORY_BYTES: Final = 640 * 2**20
_MEMORY_OF_A_BYTE: Final = 16
_MEMORY_OF_A_THREAD: Final = 144 * 2**20
_LARGEST_COMPUTED_BYTES: Final = 128 * 2**20  # of a tensor that is computed while opening
_ERRORS: Final = 3  # severity of onnxruntime's logger
_turn = threading.Lock()


class _NotStarted(Exception):
    """A provider cannot be used for this model; the message is the reason."""


def open_session(
    path: Path,
    settings: SessionSettings,
    threads: int,
    content: bytes | None = None,
    adjust: Callable[[Any], None] = lambda _: None,
) -> tuple[Any, Provider]:
    """Open a model file in onnxruntime.

    onnxruntime silently uses the CPU if a provider does not start, and for operators that a
    provider does not support. A provider that does not start or runs no part of the graph is an
    error here with strict settings, and otherwise a warning.

    Args:
        path: The .onnx file.
        settings: The provider and its options.
        threads: Threads of one inference on the CPU.
        content: The content to open instead of the file, whose path is then only a name.
        adjust: Called with the `onnxruntime.SessionOptions` before the model is loaded.

    Returns:
        The `onnxruntime.InferenceSession` and the provider in use.

    Raises:
        ModelFileError: Onnxruntime cannot load the model.
        InputError: With strict settings, the provider is not installed, does not start or runs no
            part of the graph; or the cache folder cannot be created.
        MissingPackage: Onnxruntime is not installed.
    """
    onnxruntime = import_onnxruntime()
    _make_folder(settings.cache_folder)
    tried = candidates(settings)
    if settings.provider not in (AUTO, tried[0].name):
        _log.warning("provider %r is not installed: using the CPU", settings.provider)
    for provider in tried:
        try:
            options = _options(onnxruntime, provider, settings, threads)
            adjust(options)
            return _start(path, content, provider, settings, options), provider
        except _NotStarted as problem:
            if settings.strict and settings.provider != AUTO:
                raise InputError(
                    f"provider {provider.name!r} cannot be used for model {path} ({problem}):"
                    " expected it to start and to run a part of the graph; or use 'cpu'"
                ) from problem
            _log.warning("provider %r cannot be used (%s): trying another", provider.name, problem)
    raise AssertionError("the CPU is always among the candidates")


def _start(
    path: Path, content: bytes | None, provider: Provider, settings: SessionSettings, options: Any
) -> Any:
    """Open a session on one provider; raises `_NotStarted` if the provider is not used."""
    onnxruntime = import_onnxruntime()
    threads = options.intra_op_num_threads
    asked = [(provider.ort_name, provider.options_for(threads, settings.cache_folder))]
    if provider.name != CPU:
        # Kernels of GPUs warn of operators such as ScatterND through the logger of the process,
        # which the options of a session do not reach. Errors are still written.
        onnxruntime.set_default_logger_severity(_ERRORS)
        listed = onnxruntime.get_available_providers()
        asked += [(name, {}) for name in provider.helpers if name in listed]
        asked.append((PROVIDERS[CPU].ort_name, {}))
    # Providers with memory of their own reserve far more addresses than they use.
    size = path.stat().st_size if content is None else len(content)
    most = _MEMORY_BYTES + _MEMORY_OF_A_BYTE * size + _MEMORY_OF_A_THREAD * threads
    most = min(most, current_limits().model_memory_bytes)
    limit = _memory_limit(most) if provider.name == CPU else nullcontext()
    model: str | bytes = str(path)
    if content is not None or not is_utf8(path):
        model = read_regular(path) if content is None else content
    try:
        with limit:
            session = onnxruntime.InferenceSession(
                model,
                sess_options=options,
                providers=asked,
                enable_fallback=0,
            )
    except Exception as error:  # onnxruntime's errors have no common base class
        if provider.name != CPU:
            raise _NotStarted(reason_of(error)) from error
        raise ModelFileError(
            f"model {path} is not an ONNX model that onnxruntime can load ({reason_of(error)}):"
            " expected a file made by `edgetree export`"
        ) from error
    if provider.ort_name not in session.get_providers():
        raise _NotStarted("onnxruntime did not load it; its libraries or driver may be missing")
    placement = placement_of(session, provider)
    if placement and provider.name not in placement:
        raise _NotStarted("it runs no part of the graph")
    return session


@contextmanager
def _memory_limit(more_bytes: int) -> Iterator[None]:
    """Let the process take at most `more_bytes` more address space inside the block.

    An allocation beyond it fails, as if the machine had no more memory. The limit is that of the
    whole process, so one thread at a time is inside such a block. It has no effect on systems
    without /proc.
    """
    if resource is None or not _STATM.exists():
        yield
        return
    with _turn:
        in_use = int(_STATM.read_text("ascii").split()[0]) * resource.getpagesize()
        soft, hard = resource.getrlimit(resource.RLIMIT_AS)
        allowed = in_use + more_bytes
        for other in (soft, hard):
            allowed = allowed if other == resource.RLIM_INFINITY else min(allowed, other)
        resource.setrlimit(resource.RLIMIT_AS, (allowed, hard))
        try:
            yield
        finally:
            resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


def _options(onnxruntime: Any, provider: Provider, settings: SessionSettings, threads: int) -> Any:
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    options.log_severity_level = 4  # fatal only: errors are raised as exceptions
    options.enable_mem_pattern = not provider.one_at_a_time
    entries = {
        "session.intra_op.allow_spinning": str(int(settings.spinning)),
        "session.load_model_format": "ONNX",
        "optimization.constant_folding_max_output_size_in_bytes": str(_LARGEST_COMPUTED_BYTES),
    }
    if provider.name != CPU:
        entries["session.record_ep_graph_assignment_info"] = "1"
    for key, value in entries.items():
        options.add_session_config_entry(key, value)
    return options


def placement_of(session: Any, provider: Provider) -> dict[str, dict[str, int]]:
    """Number of the graph's nodes by provider and operator; empty if onnxruntime does not tell."""
    if provider.name == CPU or not hasattr(session, "get_provider_graph_assignment_info"):
        return {}
    names = {each.ort_name: each.name for each in PROVIDERS.values()}
    found: dict[str, dict[str, int]] = {}
    for part in session.get_provider_graph_assignment_info():
        operators = found.setdefault(names.get(part.ep_name, part.ep_name), {})
        for node in part.get_nodes():
            operators[node.op_type] = operators.get(node.op_type, 0) + 1
    return found


def _make_folder(folder: Path | None) -> None:
    if folder is None:
        return
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"cache folder {folder} cannot be created ({error.strerror}): expected a folder that"
            " exists or can be created"
        ) from error


def reason_of(error: Exception) -> str:
    """The relevant part of onnxruntime's error message, in one line."""
    text = (str(error).strip().splitlines() or [type(error).__name__])[0]
    for mark in ("Status Message:", "failed:"):
        text = text.rpartition(mark)[2].strip()
    text = re.sub(r"^\[ONNXRuntimeError\] : \d+ : \w+ : ", "", text)
    return re.sub(r"^\S+:\d+ .*?\) ", "", text)  # file, line and function of its source code
