"""The evaluation report: JSON and a self-contained page."""

import json
import re
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from schema_check import check_schema

from perceptree.data import FrameStore
from perceptree.evaluation import About, RawDetections, Report, make_report, summary_lines

Edit = Callable[[Path, str, Callable[[dict[str, Any]], None]], None]

MODEL = {"name": "oracle", "modality": "rgb", "precision": "float32", "input_px": [160, 96]}


def report_of(predict: Any, store: FrameStore, **model: Any) -> Report:
    return make_report(predict, store, About({**MODEL, **model}, "posts", "train", ("read so",)), 4)


def flawed(raw: RawDetections) -> RawDetections:
    """Of two trees one is missed; next to the other is a false positive, its left edge is off."""
    assert raw.keypoints is not None
    raw.keypoints[:, :, 1, 0] -= 5.0
    raw.boxes[:, 1] = [150, 5, 158, 20]
    raw.num_detections[:] = 2
    raw.scores[:, :2] = 0.9, 0.6
    return raw


class Page(HTMLParser):
    """Collects the text of a page and the addresses it would load."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.sources: list[str] = []
        self.words = ""
        self.feed(html)

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.sources += [value or "" for name, value in attributes if name in ("src", "href")]

    def handle_data(self, data: str) -> None:
        self.words += data


def test_the_results_match_the_known_errors(posts: Path, store_of: Any, oracle: Any) -> None:
    store = store_of(posts)  # six frames with nine trees, four labelled keypoints each
    figures = report_of(oracle(store, flawed), store).figures
    shown = figures["at_score"]
    assert (shown["found"], shown["missed"], shown["invented"]) == (6, 3, 6)
    assert (shown["recall"], shown["precision"]) == (pytest.approx(2 / 3, abs=1e-4), 0.5)
    width = figures["diameter_error_px"]
    assert width["mean"] == width["mean_abs"] == pytest.approx(4.0, abs=1e-3)  # 5 px of the model
    assert width["count"] == 6
    left = figures["keypoint_error_px"]["diameter_left"]
    assert left["horizontal"]["mean"] == pytest.approx(-4.0, abs=1e-3)
    assert left["vertical"]["p90_abs"] == pytest.approx(0.0, abs=1e-3)
    assert figures["keypoint_error_px"]["axis_top"]["distance"] is None
    (group,) = figures["by"]["distance_m"]["groups"]
    assert (group["name"], group["trees"]) == ("5 to 7.5 m", 9)
    assert group["recall"] == shown["recall"]
    assert group["boxes_ap"] == pytest.approx(figures["average_precision"]["boxes"]["ap"])
    assert [g["name"] for g in figures["by"]["species"]["groups"]] == ["post"]
    assert figures["left_out"] == [
        "results by weather, light, slope of the ground: the data has no such field"
    ]


def test_weather_has_its_own_precision(
    posts: Path, edit_split: Edit, store_of: Any, oracle: Any
) -> None:
    def rain(content: dict[str, Any]) -> None:
        for image in content["images"]:
            wet = image["id"] % 2 == 0
            image["scene"] = {"weather": "rain" if wet else "clear", "slope_deg": 12.0}

    edit_split(posts, "train", rain)
    store = store_of(posts)  # even frames have one tree, odd ones two
    by = report_of(oracle(store, flawed), store).figures["by"]
    clear, wet = by["weather"]["groups"]
    assert (clear["name"], clear["frames"], clear["trees"]) == ("clear", 3, 6)
    assert (clear["recall"], clear["precision"]) == (0.5, 0.5)
    assert (wet["recall"], wet["precision"]) == (1.0, 0.5)
    (slope,) = by["slope_deg"]["groups"]
    assert (slope["name"], slope["trees"]) == ("10 to 20°", 9)


def test_a_folder_has_the_figures_and_a_page_that_needs_nothing_else(
    posts: Path,
    store_of: Any,
    oracle: Any,
    tmp_path: Path,
    check_golden_layout: Callable[[str, str], None],
) -> None:
    store = store_of(posts)
    report = report_of(oracle(store, flawed), store)
    page = report.write(tmp_path)
    assert json.loads((tmp_path / "report.json").read_text()) == report.figures
    assert check_schema(report.figures) == "perceptree.evaluation/1"
    assert sorted(path.name for path in tmp_path.glob("*.*") if path.is_file()) == [
        "report.html",
        "report.json",
    ]
    html = page.read_text("utf-8")
    found = Page(html)
    assert all(source.startswith(("data:", "#")) for source in found.sources)
    assert not re.search(r"url\((?!#)|@import|<script", html)
    assert found.tags.count("svg") == 3 + 5 + 4 + 2  # no tree has a labelled axis top
    pictures = [source for source in found.sources if source.startswith("data:image/jpeg")]
    assert len(pictures) == 6 + 3 + 6  # best, missed, invented
    words = " ".join(found.words.split())
    assert "The detector finds 67 of 100 of them." in words
    assert "mean absolute error of 4.0 pixels" in words
    assert "000000.png: score 0.90" in words
    assert "read so" in words
    check_golden_layout("evaluation_report.txt", html)


def test_settings_on_the_page_are_rows_of_words(
    posts: Path, store_of: Any, oracle: Any, tmp_path: Path
) -> None:
    training = {"settings": {"batch": 8, "scale": [0.5, 2.0]}, "cameras": [{"name": "a"}]}
    store = store_of(posts)
    report = report_of(oracle(store), store, training=training)
    html = report.write(tmp_path).read_text()
    assert "training, settings, batch</td><td>8<" in html
    assert "training, settings, scale</td><td>0.5, 2.0<" in html
    assert not re.search(r"\{&#x27;|\{'", html.partition("</style>")[2])


def test_the_page_of_a_depth_model_shows_colour_and_depth(
    posts: Path, store_of: Any, oracle: Any, tmp_path: Path
) -> None:
    store = store_of(posts, "test", "depth")
    html = report_of(oracle(store), store, modality="depth").write(tmp_path).read_text("utf-8")
    widths = {int(width) for width in re.findall(r'<img [^>]*width="(\d+)"', html)}
    assert widths == {2 * 330}


def test_a_report_of_boxes_lists_what_is_left_out(
    posts: Path, edit_split: Edit, store_of: Any, oracle: Any, tmp_path: Path
) -> None:
    def bare(content: dict[str, Any]) -> None:
        kept = ("id", "image_id", "category_id", "bbox", "iscrowd")
        content["annotations"] = [
            {name: annotation[name] for name in kept} for annotation in content["annotations"]
        ]

    edit_split(posts, "train", bare)
    store = store_of(posts)
    report = report_of(oracle(store, flawed), store)
    precision = report.figures["average_precision"]
    assert (precision["masks"], precision["keypoints"]) == (None, None)
    assert report.figures["diameter_error_px"] is None
    assert report.figures["by"] == {}
    left_out = "; ".join(report.figures["left_out"])
    assert "masks: no tree in the data is labelled with them" in left_out
    assert "keypoints: no tree in the data is labelled with them" in left_out
    assert "of 100 of them" in report.write(tmp_path).read_text("utf-8")


def test_missing_branches_are_reported_as_the_models(
    posts: Path, store_of: Any, oracle: Any
) -> None:
    store = store_of(posts)
    boxes_only = oracle(store, lambda raw: raw._replace(keypoints=None, masks=None))
    left_out = report_of(boxes_only, store).figures["left_out"]
    assert left_out[:2] == [
        f"{kind}: the model does not predict them" for kind in ("masks", "keypoints")
    ]


def test_a_report_without_detections(
    posts: Path, store_of: Any, oracle: Any, tmp_path: Path
) -> None:
    store = store_of(posts)
    empty = oracle(store, lambda raw: raw._replace(num_detections=0 * raw.num_detections))
    report = report_of(empty, store)
    assert report.figures["at_score"]["precision"] is None
    assert report.figures["average_precision"]["boxes"]["ap"] == 0
    assert "The detector finds 0" in report.write(tmp_path).read_text("utf-8")
    text = "\n".join(summary_lines(report.figures))
    assert "0 of 9 trees found (0%)" in text
    assert "left out: errors in px: no tree with keypoints was found" in text


def test_the_summary_fits_a_terminal(posts: Path, store_of: Any, oracle: Any) -> None:
    store = store_of(posts)
    lines = list(summary_lines(report_of(oracle(store, flawed), store).figures))
    assert lines[0] == "oracle (rgb, float32, 160x96) on posts, train"
    assert max(map(len, lines)) <= 100
    assert any(line.startswith("boxes ") for line in lines)
    found = "at score 0.5: 6 of 9 trees found (67%), 6 of 12 detections are false positives"
    assert found in lines
    assert any("4.0 px error (mean)" in line and "4.0 too wide" in line for line in lines)
    [unseen] = [line for line in lines if line.startswith("axis top")]
    assert unseen.endswith("not labelled on any tree that was found")


def test_results_have_no_nan(posts: Path, store_of: Any, oracle: Any) -> None:
    store = store_of(posts)

    def wild(raw: RawDetections) -> RawDetections:
        raw.boxes[:, 0, 2] = raw.boxes[:, 0, 0]  # no width
        return raw

    json.dumps(report_of(oracle(store, wild), store).figures, allow_nan=False)
    assert np.isfinite(report_of(oracle(store), store).figures["diameter_error_px"]["sigma"])
