"""The report is a valid, self-contained page with all results."""

import base64
import dataclasses
import json
import re
from collections.abc import Callable
from html.parser import HTMLParser

import cv2
import numpy as np
import pytest

from basetree.page.parts import jpeg_of
from edgetree.bench.speed import BenchResult
from edgetree.catalogue import default_model
from edgetree.demo.comparison import compare_trees
from edgetree.demo.matching import Match
from edgetree.demo.plot import error_histogram
from edgetree.demo.report import NextCommand, render_report
from edgetree.demo.result import DemoResult, ModelResult, Step
from edgetree.measure import Estimate, Failure, TreeMeasurement
from edgetree.model_file.manifest import METADATA_KEY, Manifest
from edgetree.model_file.safety_check import read_model_file
from edgetree.samples import SampleTree

VOID = {"meta", "img", "input", "line", "path", "circle"}


class Outline(HTMLParser):
    """Collects tags and sources, and fails on wrongly nested tags."""

    def __init__(self) -> None:
        super().__init__()
        self.open_tags: list[str] = []
        self.addresses: list[str] = []
        self.tags: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.addresses += [
            value or "" for name, value in attrs if name in ("src", "href", "action")
        ]
        if tag not in VOID:
            self.open_tags.append(tag)

    def handle_endtag(self, tag: str) -> None:
        if tag not in VOID:
            assert self.open_tags.pop() == tag


def truth(diameter_m: float, cut_height_m: float, distance_m: float) -> SampleTree:
    box_px, keypoints_px = np.zeros(4, np.float32), np.zeros((5, 3), np.float32)
    return SampleTree(
        box_px, keypoints_px, diameter_m, cut_height_m, distance_m, 0.0, 1.0, species="fir"
    )


def model(modality: str, diameter: Estimate | Failure) -> ModelResult:
    measurement = dataclasses.replace(
        TreeMeasurement.failed("no ground <near> the stem"),
        diameter_m=diameter,
        distance_m=Estimate(6.25, 0.125),
    )
    truths = [truth(0.314, 0.2, 6.5), truth(0.2, 0.1, 8.0)]
    picture = jpeg_of(np.zeros((8, 16, 3), np.uint8))
    frame = compare_trees("Frame 1", truths, [Match(0, 0, 0.9)], [0.9], [measurement], picture)
    shipped = read_model_file(default_model(modality)).metadata[METADATA_KEY]
    speed = BenchResult(99, 2, 20.0, 25.0, 48.0, 1.0, None)
    return ModelResult(Manifest.from_json(shipped), 7_300_000, speed, (frame,))


@pytest.fixture
def result() -> DemoResult:
    models = (
        model("depth", Estimate(0.329, 0.0171)),
        model("rgb", Failure("no depth at the stem")),
    )
    return DemoResult(models, duration_s=21.4)


def words(html: str) -> str:
    """The visible text."""
    text = re.sub(r"<style>.*?</style>", "", html, flags=re.DOTALL)
    return re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", text))


def test_the_page_is_valid_and_self_contained(result: DemoResult) -> None:
    html = render_report(result, [])
    outline = Outline()
    outline.feed(html)
    outline.close()
    assert outline.open_tags == []
    assert len(outline.addresses) == 2
    for address in outline.addresses:
        head, data = address.split(",")
        assert head == "data:image/jpeg;base64"
        picture_bytes = np.frombuffer(base64.b64decode(data), np.uint8)
        assert cv2.imdecode(picture_bytes, cv2.IMREAD_COLOR).shape == (8, 16, 3)
    assert {"script", "link", "iframe"} & set(outline.tags) == set()
    assert "@import" not in html
    assert "url(" not in html


def test_the_page_is_laid_out_as_it_was(
    result: DemoResult, check_golden_layout: Callable[[str, str], None]
) -> None:
    steps = (Step("Train", "12 rounds", 301.0),)
    chain = dataclasses.replace(result, steps=steps)
    check_golden_layout("demo_report.txt", render_report(chain, [NextCommand("see", "edgetree")]))


def test_the_page_shows_truth_measurement_and_reason(result: DemoResult) -> None:
    text = words(render_report(result, []))
    assert "31.4 32.9 ± 1.7 no depth at the stem" in text
    assert "6.50 6.25 ± 0.12" in text
    assert "not found" in text
    assert "1 of 2 labelled trees found by the depth model" in text
    assert "1.5 cm median error of the stem diameter" in text
    assert "50 frames per second" in text
    assert "50.0 / 40.0" in text


