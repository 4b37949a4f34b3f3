"""The model files of networks given by name; missing ones are exported with untrained weights."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from basetree.errors import InputError
from basetree.program.python import installed_version
from basetree.settings import Settings, label, names
from edgetree.errors import SignatureError
from edgetree.export.settings import PRECISIONS, TARGETS
from edgetree.runtime.providers import AUTO, CPU
from edgetree.signing.verify import is_signature_required

NETWORKS: Final = (
    "edge-n",
    "edge-s",
    "edge-m",
    "edge-l",
    "r50",
    "r101",
    "x101-32x8d",
    "x101-32x4d",
)
_SMALLEST_PX: Final = 32

Say = Callable[[str], None]


@dataclass(frozen=True)
class NetworkFile:
    """The file of a network in one precision and size.

    Attributes:
        network: a name in `NETWORKS`, or of files in the folder.
        precision: a key of `edgetree.export.PRECISIONS`.
        width: Width of the input in pixels.
        height: Height of the input in pixels.
        path: The file.
    """

    network: str
    precision: str
    width: int
    height: int
    path: Path


@dataclass(frozen=True)
class NetworkFiles(Settings, error=InputError):
    """Networks by name, in the precisions and sizes to measure.

    Attributes:
        networks: Names in `NETWORKS`, or of files in `folder`.
        folder: Folder of the model files; missing files are exported to it.
        precisions: Keys of `edgetree.export.PRECISIONS`.
        sizes: (width, height) of the inputs in pixels.
        proposals: Region proposals per frame; None for each network's default.
        provider: Provider to run on, and to export for; see `edgetree.runtime.PROVIDERS`.

    Raises:
        InputError: a value is invalid.
    """

    networks: tuple[str, ...]
    folder: Path
    precisions: tuple[str, ...] = ("fp32",)
    sizes: tuple[tuple[int, int], ...] = ((800, 800),)
    proposals: int | None = None
    provider: str = field(default=CPU, metadata=names((AUTO, *TARGETS)) | label("--provider"))

    def _check_together(self) -> None:
        for option, values in (("--backbones", self.networks), ("--precision", self.precisions)):
            if not all(values) or len(set(values)) != len(values):
                found = f"{option} is {','.join(values)!r}"
                self._refuse(found, "distinct names separated by commas")
        for precision in self.precisions:
            if precision not in PRECISIONS:
                self._refuse(f"--precision is {precision!r}", ", ".join(PRECISIONS))
        for width, height in self.sizes:
            if min(width, height) < _SMALLEST_PX:
                found = f"--size is {width}x{height}"
                self._refuse(found, f"{_SMALLEST_PX} px or more each way")

    @property
    def target(self) -> str:
        """The provider that missing files are exported for."""
        return self.provider if self.provider in TARGETS else CPU

    def files(self) -> list[NetworkFile]:
        """All files: NAME-PRECISION-WIDTHxHEIGHT[-PROPOSALSp][-TARGET].onnx in the folder."""
        found = []
        for network in self.networks:
            for precision in self.precisions:
                for width, height in self.sizes:
                    parts = [network, precision, f"{width}x{height}"]
                    parts += [] if self.proposals is None else [f"{self.proposals}p"]
                    parts += [] if self.target == CPU else [self.target]
                    path = self.folder / f"{'-'.join(parts)}.onnx"
                    found.append(NetworkFile(network, precision, width, height, path))
        return found

    def missing(self) -> list[NetworkFile]:
        """The files that are not in the folder, and can be exported to it.

        Raises:
            InputError: a name has no file and is not in `NETWORKS`.
        """
        missing = [file for file in self.files() if not file.path.is_file()]
        for file in missing:
            if file.network not in NETWORKS:
                raise InputError(
                    f"backbone {file.network!r} has no file {file.path} and is not a known network:"
                    f" expected one of {', '.join(NETWORKS)}"
                )
        return missing

    def export_missing(self, say: Say) -> None:
        """Export the files that are missing, with untrained weights.

        Args:
            say: Called with progress messages.

        Raises:
            InputError: a name has no file and is not in `NETWORKS`, or the folder is not writable.
            SignatureError: a file is missing, and signatures are required.
            MissingPackage: a file is missing and torch is not installed.
        """
        if missing := self.missing():
            self._export(missing, say)

    def _export(self, missing: list[NetworkFile], say: Say) -> None:
        from basetree.files.writing import output_folder
        from edgetree.export import ExportSettings, export_preset

        if is_signature_required():
            raise SignatureError(
                f"model {missing[0].path} does not exist, and exporting it gives no signature,"
                " which is required here: expected signed files"
            )
        with output_folder(self.folder):
            for number, file in enumerate(missing, start=1):
                say(
                    f"exporting {number} of {len(missing)}: {file.network} with untrained weights"
                    f" to {file.path}"
                )
                wanted = ExportSettings(
                    height=file.height,
                    width=file.width,
                    proposals=self.proposals,
                    precision=file.precision,
                    target=self.target,
                )
                export_preset(file.network, file.path, settings=wanted, say=say)


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
    return Path(base) / "edgetree" / f"models-{installed_version('edgetree') or 'unknown'}"
