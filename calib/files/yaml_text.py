"""Parse YAML: plain values only, within the limits of `basetree.files.limits`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import yaml

from basetree.files.json import refuse_repeated
from basetree.files.limits import current_limits

_TAG = "tag:yaml.org,2002:"
_LONGEST_NUMBER = 1000


class _Extent(NamedTuple):
    """Size of a value with its aliases written out: values, characters and levels of nesting."""

    values: int
    characters: int
    levels: int


class _Loader(yaml.SafeLoader):
    """Builds texts, numbers, lists and maps; refuses repeated keys and everything too large.

    The size of every value is known before anything is built, so that aliases cannot multiply it.
    """

    # Only the types that JSON has too; dates stay texts.
    yaml_constructors = {
        f"{_TAG}{kind}": yaml.SafeLoader.yaml_constructors[f"{_TAG}{kind}"]
        for kind in ("null", "str", "seq", "map")
    } | {None: yaml.SafeLoader.construct_undefined}

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self._limits = current_limits()
        self._open_levels = 0
        self._read = 0
        self._total = _Extent(0, 0, 0)
        self._extents: dict[yaml.Node, _Extent] = {}

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        """Compose a value and everything in it, and measure it."""
        is_alias = self.check_event(yaml.AliasEvent)
        self._open_levels += 1
        self._read += 1
        self._check(_Extent(self._read, 0, self._open_levels))
        node = super().compose_node(parent, index)
        self._open_levels -= 1
        if node is None:
            return node
        if not is_alias:
            self._extents[node] = _sum(map(self._extents.__getitem__, _children(node)), node)
        elif node not in self._extents:
            raise ValueError("an alias refers to a value that it is in")
        self._check(self._extents[node])
        if parent is None:
            self._total = _add(self._total, self._extents[node])
            self._check(self._total)
        return node

    def _check(self, found: _Extent) -> None:
        """Compare a size with the limits.

        Raises:
            ValueError: If it is larger.
        """
        limits = self._limits
        if found.levels > limits.text_nesting:
            raise ValueError(f"nested more than {limits.text_nesting} levels deep")
        if found.values > limits.text_values:
            raise ValueError(f"more than {limits.text_values} values, with aliases written out")
        if found.characters > limits.text_file_bytes:
            raise ValueError(
                f"more than {limits.text_file_bytes} characters, with aliases written out"
            )

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """Build a map; ValueError if a key is repeated."""
        if isinstance(node, yaml.MappingNode):
            refuse_repeated(key.value for key, _ in node.value if isinstance(key, yaml.ScalarNode))
        return super().construct_mapping(node, deep)


def _children(node: yaml.Node) -> list[yaml.Node]:
    if isinstance(node, yaml.SequenceNode):
        return list(node.value)
    if isinstance(node, yaml.MappingNode):
        return [child for pair in node.value for child in pair]
    return []


def _sum(parts: Any, node: yaml.Node) -> _Extent:
    """Return the size of a value, given the sizes of its parts."""
    found = _Extent(0, 0, 0)
    for part in parts:
        found = _add(found, part)
    text = len(node.value) if isinstance(node, yaml.ScalarNode) else 0
    return _Extent(found.values + 1, found.characters + text, found.levels + 1)


def _add(first: _Extent, second: _Extent) -> _Extent:
    return _Extent(
        first.values + second.values,
        first.characters + second.characters,
        max(first.levels, second.levels),
    )


def _scalar(kind: str) -> Callable[[_Loader, yaml.ScalarNode], Any]:
    """Return a constructor of numbers or bools that raises nothing but YAML's errors."""
    construct = yaml.SafeLoader.yaml_constructors[f"{_TAG}{kind}"]

    def checked(loader: _Loader, node: yaml.ScalarNode) -> Any:
        text = str(loader.construct_scalar(node))
        problem = f"a number of {len(text)} characters, expected at most {_LONGEST_NUMBER}"
        if len(text) <= _LONGEST_NUMBER:
            try:
                return construct(loader, node)
            except (ValueError, LookupError, ArithmeticError):
                problem = f"{text[:100]!r} is no {kind}"
        raise yaml.constructor.ConstructorError(None, None, problem, node.start_mark)

    return checked


_Loader.yaml_constructors |= {
    **{f"{_TAG}{kind}": _scalar(kind) for kind in ("bool", "int", "float")},
    f"{_TAG}timestamp": yaml.SafeLoader.construct_yaml_str,
    f"{_TAG}opencv-matrix": lambda loader, node: loader.construct_mapping(node, deep=True),
}


def parse_yaml(text: str) -> list[Any]:
    """Return the documents of a YAML text that are not empty.

    OpenCV's matrices become maps. Repeated keys are an error.

    Raises:
        ValueError: If the text is not YAML, has other types than JSON, or is too large.
    """
    try:
        return [item for item in yaml.load_all(text, _Loader) if item is not None]
    except yaml.YAMLError as error:
        raise ValueError(str(error)) from error
