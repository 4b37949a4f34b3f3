"""The tables of the documentation are those of the stored results."""

import pytest

from benchmarks.figures.__main__ import TABLES
from benchmarks.figures.pages import filled, names, pages, read


@pytest.mark.parametrize("page", pages(), ids=lambda page: page.stem)
def test_the_tables_of_a_page_are_those_of_the_stored_results(page):
    text = read(page)
    made = {name: list(TABLES[name]()) for name in names(text)}
    assert text == filled(text, made), "python -m benchmarks.figures makes them anew"


def test_each_table_stands_in_a_page():
    assert sorted(name for page in pages() for name in names(read(page))) == sorted(TABLES)


def test_a_table_replaces_the_one_before_and_nothing_else():
    page = "a\n<!-- figures: one -->\n\n| old |\n\n<!-- end of figures -->\nb\n"
    once = filled(page, {"one": ["| new |"]})
    assert once == page.replace("old", "new")
    assert filled(once, {"one": ["| new |"]}) == once
    with pytest.raises(KeyError, match="one"):
        filled(page, {"two": ["| new |"]})
