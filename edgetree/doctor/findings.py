"""The findings as plain records, so that advice can be tested for any machine."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any


@dataclass(frozen=True)
class Machine:
    """The computer.

    Attributes:
        system: Operating system and architecture, such as "Linux x86_64".
        architecture: "x86_64", "aarch64", ... in lower case.
        processor: Name of the CPU; None if not known.
        instructions: Instruction sets of the CPU that speed up networks; None if not known.
        cores: Number of logical cores.
        usable_cores: Number of cores that this process may use.
        core_quota: Limit of a container's CPU time, in cores; None if not limited.
        busy_cores: Mean number of busy cores in the last minute; None if not known.
        memory_mib: Memory of the machine, or limit of the container; None if not known.
        free_memory_mib: Memory that is still available; None if not known.
        has_nvidia_gpu: Whether an NVIDIA driver is installed.
    """

    system: str
    architecture: str
    processor: str | None
    instructions: tuple[str, ...] | None
    cores: int
    usable_cores: int
    core_quota: float | None
    busy_cores: float | None
    memory_mib: float | None
    free_memory_mib: float | None
    has_nvidia_gpu: bool


@dataclass(frozen=True)
class Libraries:
    """The installed packages.

    Attributes:
        python: Version of Python.
        versions: Version of each installed package that matters here.
        minima: Lowest supported version of each package.
        torch_needed: Torch version that the installed torchvision was built for; None if not known
            or not installed.
        import_errors: Error message of each module that cannot be imported.
    """

    python: str
    versions: Mapping[str, str]
    minima: Mapping[str, str] = field(default_factory=dict)
    torch_needed: str | None = None
    import_errors: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class ProviderResult:
    """Whether a provider of `edgetree.runtime.PROVIDERS` ran a small network, and why not."""

    name: str
    works: bool
    reason: str = ""


@dataclass(frozen=True)
class Speed:
    """Frames per second of the packaged rgb model (INT8) on one thread and on all.

    Attributes:
        threads: Number of all threads.
        fps_one_thread: On one thread.
        fps_all_threads: On all threads.
        fps_openvino: On all threads with the provider openvino; None where it does not work.
    """

    threads: int
    fps_one_thread: float
    fps_all_threads: float
    fps_openvino: float | None = None


@dataclass(frozen=True)
class ModelFile:
    """A model that is found by name.

    Attributes:
        name: Its name.
        path: The .onnx file.
        file_sha256: SHA-256 of the file.
        version: Version in the signature beside the file; None without a signature.
    """

    name: str
    path: str
    file_sha256: str
    version: int | None = None


@dataclass(frozen=True)
class Findings:
    """All findings.

    Attributes:
        machine: The computer.
        libraries: The installed packages.
        providers: What runs networks.
        speed: None if the model did not run.
        video: Whether OpenCV has each of `VIDEO_BACKENDS`; empty if OpenCV cannot be imported.
        models: The models that are found by name.
        model_faults: Why others cannot be read.
    """

    machine: Machine
    libraries: Libraries
    providers: tuple[ProviderResult, ...]
    speed: Speed | None
    video: Mapping[str, bool] = field(default_factory=dict)
    models: tuple[ModelFile, ...] = ()
    model_faults: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """The findings as a JSON object, with numbers rounded to two digits.

        Faults of models are left to the advice, which names them.
        """
        found = {name: _rounded(value) for name, value in asdict(self).items()}
        del found["model_faults"]
        return found


def _rounded(value: Any) -> Any:
    if isinstance(value, float):
        return round(value, 2)
    if isinstance(value, dict):
        return {name: _rounded(item) for name, item in value.items()}
    return [_rounded(item) for item in value] if isinstance(value, list | tuple) else value
