"""Contact sheets and statistics agree with the dataset's content."""

import json
import re
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import cv2
import pytest
from schema_check import check_schema

from perceptree.errors import DatasetError
from perceptree.simulator.dataset.contact_sheet import choose_frames, write_contact_sheets
from perceptree.simulator.dataset.frozen import read_frozen
from perceptree.simulator.dataset.statistics import dataset_statistics

FRAMES = 60
VOID = {"meta", "img", "br", "rect", "path"}


@pytest.fixture(scope="module")
def dataset(fake_dataset: Callable[[int], Path]) -> Path:
    return fake_dataset(FRAMES)


@pytest.fixture(scope="module")
def figures(dataset: Path) -> dict[str, Any]:
    return json.loads((dataset / "statistics.json").read_text())


def coco(dataset: Path) -> tuple[list[dict], list[dict]]:
    contents = [
        json.loads((dataset / f"{s}_RGB.json").read_text()) for s in ("train", "val", "test")
    ]
    return [i for c in contents for i in c["images"]], [
        t for c in contents for t in c["annotations"]
    ]


def test_the_files_of_a_dataset_are_as_their_schemas_say(dataset: Path, figures: dict) -> None:
    assert check_schema(figures) == "perceptree.statistics/1"
    for name, schema in (
        ("train_RGB", "perceptree.labels"),
        ("settings", "perceptree.synth-settings"),
        ("scenes/000000", "perceptree.scene-frames"),
    ):
        check_schema(json.loads((dataset / f"{name}.json").read_text()), schema)
    frozen = json.loads(read_frozen("test").to_json())
    check_schema(frozen, "perceptree.frozen-set")


def test_the_figures_count_what_the_coco_files_hold(dataset: Path, figures: dict):
    images, trees = coco(dataset)
    splits = figures["splits"]
    assert {name: split["frames"] for name, split in splits.items()} == {
        "train": 48,
        "val": 6,
        "test": 6,
    }
    assert sum(split["trees"] for split in splits.values()) == len(trees)
    assert figures["trees_per_frame"]["mean"] == pytest.approx(len(trees) / len(images))
    assert figures["trees_per_frame"]["counts"] == [0, 30, 30]
    assert figures["species"]["beech"] == len(trees)
    assert figures["models"] == {"beech_smooth": len(trees)}
    assert figures["keypoints"]["felling_cut"] == {"outside": 0, "hidden": 0, "visible": len(trees)}
    assert figures["keypoints"]["axis_top"]["outside"] == len(trees)
    assert figures["keypoints"]["axis_middle"]["hidden"] == len(trees)
    assert sum(figures["terrain"].values()) == len(images)
    table = figures["weather_by_light"]
    assert sum(count for row in table.values() for count in row.values()) == len(images)
    one = images[0]["scene"]
    expected = sum(
        i["scene"]["weather"] == one["weather"] and i["scene"]["light"] == one["light"]
        for i in images
    )
    assert table[one["weather"]][one["light"]] == expected


@pytest.mark.parametrize("name", ["diameter_m", "diameter_breast_m", "visible_fraction"])
def test_histograms_hold_every_tree_in_its_bin(dataset: Path, figures: dict, name: str):
    _, trees = coco(dataset)
    one = figures["tree"][name]
    assert sum(one["counts"]) == len(trees)
    low, high = one["edges"][4:6]
    assert one["counts"][4] == sum(low <= tree[name] < high for tree in trees)
    assert one["p5"] <= one["median"] <= one["p95"]


def test_bytes_and_readings_are_those_of_the_files(dataset: Path, figures: dict):
    folders = ("images", "depth", "depth8", "depth_exact")
    sizes = {f: sum(p.stat().st_size for p in (dataset / f).iterdir()) / FRAMES for f in folders}
    assert figures["bytes_per_frame"]["folders"] == pytest.approx(sizes, abs=0.5)
    assert figures["bytes_per_frame"]["mean"] == pytest.approx(sum(sizes.values()), abs=1)
    depth = cv2.imread(str(dataset / "depth/000000.png"), cv2.IMREAD_UNCHANGED)
    assert figures["depth_valid_share"]["tof"] == pytest.approx((depth > 0).mean(), abs=0.01)
    assert figures["depth_sensor"] == {"stereo": 0, "tof": FRAMES}


