"""Values as texts in the cells of tables."""

from __future__ import annotations


def number_text(value: float | None, digits: int, unit: float = 1.0) -> str:
    """A number in a unit, or a dash where it is not known."""
    return "-" if value is None else f"{value / unit:.{digits}f}"


def share_text(share: float | None) -> str:
    """A share in per cent, or a dash where it is not known."""
    return "-" if share is None else f"{100 * share:.0f} %"


def machine_words(processor: str | None, usable_cores: int) -> str:
    """Processor and cores in words; not all systems tell the processor's name."""
    return f"{processor or 'processor not known'}, {usable_cores} cores"
