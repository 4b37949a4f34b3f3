"""A page of figures that needs nothing else: no network, no script; readable in light and dark."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path


def render_page(title: str, body: str) -> str:
    """A whole page as HTML text, its style included; ``body`` is HTML, ``title`` plain text."""
    style = Path(__file__).with_name("page.css").read_text("utf-8")
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)}</title><style>{style}</style></head>"
        f"<body><main>{body}</main></body></html>\n"
    )


def tiles(entries: Iterable[tuple[str, str]]) -> str:
    """Large figures with what they are, both as HTML."""
    shown = "".join(f'<div class="tile"><b>{v}</b><span>{t}</span></div>' for v, t in entries)
    return f'<div class="tiles">{shown}</div>'


def card(title: str, content: str, note: str = "") -> str:
    """A box with a heading over ``content``, which is HTML, and a plain note below."""
    below = f'<p class="note">{escape(note)}</p>' if note else ""
    return f'<div class="card"><h3>{escape(title)}</h3>{content}{below}</div>'


def grid(cards: Sequence[str]) -> str:
    """Cards side by side, as many as fit."""
    return f'<div class="grid">{"".join(cards)}</div>'
