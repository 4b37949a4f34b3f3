"""Self-contained HTML pages: no network, no scripts, light and dark theme."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path


def render_page(title: str, body: str) -> str:
    """Return a complete HTML page with its style.

    Args:
        title: Plain text.
        body: HTML.
    """
    style = Path(__file__).with_name("page.css").read_text("utf-8")
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)}</title><style>{style}</style></head>"
        f"<body><main>{body}</main></body></html>\n"
    )


def tiles(entries: Iterable[tuple[str, str]]) -> str:
    """Return large figures with their descriptions, given as HTML, as a row of tiles."""
    shown = "".join(f'<div class="tile"><b>{v}</b><span>{t}</span></div>' for v, t in entries)
    return f'<div class="tiles">{shown}</div>'


def card(title: str, content: str, note: str = "") -> str:
    """Return a box with a heading, HTML content and a note in plain text."""
    below = f'<p class="note">{escape(note)}</p>' if note else ""
    return f'<div class="card"><h3>{escape(title)}</h3>{content}{below}</div>'


def grid(cards: Sequence[str]) -> str:
    """Return cards side by side, as many as fit."""
    return f'<div class="grid">{"".join(cards)}</div>'
