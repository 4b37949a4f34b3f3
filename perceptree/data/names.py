"""Map category and keypoint names of other datasets to this project's."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from perceptree.data.entries import refuse, rows
from perceptree.errors import DatasetError
from perceptree.keypoints import KEYPOINT_NAMES

_TREE = re.compile(
    "trees?|trunks?|stems?|boles?|treetrunks?|conifers?|spruce|pine|fir|larch|cedar|hemlock|douglas"
    "|birch|beech|maple|oak|aspen|poplar|alder|ash|picea|pinus|abies|larix|betula|fagus|acer"
    "|quercus|populus|alnus|fraxinus"
)
_NOT_STANDING = re.compile(
    "stumps?|branch|branches|crowns?|canopy|roots?|leaf|leaves|logs?|fallen|felled|lying|deadwood"
    "|non?|not"
)
_NO_CATEGORIES = "the file has no categories: all labels are taken as trees"
# The published names are those of PercepTreeV1's demo and training scripts.
_ALIASES = {
    "felling_cut": ("kpcp", "kpc", "cutpoint", "fellingpoint"),
    "diameter_left": ("kpl", "leftdiameter"),
    "diameter_right": ("kpr", "rightdiameter"),
    "axis_middle": ("ax1", "middleaxis"),
    "axis_top": ("ax2", "topaxis"),
}


def _normalise(name: str) -> str:
    return re.sub(r"[^a-z0-9]", "", name.lower())


_KEYPOINT_OF = {
    _normalise(alias): number
    for number, name in enumerate(KEYPOINT_NAMES)
    for alias in (name, *_ALIASES[name])
}


def means_tree(name: str) -> bool:
    """Return whether a category's name means a standing tree or a tree species."""
    spaced = re.sub(r"([a-z])([A-Z])", r"\1 \2", name)
    words = re.findall(r"[a-z]+", spaced.lower())
    return any(map(_TREE.fullmatch, words)) and not any(map(_NOT_STANDING.fullmatch, words))


@dataclass(frozen=True)
class KeypointMap:
    """Positions of this project's keypoints in an annotation's list.

    Attributes:
        count: Number of keypoints in an annotation.
        indices: Index in that list of each of this project's keypoints, -1 if missing; None if none
            are used.
    """

    count: int
    indices: tuple[int, ...] | None


@dataclass(frozen=True)
class NameMap:
    """Which categories are trees, and their keypoints.

    Attributes:
        known: Ids of all categories; empty if the file has none. Then everything is a tree, with
            its keypoints under None.
        keypoints: Keypoints of each tree category, by category id.
        notes: Messages for the user about the mapping.
    """

    known: frozenset[int]
    keypoints: dict[int | None, KeypointMap]
    notes: tuple[str, ...]

    def of(self, annotation: dict[str, Any]) -> KeypointMap | None:
        """Return the keypoints of an annotation; None if its category is not a tree.

        Raises:
            EntryError: If the category id is unknown.
        """
        category = annotation.get("category_id") if self.known else None
        if category is None and len(self.keypoints) == 1:
            category = next(iter(self.keypoints))
        elif not isinstance(category, int) or category not in self.known:
            refuse(annotation, "annotation", "category_id", "the id of a category")
        return self.keypoints.get(category)


def map_names(content: dict[str, Any], annotations: Sequence[dict[str, Any]]) -> NameMap:
    """Map the categories and keypoints of a file.

    A single category is taken as trees whatever its name; of several, those whose name means tree.

    Args:
        content: The file's content.
        annotations: Its annotations.

    Raises:
        DatasetError: If none of several categories means tree.
    """
    if not content.get("categories"):
        keypoints, messages = _unnamed_keypoints(None, annotations)
        return NameMap(frozenset(), {None: keypoints}, (_NO_CATEGORIES, *messages))
    categories = rows(content, "categories")
    for category in categories:
        if not isinstance(category.get("name"), str):
            raise DatasetError(
                f"category {category['id']} has no name, expected categories with an id and a name"
            )
    counts = Counter(annotation.get("category_id") for annotation in annotations)
    chosen, notes = _tree_categories(categories, counts)
    maps: dict[int | None, KeypointMap] = {}
    for category in chosen:
        maps[category["id"]], messages = _map_keypoints(category, annotations)
        notes += [note for note in messages if note not in notes]
    return NameMap(frozenset(category["id"] for category in categories), maps, tuple(notes))


