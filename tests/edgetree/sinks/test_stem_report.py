"""The report of followed stems: one entry each, their best views, and bounded memory."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest

from edgetree.frames.pipeline import FoundTrees
from edgetree.frames.turning import Turn
from edgetree.measure import Estimate, Failure, TreeMeasurement
from edgetree.measure.volume import stem_volume
from edgetree.results.text_table import pixel_words
from edgetree.sinks import StemReportSink, report


def measured(result, *stds_m: float):
    """The result with other errors of the diameters of this frame."""
    trees = [
        dataclasses.replace(tree, diameter_m=Estimate(tree.diameter_m.value, std_m))
        for tree, std_m in zip(result.measurements, stds_m, strict=True)
    ]
    return dataclasses.replace(result, measurements=trees)


def entries(page: str) -> list[tuple[str, int, str]]:
    """Frame, number and diameter of each row."""
    found = re.findall(
        r'<tr[^>]*><td data-name="frame"><a href="#[^"]+">([^<]+)</a></td>'
        r'<td data-name="tree" data-value="(\d+)">\d+</td>'
        r'<td data-name="diameter"[^>]*>([^<]+)</td>',
        page,
    )
    return [(frame, int(number), diameter) for frame, number, diameter in found]


def written(path: Path, *results) -> str:
    sink = StemReportSink(path, "drive.mcap", "model.onnx")
    for result in results:
        sink.write(result)
    assert not path.exists()
    sink.close()
    sink.close()
    return path.read_text()


def test_each_stem_has_its_best_view_and_what_all_views_say(tmp_path, live_result) -> None:
    page = written(
        tmp_path / "stems.html",
        measured(live_result(0), 0.02, 0.02),
        measured(live_result(1), 0.004, 0.05),
        measured(live_result(2, diameter_m=Estimate(0.3, 0.001)), 0.0039, 0.05),
    )
    assert entries(page) == [
        ("frame_000000", 2, "30.0 ± 0.1 cm"),
        ("frame_000001", 1, "30.0 ± 0.1 cm"),
    ]
    assert page.count("<figure") == 2
    assert "Trees in drive.mcap" in page
    assert "each stem counts once" in page
    assert "Found by the model model.onnx; each stem has what all views say" in page


def test_the_volume_is_that_of_the_diameter_that_all_views_say(tmp_path, live_result) -> None:
    result = live_result(0, 2, dbh_m=Estimate(0.25, 0.005))
    trees = [
        dataclasses.replace(tree, dbh_m=one_view, volume_m3=stem_volume("spruce", one_view))
        for tree in result.measurements
        for one_view in [Estimate(0.35, 0.03)]
    ]
    trees = [dataclasses.replace(tree, species="spruce") for tree in trees]
    page = written(tmp_path / "a.html", dataclasses.replace(result, measurements=trees))
    volume = stem_volume("spruce", Estimate(0.25, 0.005))
    assert f"{volume.value:.3f} ± {volume.std:.3f} m³" in page
    assert f"{trees[0].volume_m3.value:.3f} ±" not in page


def test_the_size_in_the_picture_is_that_of_the_upright_picture(tmp_path, live_result) -> None:
    no = Failure("no depth on the stem")
    result = live_result(0, 2, diameter_m=no, dbh_m=no)
    trees = result.found.trees
    # A stem across the picture of a camera on its side, leaning by 0° upright.
    across = np.array([[20, 100, 330, 130]], np.float32)
    mask = np.ones((1, 28, 28), np.float32)
    lying = dataclasses.replace(trees, boxes_px=across, masks=mask)
    result = dataclasses.replace(
        result,
        found=FoundTrees.detected(lying),
        measurements=[TreeMeasurement.failed(no.reason)],
        turn=Turn(1),
    )
    (size,) = result.pixel_sizes
    assert abs(size.lean_in_picture_deg.value) < 1
    assert pixel_words(size) in written(tmp_path / "a.html", result)


def test_stems_that_were_never_confirmed_have_no_entry(tmp_path, live_result) -> None:
    results = (live_result(0, 2), live_result(1, 4, state="new"), live_result(2, 2))
    assert [number for _, number, _ in entries(written(tmp_path / "a.html", *results))] == [1, 2]


def test_a_stem_that_another_one_absorbed_has_no_entry(tmp_path, live_result) -> None:
    results = (live_result(0, 4), live_result(1, 2, absorbed=(3,)))
    assert [number for _, number, _ in entries(written(tmp_path / "a.html", *results))] == [1, 2]


def test_the_newest_pictures_are_kept_and_older_stems_counted(
    tmp_path, live_result, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(report, "_MOST_PICTURES", 2)
    results = []
    for frame in range(4):
        result = live_result(frame, 2)
        (track, *_) = result.tracks
        tracks = [dataclasses.replace(track, number=10 + frame)]
        results.append(dataclasses.replace(result, tracks=tracks))
    page = written(tmp_path / "a.html", *results)
    assert [number for _, number, _ in entries(page)] == [12, 13]
    assert "2 older stems: this page has the 2 newest pictures" in page
    assert "<b>2</b><span>pictures</span>" in page
    assert "<h2>Left out</h2>" in page
    assert "<span>frames" not in page


def test_pictures_are_kept_without_the_frames(tmp_path, live_result) -> None:
    sink = StemReportSink(tmp_path / "a.html", "drive.mcap", "model.onnx")
    result = live_result(0)
    scan = {"filled_depth_m": np.ones((48, 64), np.float32), "cloud_m": np.ones((1000, 3))}
    sink.write(dataclasses.replace(result, frame=dataclasses.replace(result.frame, **scan)))
    (view,) = {stem.view for stem in sink._stems.values()}
    kept = vars(view.result.frame).items()
    assert [name for name, each in kept if isinstance(each, np.ndarray) and each.size > 9] == []
    sink.close()


def test_a_run_without_stems_gives_a_page(tmp_path, live_result) -> None:
    assert "No trees." in written(tmp_path / "a.html", live_result(stems=0))