class Balance(HTMLParser):
    """Lists tags and references, and raises for a closing tag without an opening one."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.seen: set[str] = set()
        self.references: set[str] = set()

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.seen.add(tag)
        self.references |= {v for k, v in attributes if k in ("href", "src") and v}
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        if tag not in VOID:
            assert self.open.pop() == tag


def test_the_page_is_whole_and_needs_nothing_else(dataset: Path, figures: dict):
    page = (dataset / "statistics.html").read_text()
    reader = Balance()
    reader.feed(page)
    assert reader.open == []
    assert not reader.seen & {"script", "link", "iframe", "img"}
    assert reader.references == {"contact_sheet.jpg", "contact_sheet_depth.jpg"}
    assert all((dataset / name).is_file() for name in reader.references)
    assert f"{figures['trees_per_frame']['mean']:.2f}" in page
    assert "the paper has 3.8" in page
    assert "prefers-color-scheme: dark" in page
    assert "nan" not in re.sub(r"<style>.*?</style>", "", page, flags=re.DOTALL).lower()


def test_shares_say_what_they_are_shares_of(figures: dict):
    from perceptree.simulator.dataset.pages import statistics_page

    rare = figures | {"realism": {"caption": 6, "night": 3}}
    page = statistics_page(rare)
    assert "6 · 10 %" in page
    assert "3 · 5 %" in page
    assert page.count("hares of all frames") >= 4


@pytest.fixture(scope="module")
def record(dataset: Path) -> Callable[..., dict]:
    """A frame's record as the simulator writes it, of another frame, scene and weather."""
    first = json.loads((dataset / "scenes/000000.json").read_text())[0]

    def make(number: int, scene: int, weather: str = "clear", light: str = "daylight") -> dict:
        conditions = {"seed": scene, "terrain": "moss", "weather": weather, "light": light}
        known = first["image"]
        return first | {"image": known | {"id": number, "scene": known["scene"] | conditions}}

    return make


def test_frames_come_from_as_many_scenes_as_there_are_and_are_never_shown_twice(
    record: Callable[..., dict],
):
    many = [record(5 * scene + view, scene) for scene in range(100) for view in range(5)]
    chosen = choose_frames(many)
    assert len({r["image"]["scene"]["seed"] for r in chosen}) == len(chosen) == 48
    assert max(r["image"]["scene"]["seed"] for r in chosen) > 90
    few = [record(20 * scene + view, scene) for scene in range(3) for view in range(20)]
    shown = [r["image"]["id"] for r in choose_frames(few)]
    assert len(set(shown)) == len(shown) == 48
    assert {number // 20 for number in shown} == {0, 1, 2}


def test_a_rare_weather_is_on_the_sheet(record: Callable[..., dict]):
    plenty = [record(scene, scene) for scene in range(1000)]
    plenty[777] = record(777, 777, "snowfall", "dusk")
    assert [r["image"]["id"] for r in choose_frames(plenty)][-1] == 777


def test_the_sheets_show_the_labels_and_the_depth(dataset: Path):
    colour = cv2.imread(str(dataset / "contact_sheet.jpg"))
    depth = cv2.imread(str(dataset / "contact_sheet_depth.jpg"))
    assert colour.shape == depth.shape
    assert colour.shape[1] > 6 * 400
    assert colour.shape[0] > 8 * 225
    blue, _, red = (depth[..., channel].astype(int) for channel in range(3))
    assert (blue - red > 80).mean() > 0.05  # far
    assert (red - blue > 80).mean() > 0.05  # near


def test_an_unreadable_picture_is_named(dataset: Path, tmp_path: Path):
    records = json.loads((dataset / "scenes/000000.json").read_text())
    with pytest.raises(DatasetError, match=r"images/000000.jpg: missing or not a readable image"):
        write_contact_sheets(tmp_path, {"train": records})


def test_trees_beyond_the_usual_reach_get_bars_of_their_own(dataset: Path):
    records = json.loads((dataset / "scenes/000000.json").read_text())
    records[0]["annotations"][0]["distance_m"] = 14.2
    distance = dataset_statistics({"train": records})["tree"]["distance_m"]
    assert distance["edges"][-1] == 15
    assert distance["counts"][-1] == 1


def test_a_dataset_without_a_tree_has_a_page_too(dataset: Path, tmp_path: Path):
    from perceptree.simulator.dataset.pages import write_statistics

    records = json.loads((dataset / "scenes/000000.json").read_text())
    for one in records:
        one["annotations"] = []
    write_statistics(tmp_path, {"train": records})
    page = (tmp_path / "statistics.html").read_text()
    assert "no tree" in page
