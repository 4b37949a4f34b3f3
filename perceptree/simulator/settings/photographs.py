"""Settings of photographs on the materials. By default there are none."""

from __future__ import annotations

import re
from dataclasses import dataclass

from basetree.errors import SettingsError
from perceptree.simulator.settings.checks import check_number

_SHA256 = re.compile(r"([0-9a-f]{64})?")


@dataclass(frozen=True)
class PhotographSettings:
    """Photographs of bark, ground, stones, leaves and far stands.

    Attributes:
        sha256: Hash of the folder's content, set by ``--textures``; empty without photographs.
        share: Fraction of the materials that show a photograph in a scene, and of the scenes
            before a photographed far stand. The others stay procedural.

    Raises:
        SettingsError: If a value is out of range.
    """

    sha256: str = ""
    share: float = 0.7

    def __post_init__(self) -> None:
        if not _SHA256.fullmatch(self.sha256):
            raise SettingsError(
                f"photographs.sha256 is {self.sha256!r}: expected 64 digits from 0 to f, or nothing"
            )
        check_number("photographs.share", self.share, 0.0, 1.0)
