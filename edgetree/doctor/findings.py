"""What was found on a machine: plain records, so that advice can be tested without the machine."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

__all__ = ["Findings", "Libraries", "Machine", "ProviderResult", "Speed"]


@dataclass(frozen=True)
class Machine:
    """The computer.

    Attributes:
        system: operating system and architecture, such as "Linux x86_64".
        architecture: "x86_64", "aarch64", ... in lower case.
        processor: the processor's name; None if the system does not say.
        instructions: of those that speed up networks, the ones it has; None if not known.
        cores: logical cores present.
        usable_cores: those that this process may use.
        core_quota: processor time that a container may take, in cores; None if not limited.
        busy_cores: cores at work in the last minute, mean; None if not known.
        memory_mib: memory of the machine, or of the container; None if not known.
        free_memory_mib: part of it that programs can still have; None if not known.
        has_nvidia_gpu: whether an NVIDIA driver is there.
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
    """What is installed.

    Attributes:
        python: its version.
        versions: distribution -> version, of those that matter here and are installed.
        minima: distribution -> lowest version that this project works with.
        torch_needed: the torch version that the installed torchvision was built for; None if it
            does not say, or is not installed.
        import_errors: module -> why it does not load, of those that should.
    """

    python: str
    versions: Mapping[str, str]
    minima: Mapping[str, str] = field(default_factory=dict)
    torch_needed: str | None = None
    import_errors: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class ProviderResult:
    """A provider of `edgetree.runtime.PROVIDERS`, tried with a small network, or why it failed."""

    name: str
    works: bool
    reason: str = ""


@dataclass(frozen=True)
class Speed:
    """Detections per second of the embedded INT8 RGB model, on one thread and on all."""

    threads: int
    fps_one_thread: float
    fps_all_threads: float


@dataclass(frozen=True)
class Findings:
    """Everything that was looked at; `speed` is None where the model did not run."""

    machine: Machine
    libraries: Libraries
    providers: tuple[ProviderResult, ...]
    speed: Speed | None

    def to_dict(self) -> dict[str, Any]:
        """The findings as a JSON object, numbers rounded."""
        return {name: _rounded(value) for name, value in asdict(self).items()}


def _rounded(value: Any) -> Any:
    if isinstance(value, float):
        return round(value, 2)
    if isinstance(value, dict):
        return {name: _rounded(item) for name, item in value.items()}
    return [_rounded(item) for item in value] if isinstance(value, list | tuple) else value
