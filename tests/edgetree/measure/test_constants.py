"""The table of constants: every one has a meaning and a source."""

from types import ModuleType

import pytest

from edgetree.measure.constants.entries import TOPICS, entries


@pytest.mark.parametrize("topic", TOPICS)
def test_every_constant_is_listed_with_its_meaning_and_source(topic: str) -> None:
    listed = entries(TOPICS[topic])
    names = [name for name in vars(TOPICS[topic]) if name.isupper()]
    assert [entry.name for entry in listed] == names
    assert len(names) > 2
    assert min(len(entry.meaning) for entry in listed) > 20


def test_names_are_unique() -> None:
    names = [entry.name for topic in TOPICS.values() for entry in entries(topic)]
    assert len(set(names)) == len(names)


def test_a_constant_without_a_source_is_an_error(tmp_path, monkeypatch) -> None:
    path = tmp_path / "unsourced.py"
    path.write_text('WIDTH_M: float = 2.0\n"""The width of a thing."""\n')
    module = ModuleType("unsourced")
    module.__file__ = str(path)
    exec(compile(path.read_text(), str(path), "exec"), vars(module))
    with pytest.raises(ValueError, match=r"unsourced\.WIDTH_M: expected a docstring with its so"):
        entries(module)
