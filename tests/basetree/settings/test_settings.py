"""Settings are checked by the metadata of their fields, and say what was expected."""

import math
from dataclasses import dataclass, field, replace
from typing import Any

import pytest

from basetree.errors import InputError, SettingsError
from basetree.settings import (
    UNORDERED,
    Settings,
    check_value,
    field_words,
    label,
    limits,
    names,
    weights,
)


@dataclass(frozen=True)
class Lamp(Settings):
    """A lamp."""

    reach_m: float = field(default=5.0, metadata=limits(0.5, 40, style="g"))
    """Distance that it lights,
    in metres."""
    power: float | None = field(default=None, metadata=limits(over=0))
    share: float = field(default=0.5, metadata=limits(over=0, most=1))
    decay: float = field(default=0.5, metadata=limits(0, under=1))
    flashes: int = field(default=0, metadata=limits(0, whole=True))
    beam_deg: tuple[float, float] = field(default=(10.0, 20.0), metadata=limits(1, 90))
    size: tuple[float, float] = field(default=(2.0, 1.0), metadata=limits(over=0) | UNORDERED)
    kind: str = field(default="led", metadata=names(("led", "gas")) | label("the lamp's kind"))
    colours: dict[str, float] = field(
        default_factory=lambda: {"red": 1.0}, metadata=weights(("red", "blue"))
    )

    def _check_together(self) -> None:
        if self.flashes and self.kind == "gas":
            self._refuse(f"flashes is {self.flashes} for gas", "0")


@dataclass(frozen=True)
class Counts(Settings, each=limits(0, 50), error=InputError):
    """Numbers of things."""

    trees: int = 0
    stones: int = 0
    """Stones."""
    lamp: Lamp = Lamp()


MISTAKES: list[tuple[dict[str, Any], str]] = [
    ({"reach_m": 60.0}, "reach_m is 60: expected 0.5 to 40"),
    ({"reach_m": math.nan}, "reach_m is nan: expected 0.5 to 40"),
    ({"power": 0.0}, "power is 0.0: expected more than 0"),
    ({"power": math.inf}, "power is inf: expected more than 0"),
    ({"power": 10**400}, f"power is {10**400}: expected more than 0"),
    ({"share": 0}, "share is 0: expected over 0, at most 1"),
    ({"decay": 1}, "decay is 1: expected at least 0, under 1"),
    ({"flashes": 2.5}, "flashes is 2.5: expected an integer, at least 0"),
    ({"beam_deg": (20.0, 10.0)}, "beam_deg is (20.0, 10.0): expected low <= high, both in [1, 90]"),
    ({"beam_deg": (0, 10)}, "beam_deg is (0, 10): expected low <= high, both in [1, 90]"),
    ({"kind": "oil"}, "the lamp's kind is 'oil': expected one of led, gas"),
    ({"colours": {"green": 1}}, "colours has the name 'green': expected one of red, blue"),
    ({"colours": {"red": -1}}, "colours['red'] is -1: expected a weight of at least 0"),
    ({"colours": {"red": 0}}, "colours has no weight above 0: expected at least one"),
    ({"flashes": 3, "kind": "gas"}, "flashes is 3 for gas: expected 0"),
]


@pytest.mark.parametrize(("changes", "message"), MISTAKES, ids=[name for _, name in MISTAKES])
def test_a_wrong_value_is_refused_with_what_was_expected(
    changes: dict[str, Any], message: str
) -> None:
    with pytest.raises(SettingsError) as caught:
        replace(Lamp(), **changes)
    assert str(caught.value) == message


def test_values_on_the_limits_are_taken() -> None:
    Lamp(40, 1e-9, 1, 0, 7, (1, 90), (9, 1), "led", {"blue": 1, "red": 0})
    Lamp(0.5, None, 1e-9, 0.999, 0, (5, 5))


def test_a_class_may_have_one_rule_for_all_fields_and_another_error() -> None:
    assert Counts(50, 0).trees == 50
    with pytest.raises(InputError, match=r"^stones is 51: expected 0 to 50$"):
        Counts(0, 51)


def test_a_value_alone_is_checked_likewise() -> None:
    check_value("workers", 3, limits(1, 4))
    with pytest.raises(SettingsError, match=r"^distance is 0 m: expected more than 0$"):
        check_value("distance", 0, limits(over=0, unit="m"))


def test_the_words_of_a_field_are_the_docstring_below_it() -> None:
    assert field_words(Lamp) == {"reach_m": "Distance that it lights, in metres."}
    assert field_words(Counts) == {"stones": "Stones."}
