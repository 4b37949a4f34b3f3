"""What decides a dataset's content, and the record of it that the dataset keeps."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from typing import Any

from perceptree.simulator.photographs.folder import CREDITS, PhotoFolder, with_photographs
from perceptree.simulator.settings import SimulatorSettings
from perceptree.simulator.settings.checks import check_number
from perceptree.simulator.settings.files import FileSettings

MAX_SEED = 999_999
_VERSION = 2
_FILES = FileSettings()


@dataclasses.dataclass(frozen=True)
class DatasetPlan:
    """What decides a dataset's content, except for the number of frames.

    Attributes:
        settings: Settings of the simulator; they get the hash of the photographs.
        seed: Seed of the dataset.
        files: File formats.
        photographs: Photographs that the scenes show besides; None for none.

    Raises:
        SettingsError: If the seed is out of range, or the settings name other photographs.
    """

    settings: SimulatorSettings
    seed: int = 0
    files: FileSettings = _FILES
    photographs: PhotoFolder | None = None

    def __post_init__(self) -> None:
        check_number("seed", self.seed, 0, MAX_SEED)
        settings = with_photographs(self.settings, self.photographs)
        object.__setattr__(self, "settings", settings)

    @property
    def sha256(self) -> str:
        """Hash of everything that determines the dataset's bytes."""
        return settings_sha256(self.settings, self.seed, self.files)

    def content(self) -> bytes:
        """Make the content of `settings.json`, with the credits of the photographs."""
        record = _settings_record(self.settings, self.seed, self.files)
        content = {**record, "sha256": self.sha256}
        if self.photographs is not None:
            content[CREDITS] = self.photographs.credits
        return json.dumps(content, indent=1).encode()


def settings_sha256(settings: SimulatorSettings, seed: int, files: FileSettings = _FILES) -> str:
    """Hash everything that determines a dataset's bytes, except for the number of frames."""
    content = json.dumps(_settings_record(settings, seed, files), sort_keys=True)
    return hashlib.sha256(content.encode()).hexdigest()


def _settings_record(settings: SimulatorSettings, seed: int, files: FileSettings) -> dict[str, Any]:
    return {
        "settings": settings.to_dict(),
        "seed": seed,
        "files": dataclasses.asdict(files),
        "version": _VERSION,
    }
