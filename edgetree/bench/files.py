"""Benchmark several networks: export missing model files, then measure each in its own process."""

from __future__ import annotations

import importlib.metadata
import json
import os
import statistics
import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from edgetree.errors import CheckFailed, InputError, ModelFileError, SignatureError
from edgetree.export.settings import PRECISIONS, TARGETS
from edgetree.runtime.providers import AUTO, CPU
from edgetree.signing.verify import is_signature_required

__all__ = ["NETWORKS", "ROUNDS", "TableSettings", "bench_in_turn", "cache_folder", "find_files"]

NETWORKS: Final = ("edge-n", "edge-s", "edge-m", "r50", "r101", "x101-32x8d", "x101-32x4d")
ROUNDS: Final = 3
_SMALLEST_PX: Final = 32
_USAGE: Final = 2

Say = Callable[[str], None]
Record = dict[str, Any]


@dataclass(frozen=True)
class TableSettings:
    """The networks of a table, and how to measure them.

    Attributes:
        backbones: names of networks in `NETWORKS`, or of files in `models`.
        models: folder of the model files; missing files are exported to it.
        precision: a key of `edgetree.export.PRECISIONS`.
        height: height of the input in pixels.
        width: width of the input in pixels.
        proposals: region proposals per frame; None for each network's default.
        duration_s: time to measure each file for, all rounds together.
        threads: threads of one inference; None for all usable cores.
        provider: provider to run on, and to export for; see `edgetree.runtime.PROVIDERS`.
        strict: raise an error if the provider cannot be used, instead of using the CPU.
        source: frames as for `edgetree run`; None for the packaged sample frames.

    Raises:
        InputError: a value is invalid.
    """

    backbones: tuple[str, ...]
    models: Path
    precision: str = "fp32"
    height: int = 800
    width: int = 800
    proposals: int | None = None
    duration_s: float = 5.0
    threads: int | None = None
    provider: str = CPU
    strict: bool = True
    source: Path | None = None

    def __post_init__(self) -> None:
        names = self.backbones
        if not all(names) or len(set(names)) != len(names):
            raise InputError(
                f"--backbones is {','.join(names)!r}: expected distinct names separated by commas"
            )
        if self.precision not in PRECISIONS:
            choices = ", ".join(PRECISIONS)
            raise InputError(f"--precision is {self.precision!r}: expected one of {choices}")
        if self.provider not in (AUTO, *TARGETS):
            choices = ", ".join((AUTO, *TARGETS))
            raise InputError(f"--provider is {self.provider!r}: expected one of {choices}")
        if min(self.height, self.width) < _SMALLEST_PX:
            raise InputError(
                f"--height and --width are {self.height} and {self.width}:"
                f" expected {_SMALLEST_PX} or more"
            )

    @property
    def target(self) -> str:
        """The provider that missing files are exported for."""
        return self.provider if self.provider in TARGETS else CPU

    def path_of(self, backbone: str) -> Path:
        """Path of a network's file: NAME-PRECISION-WIDTHxHEIGHT[-PROPOSALSp][-TARGET].onnx."""
        parts = [backbone, self.precision, f"{self.width}x{self.height}"]
        parts += [] if self.proposals is None else [f"{self.proposals}p"]
        parts += [] if self.target == CPU else [self.target]
        return self.models / f"{'-'.join(parts)}.onnx"


def cache_folder() -> Path:
    """The default folder of exported files, separate for each version of edgetree.

    It is in the user's cache folder: %LOCALAPPDATA% on Windows, ~/Library/Caches on macOS, and
    $XDG_CACHE_HOME or ~/.cache elsewhere.
    """
    if sys.platform == "win32":
        base = os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local"
    elif sys.platform == "darwin":
        base = Path.home() / "Library" / "Caches"
    else:
        base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    try:
        version = importlib.metadata.version("edgetree")
    except importlib.metadata.PackageNotFoundError:
        version = "unknown"
    return Path(base) / "edgetree" / f"models-{version}"


