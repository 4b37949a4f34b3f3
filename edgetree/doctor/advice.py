"""What the findings mean, in plain words: what is broken, what to beware of, what to do."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, Literal

from edgetree.doctor.findings import Findings, Libraries, Machine
from edgetree.doctor.libraries import ONNXRUNTIME_BUILDS, OPENCV_BUILDS
from edgetree.runtime.providers import CPU

__all__ = ["Advice", "Level", "advise"]

Level = Literal["broken", "beware", "advice"]

_X86: Final = {"x86_64", "amd64"}
_ARM: Final = {"aarch64", "arm64"}
_X86_INT8: Final = {"avx512_vnni", "avx_vnni", "amx_int8"}
_NVIDIA: Final = {"cuda", "tensorrt"}
_TRAINING: Final = ("torch", "torchvision", "timm", "onnx", "onnxscript", "numba")
_LITTLE_MEMORY_MIB: Final = 2048
_THREADS_HELP_FROM: Final = 1.15
_BUSY_FROM: Final = 0.5


@dataclass(frozen=True)
class Advice:
    """One sentence for the user: "broken" must be mended, "beware" may bite, "advice" helps."""

    level: Level
    text: str


def advise(findings: Findings) -> tuple[Advice, ...]:
    """All that follows from the findings, the worst first."""
    found = [
        *_libraries(findings.libraries),
        *_providers(findings),
        *_precision(findings.machine),
        *_cores(findings),
        *_memory(findings.machine),
        *_extras(findings),
    ]
    order = ("broken", "beware", "advice")
    return tuple(sorted(found, key=lambda advice: order.index(advice.level)))


def _libraries(libraries: Libraries) -> Iterator[Advice]:
    versions = libraries.versions
    for builds, module in ((ONNXRUNTIME_BUILDS, "onnxruntime"), (OPENCV_BUILDS, "cv2")):
        there = [name for name in builds if name in versions]
        if len(there) > 1:
            yield Advice(
                "broken",
                f"{' and '.join(there)} are installed, and both bring the module {module}:"
                " uninstall all of them, then install one",
            )
    for name, minimum in libraries.minima.items():
        if name in versions and _numbers(versions[name]) < _numbers(minimum):
            yield Advice(
                "broken",
                f"{name} is {versions[name]}: expected {minimum} or newer;"
                f" install '{name}>={minimum}'",
            )
    torch, needed = versions.get("torch"), libraries.torch_needed
    if torch is not None and needed is not None and torch.partition("+")[0] != needed:
        yield Advice(
            "broken",
            f"torchvision {versions['torchvision']} was built for torch {needed}, and torch is"
            f" {torch}: install the two together, from one index",
        )
    for module, error in libraries.import_errors.items():
        remedy = {
            "torchvision": "install torch and torchvision together, from one index",
            "cv2": "install opencv-python-headless, which needs no display libraries",
        }.get(module, f"install {module} again")
        yield Advice("broken", f"{module} does not load ({error}): {remedy}")


def _numbers(version: str) -> tuple[int, ...]:
    """The release's numbers, without trailing zeros: 2.1.0rc1 gives (2, 1)."""
    release = re.match(r"\d+(\.\d+)*", version)
    numbers = [int(part) for part in release[0].split(".")] if release else []
    while numbers and numbers[-1] == 0:
        numbers.pop()
    return tuple(numbers)


def _providers(findings: Findings) -> Iterator[Advice]:
    builds = [name for name in ONNXRUNTIME_BUILDS if name in findings.libraries.versions]
    working = {provider.name for provider in findings.providers if provider.works}
    if not builds:
        which = "edgetree[gpu]" if findings.machine.has_nvidia_gpu else "edgetree[cpu]"
        yield Advice("broken", f"onnxruntime is not installed: install {which}")
    elif not working:
        yield Advice(
            "broken", f"no provider of {builds[0]} runs a network: install {builds[0]} again"
        )
    for provider in findings.providers:
        if not provider.works:
            yield Advice(
                "beware",
                f"provider {provider.name} is offered but does not run ({provider.reason})",
            )
        elif provider.name != CPU:
            yield Advice(
                "advice",
                f"provider {provider.name} works: compare `edgetree bench --provider"
                f" {provider.name}` with the processor's, for an fp32 and an fp16 file",
            )
    if findings.machine.has_nvidia_gpu and builds and not working & _NVIDIA:
        yield Advice(
            "advice",
            "there is an NVIDIA GPU that is not used: uninstall onnxruntime and install"
            " edgetree[gpu], with the CUDA and cuDNN libraries that onnxruntime-gpu asks for",
        )


def _precision(machine: Machine) -> Iterator[Advice]:
    has = machine.instructions
    int8_by_name = {"x86": _X86_INT8, "arm": {"dotprod", "i8mm"}}
    family = "x86" if machine.architecture in _X86 else "arm"
    if has is None or machine.architecture not in _X86 | _ARM:
        yield Advice(
            "advice",
            "whether the processor has INT8 instructions is not known: compare"
            " `edgetree bench` of an fp32 and an int8 file, and `edgetree verify` the int8 file",
        )
    elif int8_by_name[family] & set(has):
        yield Advice(
            "advice",
            "the processor has INT8 instructions: `edgetree export --precision int8` gives the"
            " fastest file for it",
        )
    elif family == "x86":
        yield Advice(
            "beware",
            "the processor has no VNNI: INT8 sums can saturate, so that trees are missed, and"
            " INT8 is not much faster; `edgetree verify` an int8 file on this machine before"
            " relying on it, or export fp32",
        )
    else:
        yield Advice(
            "beware",
            "the processor has no dot product instructions: INT8 is not much faster than fp32;"
            " compare both with `edgetree bench`",
        )
    if has is not None and family == "x86" and "avx2" not in has:
        yield Advice("beware", "the processor has no AVX2: every model is slow on it")


def _cores(findings: Findings) -> Iterator[Advice]:
    machine, speed = findings.machine, findings.speed
    if machine.core_quota is not None and machine.core_quota < machine.usable_cores:
        threads = max(int(machine.core_quota), 1)
        yield Advice(
            "beware",
            f"this container may take the time of {machine.core_quota:g} cores, but sees"
            f" {machine.usable_cores}: pass --threads {threads}, or it is stopped again and again",
        )
    busy = machine.busy_cores
    if busy is not None and busy >= _BUSY_FROM * machine.cores:
        yield Advice(
            "beware",
            f"{busy:.1f} of {machine.cores} cores were busy with other work in the last minute:"
            " figures of `edgetree bench` are too slow by that",
        )
    if speed is None or speed.threads == 1:
        return
    if speed.fps_all_threads < _THREADS_HELP_FROM * speed.fps_one_thread:
        yield Advice(
            "advice",
            f"{speed.threads} threads are no faster than one here: pass --threads 1 and leave the"
            " other cores to other programs",
        )


def _memory(machine: Machine) -> Iterator[Advice]:
    free = machine.free_memory_mib
    if free is not None and free < _LITTLE_MEMORY_MIB:
        yield Advice(
            "beware",
            f"{free:.0f} MiB of memory are free: enough for the light models, too little for the"
            " paper's networks and for exporting",
        )


def _extras(findings: Findings) -> Iterator[Advice]:
    missing = [name for name in _TRAINING if name not in findings.libraries.versions]
    if missing:
        yield Advice(
            "advice",
            f"training and exporting need {', '.join(missing)}: install"
            " edgetree[train,export,sim]; running, measuring and benching need nothing more",
        )
