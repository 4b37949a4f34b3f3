"""Words of messages: numbers with their noun, and lines of one kind."""

from __future__ import annotations


def counted(number: int, noun: str) -> str:
    """A number with its noun in the singular or the plural, which ends in s.

    Examples:
        >>> counted(1, "tree"), counted(0, "frame"), counted(12000, "step")
        ('1 tree', '0 frames', '12000 steps')
    """
    return f"{number} {noun}{'' if number == 1 else 's'}"


def kind_of_line(line: str) -> str:
    """The line without digits: lines that differ in numbers alone are of one kind."""
    return "".join(character for character in line if not character.isdigit())
