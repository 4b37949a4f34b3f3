"""Parts of a page: beginning and end, headings, tiles, cards, tables and pictures."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from html import escape
from importlib import resources
from typing import Any, Final, NamedTuple, TypeAlias

import cv2
from numpy.typing import NDArray

__all__ = [
    "Cell",
    "Cells",
    "Jpeg",
    "card",
    "end",
    "figure",
    "grid",
    "heading",
    "jpeg_of",
    "note",
    "row",
    "share_cell",
    "start",
    "table",
    "tiles",
    "whole",
]

_QUALITY: Final = 82


def start(title: str, more_css: str = "") -> str:
    """The page up to the beginning of its content, with the style and rules of its own."""
    style = resources.files("basetree.page").joinpath("page.css").read_text("utf-8")
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)}</title><style>{style}{more_css}</style></head><body><main>"
    )


def end(script: str = "") -> str:
    """The page after its content, with the text of a script."""
    return f"</main>{f'<script>{script}</script>' if script else ''}</body></html>\n"


def whole(title: str, *parts_html: str) -> str:
    """A complete page without a script."""
    return f"{start(title)}{''.join(parts_html)}{end()}"


def note(text_html: str) -> str:
    """Small text; nothing if it is empty."""
    return f'<p class="note">{text_html}</p>' if text_html else ""


def heading(title: str, note_html: str = "") -> str:
    """The heading of a section, and what the reader has to know about it."""
    return f"<h2>{escape(title)}</h2>{note(note_html)}"


def tiles(entries: Iterable[tuple[str, str]]) -> str:
    """Large values with a text below each, from pairs (value_html, text)."""
    shown = "".join(
        f'<div class="tile"><b>{value_html}</b><span>{escape(text)}</span></div>'
        for value_html, text in entries
    )
    return f'<div class="tiles">{shown}</div>'


def card(title: str, content_html: str, note_html: str = "") -> str:
    """A box with a heading, if there is one, a chart or a table, and a note below."""
    head = f"<h3>{escape(title)}</h3>" if title else ""
    return f'<div class="card">{head}{content_html}{note(note_html)}</div>'


def grid(items_html: Iterable[str], kind: str = "") -> str:
    """Cards or figures side by side, as many as fit.

    Args:
        items_html: The cards or figures.
        kind: "wide" for large pictures, "halves" for two in a row, "small" for small pictures.
    """
    return f'<div class="grid {kind}">{"".join(items_html)}</div>'


class Cell(NamedTuple):
    """A cell of a table with HTML as its content, and the attributes of its element."""

    html: str
    attributes: str = ""


Cells: TypeAlias = Iterable[Cell | str]
"""The cells of a row; strings are plain text."""


def share_cell(text: str, percent: float) -> Cell:
    """A cell that is the darker, the higher the percentage."""
    return Cell(escape(text), f'class="share" style="--share:{percent:.0f}%"')


def row(cells: Cells, kind: str = "") -> str:
    """A row of a table's body; of the kind "few" it is pale."""
    return f'<tr class="{kind}">{_cells(cells, "td")}</tr>'


def table(
    head: Sequence[Cell | str],
    rows: Iterable[Cells | str],
    *,
    groups: Sequence[Cell | str] = (),
    foot: Cells = (),
    kind: str = "",
) -> str:
    """A table, which scrolls sideways where the page is too narrow for it.

    Args:
        head: The names of the columns; none if empty.
        rows: The cells of each row; a string is a row that `row` made.
        groups: a row above the head, over groups of columns.
        foot: a row below the body.
        kind: "text" for columns of words, "sortable" for one that a script sorts.
    """
    names = (_cells(cells, "th", 'scope="col"') for cells in (groups, head) if cells)
    heads = "".join(f"<tr>{cells}</tr>" for cells in names)
    body = "".join(each if isinstance(each, str) else row(each) for each in rows)
    return (
        f'<div class="scroll"><table class="{kind}"><thead>{heads}</thead><tbody>{body}</tbody>'
        f"<tfoot>{_cells(foot, 'td')}</tfoot></table></div>"
    )


def _cells(cells: Cells, tag: str, scope: str = "") -> str:
    shown = (Cell(escape(cell)) if isinstance(cell, str) else cell for cell in cells)
    return "".join(
        f"<{' '.join(filter(None, (tag, scope, own)))}>{html}</{tag}>" for html, own in shown
    )


class Jpeg(NamedTuple):
    """The content of a JPEG file, and its width and height in pixels."""

    data: bytes
    width_px: int
    height_px: int


def jpeg_of(picture: NDArray[Any], quality: int = _QUALITY) -> Jpeg:
    """Encode a picture (H, W, 3) uint8 BGR as JPEG of a quality from 0 to 100."""
    data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, quality])[1].tobytes()
    return Jpeg(data, picture.shape[1], picture.shape[0])


def figure(jpeg: Jpeg, caption_html: str, alt: str, anchor: str = "") -> str:
    """A picture that a click shows as large as the window.

    Args:
        jpeg: The picture.
        caption_html: Text below the picture.
        alt: Description of the picture.
        anchor: id of the element, for links; none if empty.
    """
    data = base64.b64encode(jpeg.data).decode("ascii")
    identity = f' id="{anchor}"' if anchor else ""
    return (
        f'<figure{identity}><label><input type="checkbox" aria-label="enlarge">'
        f'<img src="data:image/jpeg;base64,{data}" width="{jpeg.width_px}"'
        f' height="{jpeg.height_px}" alt="{escape(alt)}"></label>'
        f"<figcaption>{caption_html}</figcaption></figure>"
    )
