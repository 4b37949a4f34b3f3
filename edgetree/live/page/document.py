"""The page itself: one HTML text with its style and script, and the headers that protect it."""

from __future__ import annotations

import base64
import hashlib
from functools import cache
from importlib import resources


@cache
def page_html() -> bytes:
    """The page, which loads nothing from elsewhere."""
    text = _asset("page.html").replace("{style}", _asset("page.css"))
    return text.replace("{script}", _script()).encode()


@cache
def security_headers() -> dict[str, str]:
    """Headers of every answer. Style and script are allowed by their hashes."""
    policy = {
        "default-src": "'none'",
        "style-src": _hash(_asset("page.css")),
        "script-src": _hash(_script()),
        "connect-src": "'self'",
        "img-src": "data:",
        "base-uri": "'none'",
        "form-action": "'none'",
        "frame-ancestors": "'none'",
    }
    return {
        "Content-Security-Policy": "; ".join(f"{name} {value}" for name, value in policy.items()),
        "Cross-Origin-Resource-Policy": "same-origin",
        "Cross-Origin-Opener-Policy": "same-origin",
        "Referrer-Policy": "no-referrer",
        "X-Content-Type-Options": "nosniff",
        "X-Frame-Options": "DENY",
        "Cache-Control": "no-store",
    }


def _script() -> str:
    names = ("streams.js", "plan.js", "mark.js", "detail.js", "page.js")
    return "".join(_asset(name) for name in names)


def _asset(name: str) -> str:
    return resources.files("edgetree.live.page").joinpath(name).read_text("utf-8")


def _hash(text: str) -> str:
    digest = hashlib.sha256(text.encode()).digest()
    return f"'sha256-{base64.b64encode(digest).decode()}'"
