"""The execution providers of onnxruntime: CPU, CUDA, TensorRT, OpenVINO, CoreML and DirectML.

Each build of onnxruntime has some of them. A provider that is part of the build may still fail to
start on a machine, which `edgetree.runtime.ort_session` checks.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Final

from basetree.errors import InputError, MissingPackage, install_hint
from basetree.settings import Settings, limits, names

AUTO: Final = "auto"
CPU: Final = "cpu"
OPENVINO: Final = "openvino"
_MAX_THREADS: Final = 1024


@dataclass(frozen=True)
class Provider:
    """One execution provider.

    Attributes:
        name: Its name in edgetree's options.
        ort_name: Its name in onnxruntime.
        package: The package that contains it, for messages.
        options: Provider options for onnxruntime; "{threads}" is replaced by the thread count.
        cache_options: Further options if there is a cache folder, which replaces "{cache}". Empty
            for a provider without a cache.
        helpers: Onnxruntime names of providers for operators that this one does not support. The
            CPU comes last in any case.
        io_device: Device to copy inputs to before a run; None leaves it to onnxruntime.
        one_at_a_time: Whether a session must not run in two threads at once.
    """

    name: str
    ort_name: str
    package: str
    options: Mapping[str, str] = field(default_factory=dict)
    cache_options: Mapping[str, str] = field(default_factory=dict)
    helpers: tuple[str, ...] = ()
    io_device: str | None = None
    one_at_a_time: bool = False

    def options_for(self, threads: int, cache_folder: Path | None) -> dict[str, str]:
        """The provider options for onnxruntime, with the values filled in."""
        cached = {} if cache_folder is None else self.cache_options
        return {
            key: value.format(threads=threads, cache=cache_folder)
            for key, value in {**self.options, **cached}.items()
        }


PROVIDERS: Final[dict[str, Provider]] = {
    provider.name: provider
    for provider in (
        Provider(CPU, "CPUExecutionProvider", "onnxruntime"),
        Provider("cuda", "CUDAExecutionProvider", "onnxruntime-gpu", io_device="cuda"),
        Provider(
            "tensorrt",
            "TensorrtExecutionProvider",
            "onnxruntime-gpu and TensorRT",
            # Operators with data-dependent output sizes are slow or not supported in TensorRT.
            options={"trt_op_types_to_exclude": "NonMaxSuppression,NonZero,RoiAlign"},
            cache_options={
                "trt_engine_cache_enable": "True",
                "trt_engine_cache_path": "{cache}",
                "trt_timing_cache_enable": "True",
                "trt_timing_cache_path": "{cache}",
            },
            helpers=("CUDAExecutionProvider",),
            io_device="cuda",
        ),
        Provider(
            OPENVINO,
            "OpenVINOExecutionProvider",
            "onnxruntime-openvino",
            options={"num_of_threads": "{threads}"},
            cache_options={"cache_dir": "{cache}"},
        ),
        Provider(
            "coreml",
            "CoreMLExecutionProvider",
            "onnxruntime on macOS",
            options={"ModelFormat": "MLProgram", "MLComputeUnits": "ALL"},
            cache_options={"ModelCacheDirectory": "{cache}"},
        ),
        Provider(
            "directml",
            "DmlExecutionProvider",
            "onnxruntime-directml on Windows",
            one_at_a_time=True,
        ),
    )
}
# Without TensorRT, which takes minutes to build an engine.
_TRIED_BY_AUTO: Final = ("cuda", "coreml", "directml", OPENVINO)


@dataclass(frozen=True)
class SessionSettings(Settings, error=InputError):
    """Settings for opening a model file."""

    provider: str = field(default=CPU, metadata=names((AUTO, *PROVIDERS)))
    """A name in `PROVIDERS`; or "auto" for the first of CUDA, CoreML, DirectML and OpenVINO that is
    installed and starts, otherwise the CPU."""
    strict: bool = True
    """Raise an error if the provider given by name is not installed, does not start or runs no part
    of the graph. If false, log a warning and use the CPU. "auto" may use the CPU in any case."""
    threads: int | None = field(default=None, metadata=limits(1, _MAX_THREADS))
    """Threads of one inference on the CPU; None for all cores that this process may use."""
    spinning: bool = False
    """Let idle threads spin. Inference becomes slightly faster, but the cores stay busy between
    inferences, which slows down other programs."""
    cache_folder: Path | None = None
    """Where TensorRT, OpenVINO or CoreML store compiled models to start faster the next time;
    created if needed. None for no cache."""
    require_signature: bool = False
    """Refuse a model file without an accepted signature, even if the machine does not require one,
    see `edgetree.signing`."""

    def _check_together(self) -> None:
        caching = [provider.name for provider in PROVIDERS.values() if provider.cache_options]
        if self.cache_folder is not None and self.provider not in (AUTO, *caching):
            self._refuse(
                f"cache folder is {self.cache_folder}, but provider {self.provider!r} has no cache",
                f"one of {', '.join(caching)}",
            )


def import_onnxruntime() -> ModuleType:
    """Import onnxruntime on first use.

    Raises:
        MissingPackage: Onnxruntime is not installed.
    """
    try:
        import onnxruntime
    except ImportError as error:
        raise MissingPackage(
            f"onnxruntime is not installed: {install_hint('cpu')}, or {install_hint('gpu')} for"
            " an NVIDIA GPU; only one of the two"
        ) from error
    module: ModuleType = onnxruntime
    return module


def installed_providers() -> tuple[str, ...]:
    """Names of the providers in the installed build of onnxruntime, which may fail to start.

    Raises:
        MissingPackage: Onnxruntime is not installed.
    """
    listed = import_onnxruntime().get_available_providers()
    return tuple(name for name, provider in PROVIDERS.items() if provider.ort_name in listed)


def candidates(settings: SessionSettings) -> list[Provider]:
    """The providers to try, in this order.

    Raises:
        InputError: The provider of strict settings is not installed.
        MissingPackage: Onnxruntime is not installed.
    """
    installed = installed_providers()
    asked = _TRIED_BY_AUTO if settings.provider == AUTO else (settings.provider,)
    found = [PROVIDERS[name] for name in asked if name in installed]
    if settings.provider != AUTO and settings.strict:
        if not found:
            package = PROVIDERS[settings.provider].package
            raise InputError(
                f"provider {settings.provider!r} is not in the installed onnxruntime: expected one"
                f" of {', '.join(installed)}; it comes with {package}"
            )
        return found
    return [*found, *([] if PROVIDERS[CPU] in found else [PROVIDERS[CPU]])]
