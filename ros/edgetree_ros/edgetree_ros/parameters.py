"""The node's parameters. All but the node's own are the options of `edgetree live`."""

from __future__ import annotations

from dataclasses import MISSING, dataclass, fields
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, NamedTuple, TypeVar, Union, get_args, get_origin, get_type_hints

import typer
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.exceptions import InvalidParameterTypeException

from basetree.errors import InputError
from edgetree.commands.live_options import LiveMetresOptions
from edgetree.commands.option_groups import SessionOptions
from edgetree.commands.options import Model, ScoreThreshold

_T = TypeVar("_T")


@dataclass(frozen=True)
class NodeOptions:
    """What the node itself is asked."""

    model: Model = "depth"
    score_threshold: ScoreThreshold = 0.5
    compressed: Annotated[
        bool, typer.Option(help="Subscribe to CompressedImage: JPEG, and PNG or RVL of depth.")
    ] = False
    max_time_difference: Annotated[
        float, typer.Option(help="Largest difference of colour and depth of a frame, in seconds.")
    ] = 0.02
    queue_size: Annotated[
        int, typer.Option(help="Pictures of each topic that wait for the other.")
    ] = 10
    stale_after: Annotated[
        float, typer.Option(help="Time without a result that diagnostics call stale, in seconds.")
    ] = 1.0

    def __post_init__(self) -> None:
        for name in ("max_time_difference", "queue_size", "stale_after"):
            value = getattr(self, name)
            if not 0 < value < float("inf"):
                raise InputError(f"parameter {name} is {value}: expected a number above 0")


class Parameters(NamedTuple):
    """All parameters."""

    node: NodeOptions
    metres: LiveMetresOptions
    session: SessionOptions


def read_parameters(node: Any) -> Parameters:
    """Declare the parameters at a node, and read their values.

    Raises:
        InputError: A value is of another kind than the parameter.
    """
    groups = (NodeOptions, LiveMetresOptions, SessionOptions)
    return Parameters(*(_read(node, group) for group in groups))


def _read(node: Any, group: type[_T]) -> _T:
    hints = get_type_hints(group, include_extras=True)
    values = {}
    for entry in fields(group):  # type: ignore[arg-type]
        assert entry.default is not MISSING
        kind, words = _kind_and_help(hints[entry.name])
        # Without a default a parameter has no type, until it is given.
        is_open = entry.default is None
        about = ParameterDescriptor(description=words, read_only=True, dynamic_typing=is_open)
        try:
            node.declare_parameter(entry.name, None if is_open else entry.default, about)
        except InvalidParameterTypeException as error:  # also a whole number for a float
            expected = _EXPECTED.get(kind, "a text")
            if kind is float:
                expected += " with a point, such as 1.0"
            raise InputError(f"parameter {entry.name}: {error}: expected {expected}") from error
        given = node.get_parameter(entry.name).value
        values[entry.name] = (
            entry.default if given in (None, "") else _converted(entry.name, given, kind)
        )
    return group(**values)


def _kind_and_help(hint: Any) -> tuple[type, str]:
    """The type of an option without None, and its help."""
    words = ""
    if get_origin(hint) is Annotated:
        hint, *notes = get_args(hint)
        words = next((note.help for note in notes if getattr(note, "help", None)), "")
    if get_origin(hint) in (Union, UnionType):
        (hint,) = (each for each in get_args(hint) if each is not type(None))
    return hint, words


def _converted(name: str, value: Any, kind: type) -> Any:
    """The value of a parameter as the option has it, which may be a text that holds a number."""
    is_wrong = (kind in (int, float) and isinstance(value, bool | str)) or (
        kind is bool and not isinstance(value, bool)
    )
    if is_wrong or (kind is int and value != int(value)):
        raise InputError(f"parameter {name} is {value!r}: expected {_EXPECTED[kind]}")
    return kind(value) if kind in (int, float, bool, Path) else str(value)


_EXPECTED = {int: "a whole number", float: "a number", bool: "true or false"}
