"""Dataclasses of options in typer commands."""

from dataclasses import dataclass
from typing import Annotated

import typer
from typer.testing import CliRunner

from edgetree.commands.option_groups import expand_groups


@dataclass(frozen=True)
class Size:
    width: Annotated[int, typer.Option(min=1)] = 4
    height: Annotated[int | None, typer.Option(help="Height in px.")] = None


def test_a_group_is_expanded_to_its_options_in_order() -> None:
    seen: list[tuple[str, Size, bool]] = []

    @expand_groups
    def command(name: str, *, size: Size, flag: bool = False) -> None:
        seen.append((name, size, flag))

    app = typer.Typer(rich_markup_mode=None)
    app.command()(command)
    runner = CliRunner()
    assert runner.invoke(app, ["a", "--height", "3", "--flag"]).exit_code == 0
    assert runner.invoke(app, ["b"]).exit_code == 0
    assert seen == [("a", Size(4, 3), True), ("b", Size(), False)]
    assert runner.invoke(app, ["c", "--width", "0"]).exit_code == 2
    text = runner.invoke(app, ["--help"]).output
    assert text.index("--width") < text.index("--height") < text.index("--flag")
    assert "Height in px." in text
