"""Settings of photographs on the materials. By default there are none."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

from basetree.settings import Settings, label
from perceptree.simulator.settings.checks import number

_SHA256 = re.compile(r"([0-9a-f]{64})?")


@dataclass(frozen=True)
class PhotographSettings(Settings):
    """Photographs of bark, ground, stones, leaves and far stands."""

    sha256: str = ""
    """Hash of the folder's content, set by `--textures`; empty without photographs."""
    share: float = field(default=0.7, metadata=number(0, 1) | label("photographs.share"))
    """Fraction of the materials that show a photograph in a scene, and of the scenes before a
    photographed far stand. The others stay procedural."""

    def _check_together(self) -> None:
        if not _SHA256.fullmatch(self.sha256):
            found = f"photographs.sha256 is {self.sha256!r}"
            self._refuse(found, "64 digits from 0 to f, or nothing")
