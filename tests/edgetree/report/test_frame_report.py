"""The report of `edgetree run` and `measure` holds every tree, stays small, and appears whole."""

from __future__ import annotations

import base64
import gc
import json
import re
import signal
import subprocess
import sys
import tracemalloc
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from basetree.errors import InputError
from edgetree.detections import TreeDetections
from edgetree.frames.frame import Frame
from edgetree.frames.pipeline import FoundTrees, FrameResult
from edgetree.measure import Estimate, Evidence, Failure, StemProfile, TreeMeasurement
from edgetree.report import ReportHead, report_file
from edgetree.report.units import UNITS
from edgetree.results.units import AMOUNTS

Cli = Callable[..., Any]
VOID = {"meta", "img", "input"}
MEASURED = replace(
    TreeMeasurement.failed("no ground <near> the stem"),
    diameter_m=Estimate(0.3124, 0.0081),
    distance_m=Estimate(5.26, 0.05),
    evidence=Evidence(warnings=("a high stump",)),
)


@dataclass
class Cell:
    """A cell of a table: its attributes and its text."""

    attributes: dict[str, str | None]
    text: str = ""


@dataclass
class Page(HTMLParser):
    """A page's tables, addresses and texts; fails on wrongly nested tags."""

    html: str
    open_tags: list[str] = field(default_factory=list)
    tags: list[tuple[str, dict[str, str | None]]] = field(default_factory=list)
    rows: list[list[Cell]] = field(default_factory=list)
    texts: list[str] = field(default_factory=list)
    code: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        super().__init__()
        self.feed(self.html)
        self.close()
        assert self.open_tags == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open_tags.append(tag)
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append(Cell(dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        if tag not in VOID:
            assert self.open_tags.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open_tags and self.open_tags[-1] in ("script", "style"):
            self.code.append(data)
            return
        self.texts.append(data)
        if {"td", "th"} & set(self.open_tags):
            self.rows[-1][-1].text += data

    def attributes(self, tag: str, name: str) -> list[str]:
        """The values of an attribute of all elements with a tag."""
        return [found[name] or "" for each, found in self.tags if each == tag and name in found]

    @property
    def text(self) -> str:
        """The visible text."""
        return " ".join(" ".join(self.texts).split())

    @property
    def trees(self) -> list[dict[str, Cell]]:
        """The rows of the table of all trees, by column."""
        start = next(i for i, row in enumerate(self.rows) if row[0].text == "frame")
        names = [cell.text for cell in self.rows[start]]
        return [dict(zip(names, row, strict=True)) for row in self.rows[start + 1 :]]


def read(path: Path) -> Page:
    return Page(path.read_text("utf-8"))


def result(
    name: str = "a", *trees: TreeMeasurement, picture: NDArray[np.uint8] | None = None
) -> FrameResult:
    """A frame with the given trees."""
    image = np.full((90, 160, 3), 60, np.uint8) if picture is None else picture
    height, width = image.shape[:2]
    detections = TreeDetections(
        boxes_px=np.tile(np.array([[10, 10, 30, 80]], np.float32), (len(trees), 1)),
        scores=np.full(len(trees), 0.9, np.float32),
        keypoints_px=None,
        masks=None,
        image_width=width,
        image_height=height,
    )
    frame = Frame(name, Path(f"{name}.jpg"), image)
    return FrameResult(frame, FoundTrees.detected(detections, 1.0), list(trees), None)


def written(path: Path, *results: FrameResult, source: str = "images") -> Page:
    with report_file(path, source, "the model m.onnx") as add:
        for each in results:
            add(each)
    return read(path)


@pytest.fixture
def folder(images: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Change to the folder with `images`, `depth` and `camera.json`."""
    monkeypatch.chdir(images.parent)
    return images.parent


FRAMES = ("run", "images", "--depth", "depth", "--camera", "camera.json")
IMAGE = ("measure", "images/a.jpg", "--depth", "depth/a.png", "--camera", "camera.json")
COLUMNS = {
    "diameter": "diameter",
    "DBH": "dbh",
    "cut height": "cut_height",
    "distance": "distance",
}


def check_trees(page: Page, frames: list[dict[str, Any]]) -> None:
    """Each tree of the JSON output has a row with its values, or the reasons."""
    expected = [(frame["frame"], tree) for frame in frames for tree in frame["trees"]]
    assert len(page.trees) == len(expected) > 0
    for row, (frame, tree) in zip(page.trees, expected, strict=True):
        assert (row["frame"].text, row["tree"].text) == (frame, str(tree["tree"]))
        for column, key in COLUMNS.items():
            failure = tree["metres"].get(f"{key}_failure")
            if failure is not None:
                assert row[column].text == "–"
                assert failure in row["remarks"].text
                continue
            attributes = row[column].attributes
            assert float(attributes["data-value"] or "") == tree["metres"][f"{key}_m"]
            assert float(attributes["data-std"] or "") == tree["metres"][f"{key}_std_m"]


def test_every_tree_of_a_run_is_in_the_report(run_cli: Cli, model: Path, folder: Path) -> None:
    done = run_cli(*FRAMES, "--model", model, "--json", "--report", "r.html")
    assert done.code == 0, done.err
    assert "report: r.html" in done.err
    page = read(folder / "r.html")
    frames = json.loads(done.out)["frames"]
    check_trees(page, frames)
    assert any("diameter_m" in frames[0]["trees"][0]["metres"] for _ in frames)
    assert len(page.attributes("img", "src")) == 2
    assert "2 frames" in page.text


def test_every_tree_of_a_measurement_is_in_the_report(
    run_cli: Cli, model: Path, folder: Path
) -> None:
    done = run_cli(*IMAGE, "--model", model, "--json", "--report", "r.html")
    assert done.code == 0, done.err
    page = read(folder / "r.html")
    check_trees(page, [json.loads(done.out)["frame"]])
    assert "Found by the model model.onnx." in page.text
    assert "1 frame " in page.text


def test_the_output_of_the_command_is_the_same_with_a_report(
    run_cli: Cli, model: Path, folder: Path
) -> None:
    plain = run_cli(*IMAGE, "--model", model)
    assert run_cli(*IMAGE, "--model", model, "--report", "r.html").out == plain.out


def test_without_depth_the_report_says_what_is_missing(
    run_cli: Cli, model: Path, folder: Path
) -> None:
    done = run_cli("run", "images", "--model", model, "--report", "r.html")
    assert done.code == 0, done.err
    page = read(folder / "r.html")
    reason = (
        "metres need depth: pass --depth and --camera; or without depth --camera-height or --marker"
    )
    assert ["2", "all values", reason] in [[cell.text for cell in row] for row in page.rows]
    assert all(reason in row["remarks"].text for row in page.trees)


@pytest.mark.parametrize("command", [FRAMES, IMAGE])
@pytest.mark.parametrize(
    ("report", "message"),
    [
        ("r.pdf", "--report is r.pdf: expected a file name ending in .html"),
        ("no/r.html", "no/r.html cannot be written"),
    ],
)
def test_a_wrong_file_name_is_one_line(
    run_cli: Cli, model: Path, folder: Path, command: tuple[str, ...], report: str, message: str
) -> None:
    done = run_cli(*command, "--model", model, "--report", report)
    assert done.code == 2
    assert message in done.err
    assert "Traceback" not in done.err


def test_a_run_that_fails_leaves_the_old_report(run_cli: Cli, model: Path, folder: Path) -> None:
    (folder / "r.html").write_text("old")
    (folder / "images" / "b.jpg").write_bytes((folder / "images" / "b.jpg").read_bytes()[:400])
    before = sorted(folder.iterdir())
    done = run_cli("run", "images", "--model", model, "--report", "r.html", "--strict-frames")
    assert done.code == 2
    assert (folder / "r.html").read_text() == "old"
    assert sorted(folder.iterdir()) == before


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_a_run_that_is_killed_leaves_nothing_for_long(tmp_path: Path) -> None:
    code = (
        "import os, signal, sys\n"
        "from pathlib import Path\n"
        "from edgetree.report import ReportHead, report_file\n"
        "with report_file(Path(sys.argv[1]), 's', 'm') as add:\n"
        "    os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    done = subprocess.run([sys.executable, "-c", code, str(tmp_path / "r.html")])
    assert done.returncode == -signal.SIGKILL
    assert [path.name[:7] for path in tmp_path.iterdir()] == [".calib-"]
    written(tmp_path / "r.html", result("a", MEASURED))
    assert [path.name for path in tmp_path.iterdir()] == ["r.html"]


def test_an_error_in_the_block_leaves_nothing(tmp_path: Path) -> None:
    empty = replace(result("a"), frame=Frame("a", Path("a"), None))
    with pytest.raises(InputError, match="nothing to draw on"):
        written(tmp_path / "r.html", result("a", MEASURED), empty)
    assert list(tmp_path.iterdir()) == []


def test_text_is_escaped(tmp_path: Path) -> None:
    name = "<i>&\"'x"
    page = written(tmp_path / "r.html", result(name, MEASURED), source=name)
    assert "i" not in {tag for tag, _ in page.tags}
    assert f"Trees in {name}" in page.text
    assert page.trees[0]["frame"].text == name
    assert page.attributes("img", "alt") == [f"{name}: 1 tree, 1 with a diameter"]
    assert "no ground <near> the stem" in page.trees[0]["remarks"].text


def test_the_page_needs_no_other_file(tmp_path: Path) -> None:
    page = written(tmp_path / "r.html", result("a", MEASURED), result("b", MEASURED))
    assert {"link", "iframe"} & {tag for tag, _ in page.tags} == set()
    assert page.attributes("script", "src") == []
    assert all(each.startswith("data:image/jpeg;base64,") for each in page.attributes("img", "src"))
    assert "http" not in page.html.replace("data:image", "")
    anchors = page.attributes("figure", "id")
    assert [each.removeprefix("#") for each in page.attributes("a", "href")] == anchors
    heads = page.html.partition('<table class="sortable')[2].partition("</thead>")[0]
    assert heads.count("<th ") == heads.count('<button type="button">') == 9


def test_values_reasons_and_warnings_are_in_the_row(tmp_path: Path) -> None:
    page = written(tmp_path / "r.html", result("a", MEASURED))
    (row,) = page.trees
    assert row["diameter"].text == "31.2 ± 0.8 cm"
    assert row["distance"].text == "5.26 ± 0.05 m"
    assert row["DBH"].text == row["cut height"].text == row["lean"].text == "–"
    assert "none" in (row["DBH"].attributes["class"] or "")
    assert (
        "no DBH, cut height, lean, axis distance, taper, seen volume: no ground <near> the stem"
        in row["remarks"].text
    )
    assert "warning: a high stump" in row["remarks"].text


def test_the_lean_has_its_standard_deviation_in_degrees(tmp_path: Path) -> None:
    tree = replace(MEASURED, inclination_deg=Estimate(6.25, 3.125))
    (row,) = written(tmp_path / "r.html", result("a", tree)).trees
    attributes = row["lean"].attributes
    assert (attributes["data-value"], attributes["data-std"]) == ("6.25", "3.125")


def test_a_tree_without_a_number_is_sorted_to_the_end(tmp_path: Path) -> None:
    found = result("a", MEASURED, MEASURED)
    tracks = replace(found, found=replace(found.found, tracks=(None, 12)))
    new, followed = written(tmp_path / "r.html", tracks).trees
    assert (new["tree"].text, followed["tree"].text) == ("new", "#12")
    assert followed["tree"].attributes["data-value"] == "12"
    # The script sorts by numbers, and leaves cells of this class at the end.
    assert "data-value" not in new["tree"].attributes
    assert new["tree"].attributes["class"] == "none"


def test_the_profile_is_folded_in_the_remarks(tmp_path: Path) -> None:
    profile = StemProfile(
        heights_from="ground",
        height_m=np.array([0.4, 0.5, 0.6]),
        diameter_m=np.array([0.33, 0.32, 0.31]),
        diameter_std_m=np.full(3, 0.01),
        edges_m=np.zeros((3, 2, 3)),
    )
    tree = replace(
        MEASURED,
        profile=profile,
        taper_cm_per_m=Estimate(1.0, 0.4),
        seen_volume_m3=Estimate(0.016, 0.001),
        volume_m3=Estimate(0.5, 0.1),
        species="birch",
    )
    page = written(tmp_path / "r.html", result("a", tree))
    (row,) = page.trees
    remarks = row["remarks"].text
    assert "profile of 3 diameters" in remarks
    assert "taper 1.0 ± 0.4 cm/m" in remarks
    assert "volume of the seen part 0.016 ± 0.001 m³" in remarks
    assert "stem volume 0.500 ± 0.100 m³ (birch, Laasasenaho 1982)" in remarks
    assert {"details", "svg"} <= {tag for tag, _ in page.tags}
    assert 'data-quantity="seen_volume_m3" data-value="0.016" data-std="0.001"' in page.html


def test_the_summary_counts_trees_and_reasons(tmp_path: Path) -> None:
    thick = replace(MEASURED, diameter_m=Estimate(0.5, 0.01), dbh_m=Estimate(0.45, 0.01))
    lost = TreeMeasurement.failed("no depth on the stem")
    results = (result("a", MEASURED, thick, lost), result("b"), result("c", lost))
    page = written(tmp_path / "r.html", *results)
    for words in ("3 frames", "4 trees found", "2 of 4 trees with", "40.6 cm median diameter"):
        assert words in page.text
    missing = [[cell.text for cell in row] for row in page.rows]
    assert ["2", "all values", "no depth on the stem"] in missing
    assert "b 0 trees, 0 with a diameter" in page.text


def test_a_reason_is_said_once_with_all_that_it_leaves_out(tmp_path: Path) -> None:
    short = replace(MEASURED, dbh_m=Failure("plants"), cut_height_m=Estimate(0.2, 0.01))
    more = replace(MEASURED, dbh_m=Failure("plants"), cut_height_m=Failure("plants"))
    page = written(tmp_path / "r.html", result("a", short, more))
    rows = [[cell.text for cell in row] for row in page.rows]
    assert [row for row in rows if row[-1] == "plants"] == [["2", "DBH, cut height", "plants"]]


def test_a_tree_counts_once_for_reasons_that_differ_in_numbers_only(tmp_path: Path) -> None:
    tree = replace(MEASURED, dbh_m=Failure("bad by 2 cm"), cut_height_m=Failure("bad by 4 cm"))
    page = written(tmp_path / "r.html", result("a", tree))
    rows = [[cell.text for cell in row] for row in page.rows]
    assert ["1", "DBH, cut height", "bad by 2 to 4 cm"] in rows


def test_reasons_that_differ_in_numbers_only_are_one_with_their_range(tmp_path: Path) -> None:
    found = [
        replace(MEASURED, dbh_m=Failure(f"the stem ends at {top} m: expected 1.3 m"))
        for top in ("0.9", "1.15", "0.95")
    ]
    page = written(tmp_path / "r.html", result("a", *found))
    rows = [[cell.text for cell in row] for row in page.rows]
    assert ["3", "DBH", "the stem ends at 0.9 to 1.15 m: expected 1.3 m"] in rows


def test_totals_have_intervals_in_which_the_rig_does_not_average_away(tmp_path: Path) -> None:
    trees = [
        replace(
            MEASURED,
            diameter_m=Failure("no cut"),
            dbh_m=Estimate(value, 0.005),
            rig_std={"dbh_m": 0.003},
            volume_m3=Estimate(0.5, 0.1),
        )
        for value in (0.2, 0.2, 0.4, 0.4)
    ]
    head = ReportHead("Stand 7", "Evo <east>", 0.01)
    with report_file(tmp_path / "r.html", "images", "the model m", head=head) as add:
        add(result("a", *trees, replace(MEASURED, diameter_m=Failure("no cut"))))
    page = read(tmp_path / "r.html")
    rows = {row[0].text: [cell.text for cell in row[1:]] for row in page.rows}
    # 0.4 cm of 0.5 is of each tree alone: 0.2 cm for the mean of four, beside 0.3 cm of the rig.
    assert rows["mean DBH"] == ["30.0 ± 0.4 cm", "4 of 5"]
    assert rows["quadratic mean DBH"] == ["31.6 ± 0.3 cm", "4 of 5"]
    assert rows["basal area on 0.01 ha"][0].startswith("31.4 ± 0.7 m²/ha")
    assert rows["sum of stem volumes"] == ["2.000 ± 0.400 m³", "4 of 5"]
    assert "mean diameter at the felling cut" not in rows
    assert "The basal area is of a part: 1 tree without a value would come on top" in page.text
    assert "There is no mean diameter at the felling cut (no cut)." in page.text
    assert "There is no basal area" not in page.text
    assert re.search(r"Evo <east>, \d{4}-\d\d-\d\d\. Pictures: images\.", page.text)
    assert "Stand 7" in page.text


def test_totals_count_a_stem_that_is_followed_once(tmp_path: Path) -> None:
    def view(diameter_m: float, std_m: float, dbh_m: float) -> TreeMeasurement:
        values = {"diameter_m": Estimate(diameter_m, std_m), "dbh_m": Estimate(dbh_m, 0.01)}
        return replace(MEASURED, **values, rig_std={}, volume_m3=Failure("none"))

    frames = [
        ((None, 2), (view(0.9, 0.01, 0.9), view(0.4, 0.02, 0.4))),
        ((1, 2), (view(0.3, 0.01, 0.2), view(0.5, 0.01, 0.4))),
        ((1, 2), (view(0.2, 0.03, 0.2), view(0.3, 0.04, 0.4))),
    ]
    results = [
        replace(found := result(str(number), *trees), found=replace(found.found, tracks=tracks))
        for number, (tracks, trees) in enumerate(frames)
    ]
    page = written(tmp_path / "r.html", *results)
    rows = {row[0].text: [cell.text for cell in row[1:]] for row in page.rows}
    assert rows["mean diameter at the felling cut"] == ["40.0 ± 0.7 cm", "2 of 2"]
    assert rows["mean DBH"] == ["30.0 ± 0.7 cm", "2 of 2"]
    assert "There is no sum of stem volumes (none). There is no basal area: no --area" in page.text
    assert "each stem that was followed counts once, with the most certain" in page.text
    assert "2 of 2 different trees with a measured diameter" in " ".join(page.text.split())


@pytest.mark.parametrize(
    "tracks",
    [
        pytest.param(((None, None),), id="one frame"),
        pytest.param(((None, None), (None, None), (None, 1)), id="frames far apart"),
    ],
)
def test_a_video_whose_stems_are_not_followed_counts_all_trees(
    tmp_path: Path, tracks: tuple[tuple[int | None, ...], ...]
) -> None:
    results = [
        replace(
            found := result(str(number), MEASURED, MEASURED),
            found=replace(found.found, tracks=each),
        )
        for number, each in enumerate(tracks)
    ]
    page = written(tmp_path / "r.html", *results)
    trees = 2 * len(tracks)
    assert f"{trees} trees found {trees} of {trees} trees with a measured diameter" in page.text
    assert "31.2 cm median diameter" in page.text
    rows = {row[0].text: row[-1].text for row in page.rows}
    assert rows["mean diameter at the felling cut"] == f"{trees} of {trees}"
    assert "a tree counts as often as it is in a picture" in page.text


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--title", "Stand"), "--title given without --report: expected both"),
        (("--area", 0, "--report", "r.html"), "--area is 0.0: expected hectares above 0"),
        (("--area", "nan", "--report", "r.html"), "--area is nan: expected hectares above 0"),
    ],
)
def test_wrong_options_of_the_report_are_one_line(
    run_cli: Cli, model: Path, folder: Path, options: tuple[object, ...], words: str
) -> None:
    done = run_cli("run", "images", "--model", model, *options)
    assert (done.code, done.err) == (2, f"edgetree: {words}\n")


def test_diameters_are_counted_in_classes_of_4_cm(tmp_path: Path) -> None:
    trees = [replace(MEASURED, diameter_m=Estimate(d, 0.01)) for d in (0.2, 0.21, 0.2399, 0.285)]
    page = written(tmp_path / "r.html", result("a", *trees))
    edges = [
        float(found["data-value"] or "")
        for tag, found in page.tags
        if tag == "tspan" and "data-bare" in found
    ]
    assert edges == pytest.approx([0.2, 0.24, 0.28, 0.32])
    assert "trees: 3" in page.text
    assert page.text.count("trees: 1") == 1


def test_a_report_without_trees_is_a_page(tmp_path: Path) -> None:
    page = written(tmp_path / "r.html", result("a"))
    assert "No trees." in page.text
    assert "– median diameter" in page.text


def test_the_units_of_the_script_fit_those_of_the_page(tmp_path: Path) -> None:
    page = written(tmp_path / "r.html", result("a", MEASURED))
    (start,) = [code for code in page.code if code.startswith("{")]
    units = json.loads(start)
    assert list(units) == ["cm", "mm", "inch"] == page.attributes("button", "value")
    used = set(page.attributes("td", "data-quantity"))
    assert used == {"diameter_m", "distance_m"}
    for name in (*used, *page.attributes("tspan", "data-quantity")):
        assert all(name in amounts for amounts in units.values())
    assert units["cm"]["diameter_m"] == list(AMOUNTS["diameter_m"][1:])
    inch = UNITS["inch"]["diameter_m"].with_std(Estimate(0.254, 0.0254))
    assert inch == "10.0 ± 1.0 in"
    assert UNITS["mm"]["cut_height_m"].with_std(Estimate(0.148, 0.02)) == "148 ± 20 mm"


def test_pictures_are_small_enough_for_a_folder_of_100(tmp_path: Path) -> None:
    noise = np.random.default_rng(0).integers(0, 256, (1100, 1900, 3), np.uint8)
    wide = np.full((400, 3000, 3), 90, np.uint8)
    page = written(tmp_path / "r.html", result("a", picture=noise), result("b", picture=wide))
    sizes = []
    for source in page.attributes("img", "src"):
        assert len(source) < 245_000
        data = np.frombuffer(base64.b64decode(source.partition(",")[2]), np.uint8)
        picture = cv2.imdecode(data, cv2.IMREAD_COLOR)
        assert picture is not None
        sizes.append(picture.shape[1::-1])
    assert sizes[0][0] / sizes[0][1] == pytest.approx(1900 / 1100, rel=0.01)
    assert sizes[1] == (1280, 171)
    shown = [
        (found["width"], found["height"]) for tag, found in page.tags if tag == "img" and found
    ]
    assert shown == [(str(width), str(height)) for width, height in sizes]


def held_by_edgetree() -> int:
    """Bytes held that edgetree's own lines allocated, without Python's tables of names."""
    traces = tracemalloc.take_snapshot().filter_traces([tracemalloc.Filter(True, "*/edgetree/*")])
    return sum(statistic.size for statistic in traces.statistics("filename"))


def test_memory_does_not_grow_with_the_number_of_frames(tmp_path: Path) -> None:
    noise = np.random.default_rng(0).integers(0, 256, (120, 160, 3), np.uint8)
    tree = replace(MEASURED, dbh_m=Failure("too low"))
    tracemalloc.start()
    try:
        with report_file(tmp_path / "r.html", "s", "m") as add:
            add(result("first", tree, picture=noise))
            gc.collect()
            before, held = tracemalloc.get_traced_memory()[0], held_by_edgetree()
            for number in range(300):
                add(result(str(number), tree, picture=noise))
            gc.collect()
            grown = held_by_edgetree() - held
        peak = tracemalloc.get_traced_memory()[1] - before
    finally:
        tracemalloc.stop()
    size = (tmp_path / "r.html").stat().st_size
    assert size > 4e6
    assert grown < 1e6
    assert peak < size