def test_the_cards_count_detections_of_no_tree(result: DemoResult) -> None:
    frame = dataclasses.replace(result.models[0].frames[0], unmatched_detections=3)
    invented = dataclasses.replace(result.models[0], frames=(frame,))
    text = words(render_report(dataclasses.replace(result, models=(invented,)), []))
    assert "3 false detections: of the depth model, where no tree is labelled" in text


@pytest.mark.parametrize(
    ("diameter", "gross"),
    [
        (Estimate(0.37, 0.0171), True),  # 5.6 cm, 3.3 standard deviations
        (Estimate(0.36, 0.0171), False),  # 4.6 cm, 2.7 standard deviations, 15 %
        (Estimate(0.38, 0.05), True),  # 6.6 cm, 21 % of the diameter
        (Failure("no depth"), False),
    ],
)
def test_gross_errors_are_marked_in_plot_and_tables(
    diameter: Estimate | Failure, gross: bool
) -> None:
    html = render_report(DemoResult((model("depth", diameter),), 1.0), [])
    assert ('<td class="gross">' in html) is gross
    assert ("gross errors: 1" in html) is gross
    assert f"diameter: gross errors {int(gross)}" in words(html)
    assert "distance: gross errors 0" in words(html)


def test_errors_are_counted_in_bins_around_zero() -> None:
    estimates = [Estimate(0.314 + error_m, 0.1) for error_m in (0.005, 0.006, -0.005, 0.3)]
    frames = tuple(model("depth", estimate).frames[0] for estimate in estimates)
    depth = dataclasses.replace(model("depth", estimates[0]), frames=frames)
    svg = error_histogram([depth], "diameter_m")
    edges = re.findall(r'text-anchor="middle">([^<]*)<', svg)
    assert "0" in edges
    assert edges[0].startswith("-")
    assert sum(map(int, re.findall(r"trees: (\d+)", svg))) == 4
    assert re.findall(r"gross errors: (\d+)", svg) == ["1"]
    assert error_histogram([model("depth", Failure("no depth"))], "diameter_m") == ""


def test_a_tiny_std_is_not_shown_as_zero() -> None:
    tiny = DemoResult((model("depth", Estimate(0.3141, 0.0001)),), 1.0)
    assert "31.4 ± &lt;0.1" in words(render_report(tiny, []))


def test_text_is_escaped(result: DemoResult) -> None:
    html = render_report(result, [NextCommand("a < b", "edgetree run <FRAME>")])
    assert "no ground &lt;near&gt; the stem" in html
    assert "edgetree run &lt;FRAME&gt;" in html


def test_a_model_that_measures_nothing_still_gets_a_page() -> None:
    nothing = DemoResult((model("rgb", Failure("no depth")),), 1.0)
    text = words(render_report(nothing, []))
    assert "– median error of the stem diameter" in text


def test_the_training_steps_are_shown_only_after_training(result: DemoResult) -> None:
    steps = (Step("Train", "12 rounds", 301.0),)
    trained = DemoResult(result.models, 5.0, None, steps, {"ap50_boxes": 0.61})
    assert "Train 12 rounds 301 s" in words(render_report(trained, []))
    assert "From nothing to this model" not in render_report(result, [])
    assert trained.to_dict("r.html")["training"] == {"ap50_boxes": 0.61}
    assert "training" not in result.to_dict("r.html")


def test_the_json_gives_every_tree_and_the_speed(result: DemoResult) -> None:
    data = json.loads(json.dumps(result.to_dict("out/report.html"), allow_nan=False))
    assert data["report"] == "out/report.html"
    depth = data["models"]["depth"]
    assert depth["fps_p50"] == pytest.approx(50.0)
    assert depth["fps_p90"] == pytest.approx(40.0)
    assert depth["found_trees"] == 1
    assert [row["true_diameter_m"] for row in depth["trees"]] == [0.314, 0.2]
    assert depth["trees"][0]["diameter_m"] == 0.329
    assert depth["errors"]["diameter_m"]["median_abs_error_m"] == pytest.approx(0.015)
    assert data["models"]["rgb"]["trees"][0]["diameter_failure"] == "no depth at the stem"
