"""The run that a training branches off."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from basetree.files.json import build
from perceptree.errors import CheckpointError
from perceptree.models import ModelSpec
from perceptree.models.spec import SpecError
from perceptree.settings.training import EXTENDABLE_SETTINGS, TrainSettings
from perceptree.training.state import STATE_NAME, read_identity

_NEEDED: Final = ("model settings", "settings")
_OWN: Final = (*EXTENDABLE_SETTINGS, "schedule", "seed")
"""Settings that a branch does not take from the run."""


@dataclass(frozen=True)
class BranchedRun:
    """What a branch takes from the run that it goes on from.

    Attributes:
        folder: Folder of the run.
        spec: Its model.
        values: Its settings, as they are stored.
    """

    folder: Path
    spec: ModelSpec
    values: Mapping[str, Any]

    @classmethod
    def read(cls, folder: Path) -> BranchedRun:
        """Read it from the state of a run.

        Raises:
            CheckpointError: If the folder has no state, or it is unreadable, or the model or the
                settings are missing in it.
        """
        identity = read_identity(folder)
        missing = [group for group in _NEEDED if group not in identity]
        if missing:
            raise CheckpointError(
                f"{folder / STATE_NAME}: not a readable training state ({missing[0]} are missing)"
            )
        values = {name: value for name, value in identity["settings"].items() if name not in _OWN}
        try:
            return cls(folder, ModelSpec.from_dict(identity["model settings"]), values)
        except SpecError as error:
            raise CheckpointError(f"{folder / STATE_NAME}: {error}") from error

    @property
    def learning_rate(self) -> float:
        """Its learning rate."""
        return self.settings(steps=1).learning_rate

    def settings(self, **changes: Any) -> TrainSettings:
        """Its settings with changes; one of `steps` and `minutes` is required."""
        return build(TrainSettings, {**self.values, **changes}, f"the settings of {self.folder}")
