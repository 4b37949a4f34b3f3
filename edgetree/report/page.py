"""Parts of a page: beginning and end with style and script, tiles, pictures. One file, no network.

Arguments named `*_html` are inserted as they are; all other text is escaped here.
"""

from __future__ import annotations

import base64
from collections.abc import Iterable
from html import escape
from importlib import resources

__all__ = ["figure", "page_end", "page_start", "plot_tiles", "scrolling", "tiles"]


def page_start(title: str) -> str:
    """The page up to the beginning of its content, with the styles."""
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)}</title><style>{_asset('page.css')}</style></head><body><main>"
    )


def page_end(*scripts: str) -> str:
    """The page after its content, with scripts from this package by file name."""
    code = "".join(f"<script>{_asset(name)}</script>" for name in scripts)
    return f"</main>{code}</body></html>\n"


def _asset(name: str) -> str:
    return resources.files("edgetree.report").joinpath(name).read_text("utf-8")


def tiles(entries: Iterable[tuple[str, str]]) -> str:
    """Large values with a text below each, from pairs (value_html, text)."""
    return (
        '<div class="tiles">'
        + "".join(
            f'<div class="tile"><b>{value_html}</b><span>{escape(text)}</span></div>'
            for value_html, text in entries
        )
        + "</div>"
    )


def plot_tiles(plots_svg: Iterable[str]) -> str:
    """Plots side by side."""
    return (
        '<div class="plots">'
        + "".join(f'<div class="tile">{plot}</div>' for plot in plots_svg)
        + "</div>"
    )


def scrolling(table_html: str) -> str:
    """A table that scrolls sideways where the page is too narrow for it."""
    return f'<div class="scroll">{table_html}</div>'


def figure(
    jpeg: bytes, size_px: tuple[int, int], caption_html: str, alt: str, anchor: str = ""
) -> str:
    """A picture that a click shows as large as the window.

    Args:
        jpeg: content of a JPEG file.
        size_px: width and height of the picture.
        caption_html: text below the picture.
        alt: description of the picture.
        anchor: id of the element, for links; none if empty.
    """
    data = base64.b64encode(jpeg).decode("ascii")
    identity = f' id="{anchor}"' if anchor else ""
    return (
        f'<figure{identity}><label><input type="checkbox" aria-label="enlarge">'
        f'<img src="data:image/jpeg;base64,{data}" width="{size_px[0]}" '
        f'height="{size_px[1]}" alt="{escape(alt)}"></label>'
        f"<figcaption>{caption_html}</figcaption></figure>"
    )
