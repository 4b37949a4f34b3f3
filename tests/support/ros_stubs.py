"""Stubs of rclpy, message_filters and the message classes, as ROS 2 generates them.

The classes are made of the definitions in rosbags, and are as strict about the types of values as
the generated ones: a sequence of numbers is an `array.array` or a list, a byte is `bytes`, a float
is a `float`.
"""

from __future__ import annotations

import array
from collections import defaultdict
from collections.abc import Callable
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype

from edgetree.sinks.ros_messages import RosMessages

_NAMES = {"float64": "double", "float32": "float", "byte": "octet", "bool": "boolean"}
_KINDS = {"double": float, "float": float, "string": str, "boolean": bool, "octet": bytes}
_CODES = {"double": "d", "float": "f", "uint8": "B"}


class InvalidParameterTypeException(Exception):
    """As of rclpy: a value of another type than the default of a parameter."""


def message_modules() -> dict[str, ModuleType]:
    """The modules `PACKAGE.msg` of all packages."""
    store = RosMessages().store
    modules: dict[str, ModuleType] = {}
    classes: dict[str, type] = {}
    for full, (_, fields) in store.fielddefs.items():
        package, _, name = full.split("/")
        classes[full] = _message_class(full, fields, classes)
        modules.setdefault(package, ModuleType(package))
        module = modules.setdefault(f"{package}.msg", ModuleType(f"{package}.msg"))
        setattr(module, name, classes[full])
    return modules


def _words(kind: Any) -> str:
    node, content = kind
    if node == Nodetype.BASE:
        return _NAMES.get(content[0], content[0])
    if node == Nodetype.NAME:
        return content.replace("/msg/", "/")
    element = _words(content[0])
    return f"{element}[{content[1]}]" if node == Nodetype.ARRAY else f"sequence<{element}>"


def _message_class(full: str, fields: Any, classes: dict[str, type]) -> type:
    types = {name: kind for name, kind in fields if name != "structure_needs_at_least_one_member"}

    class Message:
        def __init__(self, **values: Any) -> None:
            assert values.keys() <= types.keys(), f"{full} has no {values.keys() - types.keys()}"
            for name, kind in types.items():
                value = values[name] if name in values else _default(kind, classes)
                setattr(self, name, value)

        def __setattr__(self, name: str, value: Any) -> None:
            _check(types[name], value, f"{full}.{name}", classes)
            object.__setattr__(self, name, value)

        @classmethod
        def get_fields_and_field_types(cls) -> dict[str, str]:
            return {name: _words(kind) for name, kind in types.items()}

    Message.__name__ = full.rpartition("/")[2]
    return Message


def _default(kind: Any, classes: dict[str, type]) -> Any:
    node, content = kind
    if node == Nodetype.NAME:
        return classes[content]()
    if node == Nodetype.BASE:
        return {"octet": b"\0"}.get(_words(kind), _KINDS.get(_words(kind), int)())
    return np.zeros(content[1]) if node == Nodetype.ARRAY else []


def _check(kind: Any, value: Any, where: str, classes: dict[str, type]) -> None:
    node, content = kind
    if node == Nodetype.NAME:
        assert isinstance(value, classes[content]), f"{where} is {type(value)}"
    elif node == Nodetype.BASE:
        expected = _KINDS.get(_words(kind), int)
        assert isinstance(value, expected), f"{where} is {type(value)}: expected {expected}"
    elif node == Nodetype.ARRAY:
        assert len(value) == content[1], f"{where} has {len(value)} elements"
    elif isinstance(value, array.array):
        assert value.typecode == _CODES[_words(content[0])], f"{where} is of {value.typecode!r}"
    else:
        assert isinstance(value, list | tuple), f"{where} is {type(value)}"
        for each in value:
            _check(content[0], each, where, classes)