def _tree_categories(
    categories: list[dict[str, Any]], counts: Counter[Any]
) -> tuple[list[dict[str, Any]], list[str]]:
    """Return the categories that are trees, and messages about the choice."""
    parents = {str(category.get("supercategory")) for category in categories}
    # Some tools add an unlabelled parent category.
    real = [c for c in categories if counts[c["id"]] or c["name"] not in parents] or categories
    if len(real) == 1:
        known = means_tree(real[0]["name"])
        messages = f"category {real[0]['name']!r}, the only one, is taken as trees"
        return real, [] if known else [messages]
    chosen = [category for category in real if means_tree(category["name"])]
    if not chosen:
        named = ", ".join(repr(category["name"]) for category in real)
        raise DatasetError(
            f"none of the categories {named} means tree, trunk, stem or a tree species:"
            " expected tree categories to be named 'tree'"
        )
    left = [
        f"{category['name']!r} ({counts[category['id']]} labels)"
        for category in real
        if category not in chosen
    ]
    taken = ", ".join(repr(category["name"]) for category in chosen)
    if not left and len(chosen) == 1:
        return chosen, []
    return chosen, [f"taken as trees: {taken}" + ("; left out: " + ", ".join(left) if left else "")]


def _map_keypoints(
    category: dict[str, Any], annotations: Sequence[dict[str, Any]]
) -> tuple[KeypointMap, list[str]]:
    names = category.get("keypoints")
    if not isinstance(names, list) or not names:
        return _unnamed_keypoints(category["id"], annotations)
    if not all(isinstance(name, str) for name in names):
        raise DatasetError(f"keypoints of category {category['name']!r}: expected their names")
    found = [_KEYPOINT_OF.get(_normalise(name)) for name in names]
    indices = tuple(found.index(k) if k in found else -1 for k in range(len(KEYPOINT_NAMES)))
    if max(indices) < 0:
        listed = ", ".join(names)
        return KeypointMap(len(names), None), [
            f"keypoints are left out: {listed} are not {', '.join(KEYPOINT_NAMES)}"
        ]
    missing = [name for name, index in zip(KEYPOINT_NAMES, indices, strict=True) if index < 0]
    messages = [f"the file has no keypoint {', '.join(missing)}"] if missing else []
    if len(names) > len(KEYPOINT_NAMES) - len(missing):
        others = [name for name, known in zip(names, found, strict=True) if known is None]
        messages += [f"keypoints left out: {', '.join(others)}"] if others else []
    return KeypointMap(len(names), indices), messages


def _unnamed_keypoints(
    category_id: int | None, annotations: Sequence[dict[str, Any]]
) -> tuple[KeypointMap, list[str]]:
    """Map keypoints without names: five are taken in the published order, others are not used."""
    for annotation in annotations:
        listed = annotation.get("keypoints")
        if listed and category_id in (None, annotation.get("category_id", category_id)):
            count, rest = divmod(len(listed), 3) if isinstance(listed, list) else (0, 1)
            if rest:
                continue  # broken, which is told when it is read
            if count == len(KEYPOINT_NAMES):
                order = ", ".join(KEYPOINT_NAMES)
                return KeypointMap(count, tuple(range(count))), [
                    f"keypoints have no names: taken as {order}"
                ]
            return KeypointMap(count, None), [
                f"keypoints are left out: {count} without names, expected {len(KEYPOINT_NAMES)}"
            ]
    return KeypointMap(len(KEYPOINT_NAMES), tuple(range(len(KEYPOINT_NAMES)))), []
