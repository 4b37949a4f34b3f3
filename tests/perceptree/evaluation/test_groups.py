"""Groups of trees and frames by labelled conditions."""

from pathlib import Path
from typing import Any

import numpy as np

from perceptree.data import FrameRecord, TreeRecord
from perceptree.evaluation.groups import AXES, groups_of

BY_NAME = {axis.name: axis for axis in AXES}


def tree(species: str | None = None, crowd: bool = False, **truth: float) -> TreeRecord:
    return TreeRecord(1, np.array([0, 0, 5, 9.0]), np.zeros((5, 3)), None, crowd, truth, species)


def frame(scene: Any, *trees: TreeRecord) -> FrameRecord:
    extra = {} if scene is None else {"scene": scene}
    return FrameRecord(1, Path("1.png"), None, None, 20, 20, extra, trees)


def test_distance_ranges_include_their_lower_limit() -> None:
    frames = [
        frame(None, tree(distance_m=1.0), tree(distance_m=2.5)),
        frame(None, tree(), tree(distance_m=60.0), tree(distance_m=4.9, crowd=True)),
    ]
    groups = groups_of(frames, BY_NAME["distance_m"])
    assert [group.name for group in groups] == ["0 to 2.5 m", "2.5 to 5 m", "from 10 m"]
    assert [set(group.trees) for group in groups] == [{0}, {1}, {3}]
    assert all(set(group.frames) == {0, 1} for group in groups)


def test_weather_groups_frames_in_a_fixed_order() -> None:
    frames = [
        frame({"weather": "rain"}, tree(), tree()),
        frame({"weather": "clear"}, tree()),
        frame({"weather": "rain"}),
        frame({"weather": "hail"}, tree()),
        frame("a wood in summer", tree()),
    ]
    groups = groups_of(frames, BY_NAME["weather"])
    assert [group.name for group in groups] == ["clear", "rain", "hail"]
    assert [set(group.trees) for group in groups] == [{2}, {0, 1}, {3}]
    assert [set(group.frames) for group in groups] == [{1}, {0, 2}, {3}]


def test_species_and_visible_parts() -> None:
    frames = [frame(None, tree("fir", visible_fraction=1.0), tree("ash", visible_fraction=0.1))]
    names = {
        name: [g.name for g in groups_of(frames, BY_NAME[name])]
        for name in ("species", "visible_fraction")
    }
    assert names == {"species": ["ash", "fir"], "visible_fraction": ["0 to 25 %", "from 75 %"]}


def test_data_without_conditions_have_no_groups() -> None:
    assert [groups_of([frame(None, tree())], axis) for axis in AXES] == [[]] * len(AXES)