class Graph:
    """What the node asked of ROS, and the parameters that a launch file gives.

    Attributes:
        parameters: Values that are given.
        declared: Default and descriptor of each declared parameter.
        subscriptions: Callback and quality of service by topic.
        published: Messages by topic.
        pictures: The topics whose messages are synchronised.
        take: The callback for a set of synchronised messages.
        spin: What `rclpy.spin` does.
    """

    def __init__(self, **parameters: Any) -> None:
        self.parameters = parameters
        self.remapped: dict[str, str] = {}
        self.declared: dict[str, Any] = {}
        self.subscriptions: dict[str, tuple[Callable[[Any], None], Any]] = {}
        self.published: dict[str, list[Any]] = defaultdict(list)
        self.pictures: list[tuple[str, str, Any]] = []
        self.pairing: tuple[int, float] | None = None
        self.take: Callable[..., None] = lambda *_: None
        self.spin: Callable[[Any], None] = lambda _: None
        self.is_shut_down = False

    def modules(self) -> dict[str, ModuleType]:
        """All modules that the node imports from ROS."""
        graph = self
        made = message_modules()

        class Synchronizer:
            def __init__(self, subscribers: list[Any], queue: int, slop: float) -> None:
                graph.pairing = (queue, slop)
                graph.pictures = subscribers

            def registerCallback(self, function: Any) -> None:
                graph.take = function

        def shut_down() -> None:
            graph.is_shut_down = True

        contents: dict[str, dict[str, Any]] = {
            "rclpy": {
                "init": lambda args=None: None,
                "spin": lambda node: graph.spin(node),
                "try_shutdown": shut_down,
            },
            "rclpy.node": {"Node": _node_class(graph)},
            "rclpy.executors": {"ExternalShutdownException": type("Shut", (Exception,), {})},
            "rclpy.exceptions": {"InvalidParameterTypeException": InvalidParameterTypeException},
            "rclpy.qos": {
                "QoSProfile": lambda **given: SimpleNamespace(**given),
                "ReliabilityPolicy": SimpleNamespace(RELIABLE="reliable"),
                "DurabilityPolicy": SimpleNamespace(TRANSIENT_LOCAL="transient local"),
                "qos_profile_sensor_data": "sensor data",
            },
            "rcl_interfaces": {},
            "rcl_interfaces.msg": {"ParameterDescriptor": SimpleNamespace},
            "message_filters": {
                "ApproximateTimeSynchronizer": Synchronizer,
                "Subscriber": lambda node, kind, topic, qos_profile: (
                    kind.__name__,
                    topic,
                    qos_profile,
                ),
            },
        }
        for name, content in contents.items():
            made[name] = ModuleType(name)
            made[name].__dict__.update(content)
        return made


def _check_type(name: str, default: Any, given: Any) -> None:
    """Refuse a value of another type than the default, as rclpy does."""
    if None not in (default, given) and type(given) is not type(default):
        raise InvalidParameterTypeException(f"{name} has the wrong type {type(given)}")


def _node_class(graph: Graph) -> type:
    class Node:
        def __init__(self, name: str) -> None:
            self.name = name

        def declare_parameter(self, name: str, value: Any, descriptor: Any) -> None:
            assert (value is None) == descriptor.dynamic_typing
            _check_type(name, value, graph.parameters.get(name))
            graph.declared[name] = (value, descriptor)

        def get_parameter(self, name: str) -> Any:
            value = graph.parameters.get(name, graph.declared[name][0])
            return SimpleNamespace(value=value)

        def resolve_topic_name(self, name: str) -> str:
            return graph.remapped.get(name, f"/{name}")

        def create_publisher(self, kind: type, topic: str, qos: Any) -> Any:
            def publish(message: Any) -> None:
                assert isinstance(message, kind)
                graph.published[topic].append(message)

            return SimpleNamespace(publish=publish)

        def create_subscription(self, kind: type, topic: str, take: Any, qos: Any) -> None:
            graph.subscriptions[topic] = (take, qos)

        def create_timer(self, period_s: float, callback: Any) -> None:
            self.tick = callback

        def get_clock(self) -> Any:
            return SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=7_000_000_000))

        def get_logger(self) -> Any:
            return SimpleNamespace(warning=lambda text, **_: graph.published["log"].append(text))

        def destroy_node(self) -> None:
            pass

    return Node
