"""JSON that people edit: what is wrong in it is one line with the file, the place and the value."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import pytest
from msgspec import Meta

from basetree.errors import InputError
from basetree.files.json import build, decode, parse_json, read_json
from basetree.files.names import is_inside

SCHEMA = "edgetree.test/1"


@dataclass(frozen=True)
class Frame:
    file: str
    size_px: tuple[int, int] = (1, 1)

    def __post_init__(self) -> None:
        if not self.file:
            raise InputError("a frame has no file")


@dataclass(frozen=True)
class Content:
    frames: Annotated[tuple[Frame, ...], Meta(max_length=3)] = ()
    block: Annotated[int, Meta(ge=1)] = 1
    share: Annotated[float, Meta(ge=0, lt=1)] | None = None
    done: bool = False
    parts: dict[str, Annotated[str, Meta(pattern="^[0-9a-f]{4}$")]] | None = None


def read(folder: Path, text: str | bytes) -> Content:
    path = folder / "kit.json"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_json(path, SCHEMA, Content, "a kit")


def text_of(**fields: Any) -> str:
    return json.dumps({"schema": SCHEMA, **fields})


def test_a_file_becomes_its_dataclass_and_unknown_fields_are_ignored(tmp_path: Path) -> None:
    frame = {"file": "a", "size_px": [4, 5], "later": 1}
    found = read(tmp_path, text_of(frames=[frame], share=0, added_later={"a": [1]}))
    assert found == Content((Frame("a", (4, 5)),), share=0.0)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"frames": [{"file": 5}]}, "kit.json: frames[0].file is 5, expected text"),
        ({"frames": [{"file": None}]}, "frames[0].file is null, expected text"),
        ({"frames": [{}]}, "kit.json: frames[0] has no field 'file', expected it"),
        ({"frames": {}}, "kit.json: frames is an object, expected a list"),
        ({"frames": [3]}, "kit.json: frames[0] is 3, expected an object"),
        ({"frames": [{"file": ""}]}, "kit.json: a frame has no file"),
        (
            {"frames": [{"file": "a"}] * 4},
            "frames is a list of 4 items, expected a list of at most 3 items",
        ),
        (
            {"frames": [{"file": "a", "size_px": [1]}]},
            "frames[0].size_px is a list of 1 items, expected a list of 2 items",
        ),
        ({"block": 0}, "kit.json: block is 0, expected a whole number of at least 1"),
        ({"block": 0.5}, "kit.json: block is 0.5, expected a whole number"),
        ({"block": True}, "kit.json: block is true, expected a whole number"),
        ({"block": "x"}, "kit.json: block is 'x', expected a whole number"),
        ({"block": {}}, "kit.json: block is an object, expected a whole number"),
        ({"block": "x" * 999}, "expected a whole number"),
        ({"share": 1}, "kit.json: share is 1, expected a number below 1"),
        ({"share": "1"}, "kit.json: share is '1', expected a number or null"),
        ({"done": 1}, "kit.json: done is 1, expected true or false"),
        (
            {"parts": {"a": "z"}},
            "kit.json: parts[...]: expected text matching regex",
        ),
        ({"parts": {"a": 3}}, "kit.json: parts[...] is a whole number, expected text"),
    ],
)
def test_a_wrong_field_is_named(tmp_path: Path, fields: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError) as raised:
        read(tmp_path, text_of(**fields))
    assert message in str(raised.value)
    assert str(tmp_path / "kit.json") in str(raised.value)
    assert len(str(raised.value)) < 400


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "it is not JSON"),
        ("[]", "has the schema 'list'"),
        ("{}", "has the schema None"),
        ('{"schema": [[1]]}', r"has the schema \[\[1\]\]: expected a kit, schema edgetree.test/1"),
        ("[" * 100_000, "nested too deeply"),
        ('{"a":' * 100_000, "nested too deeply"),
        ('{"a":' + "[" * 60 + "]" * 60 + "}", "nested more than 50 levels"),
        (text_of(**{"\ud800": 1}), "kit.json: a field's name is not text"),
        ('{"block": 1, "block": 2}', "block is given twice"),
        ('{"share": NaN}', "NaN is not a JSON number"),
        ('{"share": -Infinity}', "-Infinity is not a JSON number"),
        ('{"share": 1e999}', "1e999 is not a number of 64 bits"),
        ('{"block": 1' + "0" * 400 + "}", "10000.* is not a number of 64 bits"),
        ('{"block": -1' + "0" * 9000 + "}", "-10000.* is not a number of 64 bits"),
        (b"\xff\xfe\x00\xd8", "not a text file"),
        (b"[" + b" " * 2**21, "larger than 2097152 bytes, the limit text_file_bytes"),
    ],
)
def test_other_files_are_refused(tmp_path: Path, text: str | bytes, message: str) -> None:
    with pytest.raises(InputError, match=message) as raised:
        read(tmp_path, text)
    assert "\n" not in str(raised.value)


def test_the_numbers_of_64_bits_are_read(tmp_path: Path) -> None:
    assert read(tmp_path, text_of(block=2**64 - 1)).block == 2**64 - 1
    assert parse_json(f"[{-(2**63)}, 1e308, -0.0]") == [-(2**63), 1e308, 0.0]


@pytest.mark.parametrize("value", [10**400, float("inf"), float("nan")])
def test_values_that_are_not_from_json_are_checked_too(value: float) -> None:
    with pytest.raises(InputError, match="share is "):
        build(Content, {"share": value}, "record")


def test_a_large_text_is_read_for_a_few_fields() -> None:
    many = [{"file": f"{number}", "more": [[0] * 9] * 9} for number in range(3)]
    content = json.dumps({"frames": many, "rest": many * 100}).encode()
    assert decode(Content, content, "labels").frames[2] == Frame("2")
    for wrong, message in (
        (
            b'{"frames": [{"file": 5}]}',
            r"labels: frames\[0\].file is a whole number, expected text",
        ),
        (b'{"share": 1e999}', r"labels: share: expected a number of 64 bits"),
        (b"[" * 10_000, "labels"),
        (b'{"rest":' + b"[" * 10_000, "labels is not JSON"),
        (b"\xff", "labels is not JSON"),
    ):
        with pytest.raises(InputError, match=message):
            decode(Content, wrong, "labels")


@pytest.mark.parametrize(
    ("name", "inside"),
    [
        *((name, True) for name in ("a", "frames/a.raw", "frames\\a.raw", "a..b", ".hidden/..a")),
        *((name, False) for name in ("", "..", "../a", "a/../../b", "a\\..\\b", "/dev/zero")),
        *((name, False) for name in ("C:\\a", "C:a", "\\\\host\\share\\a", "\\a", "a\0b")),
    ],
)
def test_paths_in_files_stay_inside_their_folder(name: str, inside: bool) -> None:
    assert is_inside(name) == inside