def find_files(settings: TableSettings, say: Say) -> dict[str, Path]:
    """Find the model file of each network. Missing files are exported with untrained weights.

    Args:
        settings: the networks.
        say: called with progress messages.

    Returns:
        The path of each network's file, by name.

    Raises:
        InputError: a name has no file and is not in `NETWORKS`, or the folder is not writable.
        SignatureError: a file is missing, and signatures are required.
        MissingDependency: a file is missing and torch is not installed.
    """
    files = {name: settings.path_of(name) for name in settings.backbones}
    missing = {name: path for name, path in files.items() if not path.is_file()}
    for name, path in missing.items():
        if name not in NETWORKS:
            raise InputError(
                f"backbone {name!r} has no file {path} and is not a known network: expected one of"
                f" {', '.join(NETWORKS)}"
            )
    if missing:
        _export(missing, settings, say)
    return files


def _export(missing: Mapping[str, Path], settings: TableSettings, say: Say) -> None:
    from edgetree.export import ExportSettings, export_preset
    from edgetree.results.atomic_files import output_folder

    if is_signature_required():
        first = next(iter(missing.values()))
        raise SignatureError(
            f"model {first} does not exist, and exporting it gives no signature, which is required"
            " here: expected signed files"
        )
    wanted = ExportSettings(
        height=settings.height,
        width=settings.width,
        proposals=settings.proposals,
        precision=settings.precision,
        target=settings.target,
    )
    with output_folder(settings.models):
        for name, path in missing.items():
            say(f"exporting {name} with untrained weights to {path}")
            export_preset(name, path, settings=wanted, say=say)


def bench_in_turn(
    files: Mapping[str, Path], settings: TableSettings, say: Say
) -> dict[str, Record]:
    """Run `edgetree bench --json` for each file in `ROUNDS` rounds, each in a new process.

    The files take turns, so that a temporary slowdown of the machine affects all of them. Times are
    medians over the rounds, memory is the maximum.

    Args:
        files: path of each network's file.
        settings: how to measure.
        say: called with progress messages.

    Returns:
        The merged JSON object of each network.

    Raises:
        CheckFailed: a benchmark process failed.
        InputError: a benchmark process rejected its input.
        ModelFileError: a file has another input size or precision than its name says.
    """
    rounds: dict[str, list[Record]] = {name: [] for name in files}
    for number in range(1, ROUNDS + 1):
        for name, path in files.items():
            say(f"round {number} of {ROUNDS}: {name}")
            record = _bench(path, settings)
            _check(path, record, settings)
            rounds[name].append(record)
    return {name: _merge(records) for name, records in rounds.items()}


def _bench(path: Path, settings: TableSettings) -> Record:
    command = [sys.executable, "-m", "edgetree"]
    command += ["--require-signature"] if is_signature_required() else []
    command += ["bench", "--model", str(path), "--json"]
    command += ["--seconds", str(settings.duration_s / ROUNDS)]
    command += ["--provider", settings.provider, "--strict" if settings.strict else "--no-strict"]
    if settings.threads is not None:
        command += ["--threads", str(settings.threads)]
    if settings.source is not None:
        command += [str(settings.source)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode == 0:
        record: Record = json.loads(done.stdout)
        return record
    lines = done.stderr.strip().splitlines()
    reason = lines[-1].removeprefix("edgetree: ") if lines else "no error message"
    if done.returncode == _USAGE:
        raise InputError(reason)
    killed = " (out of memory?)" if done.returncode < 0 else ""
    raise CheckFailed(
        f"the benchmark of {path} ended with exit code {done.returncode}{killed}: {reason}"
    )


def _check(path: Path, record: Record, settings: TableSettings) -> None:
    size, precision = [settings.width, settings.height], PRECISIONS[settings.precision]
    if record["input_px"] != size or record["precision"] != precision:
        width, height = record["input_px"]
        raise ModelFileError(
            f"model {path} takes {width}x{height} px in {record['precision']}: expected"
            f" {settings.width}x{settings.height} px in {precision}, as in its name"
        )


def _merge(records: list[Record]) -> Record:
    """Merge the records of all rounds of one file."""
    times = ("detect_p50_ms", "detect_p90_ms", "fps")
    merged = records[0] | {
        name: round(statistics.median(record[name] for record in records), 2) for name in times
    }
    peaks = [record["peak_memory_mib"] for record in records]
    return merged | {
        "runs": sum(record["runs"] for record in records),
        "rounds": len(records),
        "peak_memory_mib": None if None in peaks else max(peaks),
    }
