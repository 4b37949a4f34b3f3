"""Pages: whole, self-contained, with everything escaped that is not HTML."""

from __future__ import annotations

import base64
import re
from html.parser import HTMLParser

import cv2
import numpy as np

from basetree.page import parts

VOID = {"meta", "img", "input"}


class Outline(HTMLParser):
    """The tags of a page and the texts of its cells; fails on wrongly nested tags."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.open_tags: list[str] = []
        self.tags: list[str] = []
        self.cells: list[str] = []
        self.feed(html)
        self.close()
        assert self.open_tags == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.open_tags += [] if tag in VOID else [tag]
        self.cells += [""] if tag in ("td", "th") else []

    def handle_endtag(self, tag: str) -> None:
        assert self.open_tags.pop() == tag

    def handle_data(self, data: str) -> None:
        if {"td", "th"} & set(self.open_tags):
            self.cells[-1] += data


def test_a_page_is_whole_and_loads_nothing() -> None:
    html = parts.whole("a <b>", parts.heading("x & y", "<i>note</i>"), parts.card("c", "d", "e"))
    found = Outline(html)
    assert {"script", "link", "iframe", "b"} & set(found.tags) == set()
    assert not re.search(r"url\(|@import|https?:", html)
    assert html.startswith("<!doctype html>")
    assert "prefers-color-scheme: dark" in html
    assert "<title>a &lt;b&gt;</title>" in html
    assert "<h2>x &amp; y</h2>" in html
    assert "<i>note</i>" in html


def test_styles_and_scripts_of_a_page_are_inside_it() -> None:
    html = parts.start("t", ".own{}") + parts.end("go();")
    assert ".own{}</style>" in html
    assert "<script>go();</script></body>" in html
    Outline(html)


def test_cells_are_text_unless_they_are_html() -> None:
    rows = [["<a>", parts.Cell("<i>x</i>", 'class="y"')], parts.row(["1", "2"], "few")]
    html = parts.table(
        ["one", "two"], rows, groups=[parts.Cell("both", 'colspan="2"')], foot=["3", "4"]
    )
    found = Outline(html)
    assert found.cells == ["both", "one", "two", "<a>", "x", "1", "2", "3", "4"]
    assert '<td class="y"><i>x</i></td>' in html
    assert '<th scope="col" colspan="2">both</th>' in html
    assert '<tr class="few">' in html
    assert Outline(parts.table([], [["a"]])).tags.count("th") == 0


def test_a_share_darkens_its_cell() -> None:
    assert parts.share_cell("<1 %", 0.6) == ("&lt;1 %", 'class="share" style="--share:1%"')


def test_tiles_and_notes_escape_their_text() -> None:
    assert parts.tiles([("<b>1</b>", "a & b")]).count("&amp;") == 1
    assert parts.note("") == ""
    assert "<h3>" not in parts.card("", "content")


def test_a_figure_holds_its_picture() -> None:
    jpeg = parts.jpeg_of(np.full((6, 10, 3), 200, np.uint8))
    html = parts.figure(jpeg, "<b>caption</b>", 'a "name"', "frame-1")
    Outline(html)
    data = re.search(r"base64,([^\"]+)", html)
    assert data is not None
    picture = cv2.imdecode(np.frombuffer(base64.b64decode(data[1]), np.uint8), cv2.IMREAD_COLOR)
    assert picture is not None
    assert picture.shape == (6, 10, 3)
    assert 'width="10" height="6" alt="a &quot;name&quot;"' in html
    assert html.startswith('<figure id="frame-1">')
