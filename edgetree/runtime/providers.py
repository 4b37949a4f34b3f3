"""Which part of onnxruntime runs a model, and how it is asked to.

onnxruntime calls them execution providers. Each comes with a build of onnxruntime, and a build
may list one that the machine cannot start; then onnxruntime goes on with the processor, which
`edgetree.runtime.session` finds out.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Final

from edgetree.errors import InputError, MissingDependency

__all__ = [
    "AUTO",
    "CPU",
    "PROVIDERS",
    "Provider",
    "SessionSettings",
    "candidates",
    "import_onnxruntime",
    "installed_providers",
]

AUTO: Final = "auto"
CPU: Final = "cpu"


@dataclass(frozen=True)
class Provider:
    """One execution provider.

    Attributes:
        name: as the user gives it.
        ort_name: as onnxruntime has it.
        package: what brings it.
        options: what onnxruntime is told beside the name; "{threads}" stands for their number.
        cache_options: likewise, where there is a cache folder, "{cache}". Empty for a provider
            that keeps nothing.
        helpers: providers that take what this one leaves, before the processor does.
        io_device: memory that inputs are copied to by us, once; None leaves it to onnxruntime.
        one_at_a_time: a session must not run in two threads at once.
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
        """What onnxruntime is told."""
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
            # Operators whose output size depends on the data are slow there, or not known.
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
            "openvino",
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
# TensorRT is not tried on its own account: it builds an engine for minutes first.
_TRIED_BY_AUTO: Final = ("cuda", "coreml", "directml", "openvino")


@dataclass(frozen=True)
class SessionSettings:
    """How a model file is opened.

    Attributes:
        provider: a name of `PROVIDERS`, or "auto" for the first that is installed and starts:
            CUDA, CoreML, DirectML, OpenVINO, and else the processor.
        strict: a provider asked for by name that is not installed, does not start or takes no
            part of the graph is an error. Off, the processor takes over and one warning says so.
            "auto" may always end with the processor.
        threads: threads of one inference on the processor; None takes all cores that this process
            may use.
        spinning: let idle threads spin. It shortens an inference a little and keeps the cores
            busy between two, which the machine's other programs pay for; so it is off.
        cache_folder: where TensorRT, OpenVINO or CoreML keep what they make of the model, so that
            the next start is faster; made if needed. None keeps nothing.

    Raises:
        InputError: a value out of range, or a cache folder for a provider that keeps nothing.
    """

    provider: str = CPU
    strict: bool = True
    threads: int | None = None
    spinning: bool = False
    cache_folder: Path | None = None

    def __post_init__(self) -> None:
        if self.provider != AUTO and self.provider not in PROVIDERS:
            names = ", ".join((AUTO, *PROVIDERS))
            raise InputError(f"provider is {self.provider!r}: expected one of {names}")
        if self.threads is not None and self.threads < 1:
            raise InputError(f"threads is {self.threads}: expected 1 or more")
        keeping = [provider.name for provider in PROVIDERS.values() if provider.cache_options]
        if self.cache_folder is not None and self.provider not in (AUTO, *keeping):
            raise InputError(
                f"cache folder is {self.cache_folder} and provider {self.provider!r}, which keeps"
                f" nothing: expected one of {', '.join(keeping)}"
            )


def import_onnxruntime() -> ModuleType:
    """onnxruntime, loaded now.

    Raises:
        MissingDependency: it is not installed.
    """
    try:
        import onnxruntime
    except ImportError as error:
        raise MissingDependency(
            "onnxruntime is not installed: install edgetree[cpu] or, for an NVIDIA GPU,"
            " edgetree[gpu]; one of the two"
        ) from error
    module: ModuleType = onnxruntime
    return module


def installed_providers() -> tuple[str, ...]:
    """Names of the providers that the installed onnxruntime lists; they may yet fail to start.

    Raises:
        MissingDependency: onnxruntime is not installed.
    """
    listed = import_onnxruntime().get_available_providers()
    return tuple(name for name, provider in PROVIDERS.items() if provider.ort_name in listed)


def candidates(settings: SessionSettings) -> list[Provider]:
    """The providers to try, in turn.

    Raises:
        InputError: strict settings name a provider that is not installed.
        MissingDependency: onnxruntime is not installed.
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
