"""Advice for the user, derived from the findings."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, Literal

from basetree.errors import install_hint
from basetree.program.load import busy_words
from edgetree.doctor.findings import Findings, Libraries, Machine
from edgetree.doctor.libraries import ONNXRUNTIME_BUILDS, OPENCV_BUILDS
from edgetree.errors import TRAINING_PACKAGES
from edgetree.runtime.providers import CPU, OPENVINO

Level = Literal["broken", "beware", "advice"]

_X86: Final = {"x86_64", "amd64"}
_ARM: Final = {"aarch64", "arm64"}
_X86_INT8: Final = {"avx512_vnni", "avx_vnni", "amx_int8"}
_NVIDIA: Final = {"cuda", "tensorrt"}
_LITTLE_MEMORY_MIB: Final = 2048
_THREADS_HELP_FROM: Final = 1.15
_PROVIDER_HELPS_FROM: Final = 1.1


@dataclass(frozen=True)
class Advice:
    """A piece of advice: "broken" must be repaired, "beware" is a warning, "advice" a hint."""

    level: Level
    text: str


def advise(findings: Findings) -> tuple[Advice, ...]:
    """All advice for these findings, the most severe first."""
    found = [
        *_libraries(findings.libraries),
        *(Advice("broken", fault) for fault in findings.model_faults),
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
        installed = [name for name in builds if name in versions]
        if len(installed) > 1:
            yield Advice(
                "broken",
                f"{' and '.join(installed)} are installed, but contain the same module {module}:"
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
            f" {torch}: install both together, from the same index",
        )
    for module, error in libraries.import_errors.items():
        remedy = {
            "torchvision": "install torch and torchvision together, from the same index",
            "cv2": "install opencv-python-headless, which needs no display libraries",
        }.get(module, f"reinstall {module}")
        yield Advice("broken", f"{module} cannot be imported ({error}): {remedy}")


def _numbers(version: str) -> tuple[int, ...]:
    """The numbers of a version, without trailing zeros: 2.1.0rc1 gives (2, 1)."""
    release = re.match(r"\d+(\.\d+)*", version)
    numbers = [int(part) for part in release[0].split(".")] if release else []
    while numbers and numbers[-1] == 0:
        numbers.pop()
    return tuple(numbers)


def _providers(findings: Findings) -> Iterator[Advice]:
    builds = [name for name in ONNXRUNTIME_BUILDS if name in findings.libraries.versions]
    working = {provider.name for provider in findings.providers if provider.works}
    speed = findings.speed
    if not builds:
        extra = "gpu" if findings.machine.has_nvidia_gpu else "cpu"
        yield Advice("broken", f"onnxruntime is not installed: {install_hint(extra)}")
    elif not working:
        yield Advice("broken", f"no provider of {builds[0]} works: reinstall {builds[0]}")
    for provider in findings.providers:
        if not provider.works:
            yield Advice(
                "beware",
                f"provider {provider.name} is installed but does not work ({provider.reason})",
            )
        elif provider.name == OPENVINO and speed is not None and speed.fps_openvino is not None:
            yield Advice("advice", _fastest_on_the_cpu(speed.fps_openvino, speed.fps_all_threads))
        elif provider.name != CPU:
            yield Advice(
                "advice",
                f"provider {provider.name} works: compare `edgetree bench --provider"
                f" {provider.name}` with `--provider cpu`, for an fp32 and an fp16 file",
            )
    if findings.machine.has_nvidia_gpu and builds and not working & _NVIDIA:
        yield Advice(
            "advice",
            f"the NVIDIA GPU is not used: uninstall onnxruntime, then {install_hint('gpu')}, and"
            " install the CUDA and cuDNN libraries that onnxruntime-gpu needs",
        )


def _fastest_on_the_cpu(openvino_fps: float, cpu_fps: float) -> str:
    """What the speeds of the packaged model, in frames per second, say of the two providers."""
    times = openvino_fps / cpu_fps
    compared = (
        f"provider {OPENVINO} runs the packaged INT8 model at {times:.2f} times the speed of {CPU}"
    )
    if times >= _PROVIDER_HELPS_FROM:
        return (
            f"{compared}: pass --provider {OPENVINO}, after `edgetree conformance run --provider"
            f" {OPENVINO}` of a kit, as it rounds in another way"
        )
    return f"{compared}: stay with {CPU}"


def _precision(machine: Machine) -> Iterator[Advice]:
    has = machine.instructions
    int8_by_name = {"x86": _X86_INT8, "arm": {"dotprod", "i8mm"}}
    family = "x86" if machine.architecture in _X86 else "arm"
    if has is None or machine.architecture not in _X86 | _ARM:
        yield Advice(
            "advice",
            "it is not known whether the processor has INT8 instructions: compare"
            " `edgetree bench` of an fp32 and an int8 file, and `edgetree verify` the int8 file",
        )
    elif int8_by_name[family] & set(has):
        yield Advice(
            "advice",
            "the processor has INT8 instructions: `edgetree export --precision int8` makes the"
            " fastest model for it",
        )
    elif family == "x86":
        yield Advice(
            "beware",
            "the processor has no VNNI instructions: INT8 is not much faster than fp32, and INT8"
            " sums can saturate in files exported before weights used 7 of 8 bits, so that trees"
            " are missed; check a file here with a kit of another machine (`edgetree conformance"
            " run`), or use fp32",
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
            f"this container is limited to the time of {machine.core_quota:g} cores, but sees"
            f" {machine.usable_cores}: pass --threads {threads} to avoid being throttled",
        )
    if busy := busy_words(machine.busy_cores, machine.cores):
        yield Advice("beware", f"{busy}: `edgetree bench` will report too low speeds")
    if speed is None or speed.threads == 1:
        return
    if speed.fps_all_threads < _THREADS_HELP_FROM * speed.fps_one_thread:
        yield Advice(
            "advice",
            f"{speed.threads} threads are not faster than one here: pass --threads 1 and leave the"
            " other cores to other programs",
        )


def _memory(machine: Machine) -> Iterator[Advice]:
    free = machine.free_memory_mib
    if free is not None and free < _LITTLE_MEMORY_MIB:
        yield Advice(
            "beware",
            f"{free:.0f} MiB of memory are free: enough for the small models, too little for the"
            " paper's networks and for exporting",
        )


def _extras(findings: Findings) -> Iterator[Advice]:
    missing = [name for name in TRAINING_PACKAGES if name not in findings.libraries.versions]
    if missing:
        yield Advice(
            "advice",
            f"training and exporting need {', '.join(missing)}:"
            f" {install_hint('train', 'export', 'sim')}; other commands do not need them",
        )
