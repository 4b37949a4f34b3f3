"""What the hooks of the documentation make of a page."""

import importlib.util
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def hooks():
    spec = importlib.util.spec_from_file_location("docs_hooks", ROOT / "docs" / "_hooks.py")
    assert spec is not None
    assert spec.loader is not None
    hooks = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(hooks)
    return hooks


@pytest.fixture(scope="module")
def generated(hooks):
    return hooks.on_page_markdown


@pytest.mark.parametrize("page", ["explanation/measurement.md", "explanation/accuracy.md"])
def test_no_marker_is_left_in_a_page(generated, page):
    text = (ROOT / "docs" / page).read_text("utf-8")
    assert "{{" in text
    assert "{{" not in generated(text)


def test_numbers_and_tables_are_those_of_the_code(generated):
    assert generated("{{LITTER_STD_M cm}} and {{LIFT}}") == "2 cm and 0.35"
    assert generated("{{bend_std_deg}}, {{out_of_round_std %}}") == "0.5, 2 %"
    table = generated("<!-- constants: measure -->")
    assert "| `LITTER_STD_M` | 0.02 | Smallest standard deviation of the ground's height" in table
    assert table.count("fitted (") > 20


def test_an_unknown_name_is_an_error(generated):
    with pytest.raises(ValueError, match=r"\{\{NO_SUCH_M\}\}: expected a constant or a setting of"):
        generated("{{NO_SUCH_M}}")


def test_the_page_of_schemas_lists_each_with_its_keys(generated):
    rows = generated("<!-- schemas: perceptree -->").splitlines()
    assert [row for row in rows if row.startswith("| `perceptree.labels/2`") if "`images`" in row]
    assert [row for row in rows if row.startswith("| `perceptree.scene-frames/1`")]
    rows = generated("<!-- schemas: edgetree -->").splitlines()
    (row,) = (row for row in rows if row.startswith("| `edgetree.run/1`"))
    assert "`edgetree run --json`" in row
    assert "`frames`" in row
    assert "*`left_out`*" in row
    assert len(rows) > 30
    assert not [row for row in rows if "|  |" in row]


def test_options_and_numbers_with_units_stay_on_one_line(hooks):
    html = (
        '<p id="a-b">12 cm of 5 methods, <code>edge-n --out-dir a</code>, ± 3 %</p><pre>4 cm</pre>'
    )
    assert hooks.on_page_content(html) == (
        '<p id="a-b">12\u00a0cm of 5 methods, '
        '<code><span class="whole">edge-n</span> <span class="whole">--out-dir</span> a</code>, '
        "±\u00a03\u00a0%</p>"
        "<pre>4\u00a0cm</pre>"
    )
