"""What the simulator's settings may be, as metadata of their fields."""

from __future__ import annotations

from basetree.settings import check_value, limits
from basetree.settings.metadata import Metadata

Range = tuple[float, float]
Shares = dict[str, float]

OMIT_DEFAULT: Metadata = {"omit_default": True}
"""Metadata of settings that older datasets lack: `to_dict` omits them at their default."""


def number(lowest: float, highest: float) -> Metadata:
    """Limit a number, or both ends of a range, to [lowest, highest]."""
    return limits(lowest, highest, style="g")


def check_number(name: str, value: float, lowest: float, highest: float) -> None:
    """Check that `value` is in [lowest, highest].

    Raises:
        SettingsError: If it is not.
    """
    check_value(name, value, number(lowest, highest))
