"""Texts in the encodings in which people have them."""

from __future__ import annotations

from pathlib import Path

import pytest

from basetree.errors import InputFileError
from basetree.files.reading import decode_text, read_text

TEXT = 'Intrinsic of "Color"\nFx: 612.5\n# Kamera für Bäume, Ø 30 cm, Größe 5 µm\n'


@pytest.mark.parametrize(
    "encoding",
    [
        *("utf-8", "utf-8-sig", "utf-16", "utf-32", "cp1252"),
        *("latin-1", "cp1250", "cp437", "cp850", "mac_roman", "iso8859_15"),
    ],
)
@pytest.mark.parametrize("line_end", ["\n", "\r\n", "\r"])
def test_the_part_in_ascii_is_the_same(tmp_path: Path, encoding: str, line_end: str) -> None:
    path = tmp_path / "camera.txt"
    path.write_bytes(TEXT.replace("\n", line_end).encode(encoding, errors="replace"))
    text = read_text(path, "a text")
    assert text.splitlines()[:2] == TEXT.splitlines()[:2]
    assert len(text.splitlines()) == 3


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "utf-32", "cp1252"])
def test_the_whole_text_is_read(encoding: str) -> None:
    assert decode_text(TEXT.encode(encoding)) == TEXT


@pytest.mark.parametrize("mark", [b"\xfe\xff", b"\x00\x00\xfe\xff"])
def test_the_other_byte_order(mark: bytes) -> None:
    encoding = "utf-16-be" if len(mark) == 2 else "utf-32-be"
    assert decode_text(mark + TEXT.encode(encoding)) == TEXT


@pytest.mark.parametrize(
    "data",
    [
        b"\x89PNG\r\n\x1a\n\x00\x00",
        b"\xff\xd8\xff\xe0\x00\x10JFIF",
        b"\xff\xfe\x41",  # half a character
        b"\xff\xfe\x00\x00\x41",
        b"\xff\xfe\x00\xd8\x41\x00",  # half a pair
        b"text \x80 and \x01",
    ],
)
def test_other_data_is_no_text(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "camera.txt"
    path.write_bytes(data)
    with pytest.raises(InputFileError, match=r"camera\.txt: not a text file, expected a text"):
        read_text(path, "a text")
