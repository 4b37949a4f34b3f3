"""Parse descriptions of boards from the command line."""

from __future__ import annotations

from typing import Final

from basetree.errors import InputError
from calib.boards.board import Board, CharucoBoard, Checkerboard, CircleGrid

BOARD_FORMS: Final = (
    "checkerboard:9x6:0.025 (inner corners, side of a square in metres),"
    " charuco:8x6:0.03:0.022:4x4_50 (squares, sides of square and marker, dictionary),"
    " circles:7x5:0.02 or circles:4x11:0.02:asymmetric (circles per row x rows, row spacing"
    " in metres)"
)


def parse_board(text: str) -> Board:
    """Create a board from a text in one of the forms of ``BOARD_FORMS``.

    Raises:
        InputError: If the text has no known form or a value is invalid; the message quotes it.
    """
    kind, *parts = text.strip().lower().split(":")
    try:
        if kind == "checkerboard" and len(parts) == 2:
            return Checkerboard(*_counts(parts[0]), float(parts[1]))
        if kind == "charuco" and len(parts) == 4:
            return CharucoBoard(*_counts(parts[0]), float(parts[1]), float(parts[2]), parts[3])
        if kind == "circles" and (len(parts) == 2 or parts[2:] == ["asymmetric"]):
            return CircleGrid(*_counts(parts[0]), float(parts[1]), asymmetric=len(parts) == 3)
    except InputError as error:
        raise InputError(f"board {text!r}: {error}") from error
    except ValueError:
        pass
    raise InputError(f"board is {text!r}: expected one such as {BOARD_FORMS}")


def _counts(text: str) -> tuple[int, int]:
    columns, rows = text.split("x")
    return int(columns), int(rows)
