"""Set-up files: the options of a command in TOML, with the line of each mistake."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Annotated

import pytest
import typer

from basetree.errors import InputError, InputFileError
from basetree.program.setup_file import NoPath, lines_named, read_setup, setup_keys, setup_text


def command(
    source: Annotated[str, typer.Argument(metavar="SOURCE"), NoPath("camera".__eq__)],
    *,
    config: Annotated[Path | None, typer.Option(is_eager=True)] = None,
    camera_height: Annotated[str | None, typer.Option(help="How high.")] = None,
    csv_file: Annotated[Path | None, typer.Option("--csv")] = None,
    model: Annotated[str, typer.Option(metavar="NAME|FILE")] = "depth",
    strict: Annotated[bool, typer.Option("--strict/--no-strict")] = True,
    threads: Annotated[int | None, typer.Option(min=1)] = None,
    share: Annotated[float, typer.Option(min=0.0, max=1.0)] = 0.5,
    topic: Annotated[list[str] | None, typer.Option()] = None,
    token: Annotated[str | None, typer.Option()] = None,
) -> None:
    """A command."""


def written(folder: Path, text: str) -> Path:
    path = folder / "setup.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_keys_are_the_names_of_options() -> None:
    assert list(setup_keys(command)) == [
        *("source", "camera-height", "csv", "model", "strict", "threads", "share", "topic"),
        "token",
    ]


def test_values_are_what_would_be_typed_and_paths_begin_at_the_file(tmp_path: Path) -> None:
    (tmp_path / "own.onnx").write_text("")
    (tmp_path / "images").mkdir()
    (tmp_path / "depth").mkdir()  # no model
    text = 'source = "./images"\ncamera-height = 1.5\ncsv = "a.csv"\nmodel = "own.onnx"\n'
    setup = read_setup(written(tmp_path, text + "strict = false\nshare = 1\n"), command)
    assert setup.values == {
        "source": str(tmp_path / "images"),
        "camera_height": "1.5",
        "csv_file": str(tmp_path / "a.csv"),
        "model": str(tmp_path / "own.onnx"),
        "strict": False,
        "share": 1,
    }
    again = read_setup(written(tmp_path, 'source = 0\nmodel = "depth"\ncsv = "/x/a"'), command)
    assert again.values == {"source": "0", "model": "depth", "csv_file": "/x/a"}


@pytest.mark.parametrize("name", ["images", "images.d", "sub/images", "0"])
def test_a_source_begins_at_the_file_unless_it_is_a_camera(tmp_path: Path, name: str) -> None:
    (tmp_path / name).mkdir(parents=True)
    (tmp_path / "camera").mkdir()
    setup = read_setup(written(tmp_path, f'source = "{name}"'), command)
    assert setup.values == {"source": str(tmp_path / name)}
    for other in ("camera", "elsewhere"):
        setup = read_setup(written(tmp_path, f'source = "{other}"'), command)
        assert setup.values == {"source": other}


MISTAKES = {
    "unknown": ("\nthreds = 1", "setup.toml line 2: threds is no setting: expected threads"),
    "underscore": ('camera_height = "1"', "line 1: camera_height is .* expected camera-height"),
    "strange": ("\n\nxyzzy = 1", "line 3: xyzzy is no setting: expected the name of an option"),
    "table": ("[mqtt]\na = 1", "line 1: mqtt is no setting"),
    "dotted": ("\nmodel.name = 1", "line 2: model is a table: expected a text"),
    "text": ("threads = '4'", "line 1: threads is '4': expected a whole number"),
    "flag": ("strict = 1", "line 1: strict is 1: expected true or false"),
    "true": ("\nthreads = true", "line 2: threads is true: expected a whole number"),
    "range": ("share = 1.5", r"line 1: share is 1\.5: expected 0 to 1"),
    "least": ("threads = 0", "line 1: threads is 0: expected at least 1"),
    "nan": ("share = nan", "line 1: share is nan: expected 0 to 1"),
    "list": ("topic = 'a=b'", "line 1: topic is 'a=b': expected a list of texts"),
    "path": ("csv = 3", "line 1: csv is 3: expected a path, as a text"),
    "in texts": ('source = """\nthreads = 0"""\nthreads = 0', "line 3: threads is 0"),
    "syntax": ("source = 'a'\nthreads == 1", "line 2: Invalid value, expected a set-up file"),
    "twice": ("threads = 1\nthreads = 2", "line 2: Cannot overwrite a value"),
    "deep": ("topic = " + "[" * 20_000, "setup.toml: cannot be read, expected a set-up file"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_names_its_line_and_what_was_expected(tmp_path: Path, mistake: str) -> None:
    text, message = MISTAKES[mistake]
    with pytest.raises(InputFileError, match=message):
        read_setup(written(tmp_path, text), command)


def test_files_that_cannot_be_read_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputFileError, match="no such file, expected a set-up file"):
        read_setup(tmp_path / "none.toml", command)
    with pytest.raises(InputFileError, match="larger than 65536 bytes"):
        read_setup(written(tmp_path, "#" * 70_000), command)


def test_later_errors_name_the_line_of_the_option_or_value(tmp_path: Path) -> None:
    text = 'source = "cam"\n\ncsv = "no/such/a.csv"\ncamera-height = 2\n'
    setup = read_setup(written(tmp_path, text), command)
    for message, line in {
        "--camera-height is 2: expected": "line 4: --camera-height",
        f"{tmp_path}/no/such/a.csv: no such folder": "line 3: ",
        "--csv given without --camera-height": "line 3: --csv",
    }.items():
        with pytest.raises(InputError, match=line), lines_named(setup):
            raise InputError(message)
    with pytest.raises(InputError, match=r"^--camera is wrong"), lines_named(setup):
        raise InputError("--camera is wrong")


def test_what_is_shown_is_a_set_up_file_again(tmp_path: Path) -> None:
    text = 'source = "b\\u00e4r \\"1\\""\ntopic = ["a=b"]\nstrict = false\ntoken = "secret"\n'
    setup = read_setup(written(tmp_path, text), command)
    shown = setup_text(command, setup)
    assert "secret" not in shown
    assert "# How high.\n# camera-height = " in shown
    again = read_setup(written(tmp_path, shown), command)
    given = {name: value for name, value in setup.values.items() if name != "token"}
    assert again.values == given


def test_with_every_comment_opened_the_defaults_are_valid(tmp_path: Path) -> None:
    shown = setup_text(command, None)
    lines = [line.removeprefix("# ") for line in shown.splitlines() if " = " in line]
    keys = tomllib.loads("\n".join(lines))
    assert set(keys) == set(setup_keys(command))
    assert (keys["strict"], keys["share"], keys["model"]) == (True, 0.5, "depth")
