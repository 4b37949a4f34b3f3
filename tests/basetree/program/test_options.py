"""Dataclasses of options in typer commands, and options from the fields of settings."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

import pytest
import typer
from typer.testing import CliRunner

from basetree.errors import SettingsError
from basetree.program.options import expand_groups, given, option_of
from basetree.settings import NOT_AN_OPTION, Settings, limits, names, option


@dataclass(frozen=True)
class Size:
    width: Annotated[int, typer.Option(min=1)] = 4
    height: Annotated[int | None, typer.Option(help="Height in px.")] = None


@dataclass(frozen=True)
class Lamp(Settings):
    reach_m: float = field(default=5.0, metadata=limits(0.5, 40) | option("--reach"))
    """Distance that it lights, m."""
    kind: Literal["led", "gas"] = field(default="led", metadata=names(("led", "gas"), "led or gas"))
    """`led` or gas."""
    spare: bool = False
    """Whether there is another."""
    secret: int = field(default=3, metadata=NOT_AN_OPTION)


@dataclass(frozen=True)
class LampOptions:
    fields_of = Lamp

    reach_m: float | None = None
    kind: Annotated[str | None, option_of(Lamp, "kind", default="the shop's")] = None


def run(command: Callable[..., None], *words: str) -> Any:
    app = typer.Typer(rich_markup_mode=None, add_completion=False)
    app.command()(command)
    return CliRunner().invoke(app, words)


def test_a_group_is_expanded_to_its_options_in_order() -> None:
    seen: list[tuple[str, Size, bool]] = []

    @expand_groups
    def command(name: str, *, size: Size, flag: bool = False) -> None:
        seen.append((name, size, flag))

    assert run(command, "a", "--height", "3", "--flag").exit_code == 0
    assert run(command, "b").exit_code == 0
    assert seen == [("a", Size(4, 3), True), ("b", Size(), False)]
    assert run(command, "c", "--width", "0").exit_code == 2
    text = run(command, "--help").output
    assert text.index("--width") < text.index("--height") < text.index("--flag")
    assert "Height in px." in text


def test_settings_are_a_group_with_the_words_limits_and_defaults_of_their_fields() -> None:
    seen: list[Lamp] = []

    @expand_groups
    def command(*, lamp: Lamp) -> None:
        seen.append(lamp)

    assert run(command).exit_code == 0
    assert run(command, "--reach", "7", "--kind", "gas", "--spare").exit_code == 0
    assert seen == [Lamp(), Lamp(7.0, "gas", True)]
    with pytest.raises(SettingsError, match="kind is 'oil': expected led or gas"):
        raise run(command, "--kind", "oil").exception
    text = " ".join(run(command, "--help").output.split())
    assert "Distance that it lights, m. [0.5 to 40; default: 5]" in text
    assert "led or gas. [led or gas; default: led]" in text
    assert "Whether there is another. --help" in text
    assert "--secret" not in text


def test_a_group_may_offer_some_fields_of_settings_and_leave_them_open() -> None:
    seen: list[dict[str, Any]] = []

    @expand_groups
    def command(*, lamp: LampOptions) -> None:
        seen.append(given(lamp, Lamp))

    assert run(command).exit_code == 0
    assert run(command, "--reach", "100").exit_code == 0
    assert seen == [{}, {"reach_m": 100.0}]
    text = " ".join(run(command, "--help").output.split())
    assert "[0.5 to 40; default: 5]" in text
    assert "[led or gas; default: the shop's]" in text
    assert "--spare" not in text
