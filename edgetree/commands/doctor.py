"""`edgetree doctor`: check this machine and its libraries, and give advice."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from typing import TYPE_CHECKING, Final

import typer

from basetree.program.console import note, print_found
from edgetree.commands.options import Json

if TYPE_CHECKING:
    from edgetree.doctor import Advice, Findings, Machine

_LABEL: Final = 14
_WIDTH: Final = 100
_SHOWN_DIGITS: Final = 12  # of a SHA-256


def doctor(as_json: Json = False) -> None:
    """Check this machine: providers, speed, libraries; and give advice.

    The exit code is 1 if something is broken.
    """
    from edgetree.doctor import advise, examine

    note("testing providers and libraries, and measuring the speed ...")
    findings = examine()
    advice = advise(findings)
    broken = any(item.level == "broken" for item in advice)
    items = [{"level": item.level, "text": item.text} for item in advice]
    verdict = {"schema": "edgetree.doctor/1", "healthy": not broken}
    record = {**verdict, **findings.to_dict(), "advice": items}
    print_found(as_json, lambda: record, lambda: _lines(findings, advice))
    if broken:
        raise typer.Exit(1)


def _lines(findings: Findings, advice: tuple[Advice, ...]) -> Iterator[str]:
    """The findings and the advice as text."""
    for label, text in _facts(findings):
        yield from _paragraph(label, text)
    yield ""
    for item in advice:
        yield from _paragraph(item.level, item.text)
    if not any(item.level == "broken" for item in advice):
        yield from _paragraph("healthy", "nothing is broken; next: edgetree bench")


def _facts(findings: Findings) -> Iterator[tuple[str, str]]:
    machine, libraries = findings.machine, findings.libraries
    yield "system", f"{machine.system}, Python {libraries.python}"
    yield "processor", machine.processor or "not known"
    yield "cores", _cores(machine)
    names = machine.instructions
    yield "instructions", "not known" if names is None else ", ".join(names) or "none of interest"
    yield "memory", _memory(machine)
    versions = (f"{name} {version}" for name, version in libraries.versions.items())
    yield "libraries", ", ".join(versions)
    for index, provider in enumerate(findings.providers):
        works = "works" if provider.works else f"does not work: {provider.reason}"
        yield "" if index else "providers", f"{provider.name} {works}"
    if not findings.providers:
        yield "providers", "none"
    yield "cameras", _cameras(findings)
    for index, model in enumerate(findings.models):
        version = "" if model.version is None else f", version {model.version}"
        sha256 = model.file_sha256[:_SHOWN_DIGITS]
        yield "" if index else "models", f"{model.name}{version}, SHA-256 {sha256}, {model.path}"
    speed = findings.speed
    if speed is None:
        yield "speed", "not measured, as the packaged model cannot run"
        return
    several = f", {speed.fps_all_threads:.0f} on {speed.threads}" if speed.threads > 1 else ""
    if speed.fps_openvino is not None:
        several += f", {speed.fps_openvino:.0f} on {speed.threads} with --provider openvino"
    figures = f"{speed.fps_one_thread:.0f} frames per second on 1 thread{several}"
    yield "speed", f"{figures} (edge-n-rgb, INT8, 640x384)"


def _cameras(findings: Findings) -> str:
    """What OpenCV reads, and the makers' packages that are installed."""
    from edgetree.doctor.libraries import CAMERA_PACKAGES

    if not findings.video:
        return "not known, as OpenCV cannot be imported"
    has = [name for name, there in findings.video.items() if there]
    lacks = [name for name, there in findings.video.items() if not there]
    without = f", without {' and '.join(lacks)}" if lacks else ""
    parts = [f"OpenCV with {' and '.join(has) or 'none'}{without}"]
    installed = [name for name in CAMERA_PACKAGES if name in findings.libraries.versions]
    parts.append(", ".join(installed) or f"no packages of makers ({', '.join(CAMERA_PACKAGES)})")
    return "; ".join(parts)


def _cores(machine: Machine) -> str:
    parts = [f"{machine.usable_cores} of {machine.cores} usable"]
    if machine.core_quota is not None:
        parts.append(f"limited to the CPU time of {machine.core_quota:g}")
    if machine.busy_cores is not None:
        parts.append(f"{machine.busy_cores:.1f} busy in the last minute")
    return ", ".join(parts)


def _memory(machine: Machine) -> str:
    if machine.memory_mib is None:
        return "not known"
    free = machine.free_memory_mib
    part = "" if free is None else f", {free / 1024:.1f} GiB free"
    return f"{machine.memory_mib / 1024:.1f} GiB{part}"


def _paragraph(label: str, text: str) -> list[str]:
    return textwrap.wrap(
        text,
        _WIDTH,
        initial_indent=f"{label:{_LABEL}}",
        subsequent_indent=" " * _LABEL,
        break_long_words=False,
        break_on_hyphens=False,
    )
