"""Texts in CSV cells that no spreadsheet takes for formulas."""

from __future__ import annotations

import re
from typing import Final

# Spreadsheets split lines at commas, semicolons, tabs, bars or spaces, as their user or the
# country's settings say, and not only at the commas of this file. Some take wide signs too.
_SIGN: Final = r"[=+\-@＝＋－＠]"
_NUMBER: Final = r"[+-]\d[\d.,]*(?:[eE][+-]?\d+)?(?:[\s,;|\"]|$)"
# A word after a space may be an option or a dash, unless it calls a function or another program.
_WORD: Final = r"[=@＝＠]\S|[+\-＋－]\S*[(!|]"
_FORMULA: Final = re.compile(
    rf'^"*(?={_SIGN})|[,;|]["\s]*(?={_SIGN})(?!{_NUMBER})|\s"*(?={_WORD})(?!{_NUMBER})'
)


def text_cell(text: str) -> str:
    """A text on one line, with an apostrophe before what a spreadsheet would take for a formula.

    Examples:
        >>> text_cell("=1+1")
        "'=1+1"
        >>> text_cell("a;=1+1; -0.5 m")
        "a;'=1+1; -0.5 m"
    """
    return _FORMULA.sub(r"\g<0>'", " ".join(text.split()))
