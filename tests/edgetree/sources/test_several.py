"""Several files, patterns and folders below folders as one source."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np
import pytest

import calib
from basetree.errors import InputError
from edgetree.frames.frame import Frame
from edgetree.frames.rig import Rig
from edgetree.sources import open_source
from edgetree.sources.several import open_several
from edgetree.sources.source import FrameSource, readable
from edgetree.sources.source_list import SourceList, list_sources


def write(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), np.full((24, 32, 3), 90, np.uint8))
    return path


def write_depth(path: Path, depth_m: float) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    calib.write_depth(path, np.full((24, 32), depth_m, np.float32))
    return path


def opened(sources: SourceList, depth: Path | None = None) -> FrameSource:
    return open_several(sources, depth, rig=Rig(), open_one=open_source)


def names(frames: Iterable[Frame]) -> list[str]:
    return [frame.name for frame in frames]


def test_files_are_taken_in_the_order_typed_and_each_once(tmp_path: Path) -> None:
    b, a = write(tmp_path / "b.jpg"), write(tmp_path / "a.jpg")
    sources = list_sources([b, a, tmp_path / "." / "b.jpg"])
    assert sources.paths == (b, a)
    frames = opened(sources)
    assert frames.count == 2
    assert names(frames) == ["b", "a"]


def test_a_pattern_takes_pictures_alone_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    for number in (10, 2, 1):
        write(tmp_path / f"shot{number}.jpg")
    (tmp_path / "shot.csv").write_text("x")
    sources = list_sources([tmp_path / "shot*"])
    assert names(opened(sources)) == ["shot1", "shot2", "shot10"]


def test_a_file_whose_name_looks_like_a_pattern_is_itself(tmp_path: Path) -> None:
    write(tmp_path / "a1.jpg")
    named = write(tmp_path / "a[1].jpg")
    assert list_sources([named]).paths == (named,)


@pytest.mark.parametrize(
    ("pattern", "found"),
    [("*.jpg", "matches no picture"), ("*", r"only others such as .*notes\.txt")],
)
def test_a_pattern_without_pictures_says_so(tmp_path: Path, pattern: str, found: str) -> None:
    (tmp_path / "notes.txt").write_text("x")
    with pytest.raises(InputError, match=found):
        list_sources([tmp_path / pattern])


def test_double_stars_match_files_and_not_their_folders_again(tmp_path: Path) -> None:
    write(tmp_path / "one" / "a.jpg")
    write(tmp_path / "two" / "deep" / "b.jpg")
    sources = list_sources([tmp_path / "**"])
    assert sorted(names(opened(sources))) == ["a", "b"]


def test_names_of_frames_differ_by_as_many_folders_as_it_takes(tmp_path: Path) -> None:
    for name in (
        "x/plot1/a.jpg",
        "x/plot2/a.jpg",
        "y/plot1/a.jpg",
        "y/plot1/b.jpg",
        "y/plot1/b.png",
    ):
        write(tmp_path / name)
    sources = list_sources([tmp_path], recursive=True)
    found = names(opened(sources))
    assert found == ["x_plot1_a", "x_plot2_a", "y_plot1_a", "b.jpg", "b.png"]


def test_names_that_would_be_the_same_with_folders_get_a_number(tmp_path: Path) -> None:
    for name in ("p/a_b/c.jpg", "p_a/b/c.jpg", "c.jpg"):
        write(tmp_path / name)
    found = names(opened(list_sources([tmp_path], recursive=True)))
    assert len(set(found)) == 3
    assert all("/" not in name for name in found)


def test_recursive_takes_the_folders_below_without_hidden_ones_and_links(tmp_path: Path) -> None:
    root = tmp_path / "root"
    write(root / "a.jpg")
    write(root / "deep" / "er" / "b.jpg")
    write(root / ".thumbs" / "c.jpg")
    write(tmp_path / "elsewhere" / "d.jpg")
    (root / "link").symlink_to(tmp_path / "elsewhere")
    (root / "loop").symlink_to(root)
    assert names(opened(list_sources([root], recursive=True))) == ["a", "b"]


def test_a_folder_without_pictures_below_it_says_so(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="the folders below it have no pictures"):
        list_sources([tmp_path], recursive=True)


def test_depth_of_each_folder_is_found_beside_it(tmp_path: Path) -> None:
    for plot, depth_m in (("plot1", 2.0), ("plot2", 3.0)):
        write(tmp_path / plot / "rgb" / "a.jpg")
        write_depth(tmp_path / plot / "depth" / "a.png", depth_m)
    sources = list_sources([tmp_path], recursive=True)
    assert sources.has_depth({})
    frames = list(opened(sources))
    depths = {frame.name: frame.depth_m[0, 0] for frame in frames if frame.depth_m is not None}
    assert depths == pytest.approx({"plot1_rgb_a": 2.0, "plot2_rgb_a": 3.0})


@pytest.mark.parametrize("recursive", [False, True])
def test_depth_folders_mirror_those_of_the_pictures(tmp_path: Path, recursive: bool) -> None:
    for plot, depth_m in (("plot1", 2.0), ("plot2", 3.0)):
        write(tmp_path / "pictures" / plot / "a.jpg")
        write_depth(tmp_path / "depths" / plot / "a.png", depth_m)
    plots = [tmp_path / "pictures" / plot for plot in ("plot1", "plot2")]
    typed = [tmp_path / "pictures"] if recursive else plots
    frames = opened(list_sources(typed, recursive=recursive), tmp_path / "depths")
    assert [frame.depth_m[0, 0] for frame in frames if frame.depth_m is not None] == [2.0, 3.0]


def test_files_find_their_depth_in_the_folder_of_depth(tmp_path: Path) -> None:
    pictures = [write(tmp_path / f"{stem}_rgb.jpg") for stem in "ab"]
    for stem, depth_m in (("a", 2.0), ("b", 3.0)):
        write_depth(tmp_path / "depth" / f"{stem}_depth.png", depth_m)
    frames = list(opened(list_sources(pictures), tmp_path / "depth"))
    assert [frame.depth_m[0, 0] for frame in frames if frame.depth_m is not None] == [2.0, 3.0]


def test_pictures_without_their_depth_are_left_out_and_the_others_kept(tmp_path: Path) -> None:
    for plot in ("plot1", "plot2"):
        write(tmp_path / "pictures" / plot / f"{plot}.jpg")
    write_depth(tmp_path / "depths" / "plot2.png", 3.0)
    frames = opened(list_sources([tmp_path / "pictures"], recursive=True), tmp_path / "depths")
    errors: list[Exception] = []
    assert names(readable(frames, errors.append)) == ["plot2"]
    assert "plot1.png does not exist" in str(errors[0])


def test_sources_with_and_without_depth_fit_no_model(tmp_path: Path) -> None:
    picture = write(tmp_path / "a.jpg")
    write(tmp_path / "plot" / "rgb" / "a.jpg")
    write_depth(tmp_path / "plot" / "depth" / "a.png", 2.0)
    with pytest.raises(InputError, match=r"plot has depth and .*a\.jpg has none"):
        list_sources([picture, tmp_path / "plot"]).has_depth({})


def test_an_unreadable_file_does_not_end_the_others(tmp_path: Path) -> None:
    first, last = write(tmp_path / "a.jpg"), write(tmp_path / "z.jpg")
    broken, text = tmp_path / "b.jpg", tmp_path / "film.mp4"
    broken.write_text("no image")
    text.write_text("no video")
    frames = opened(list_sources([first, broken, text, last]))
    errors: list[Exception] = []
    assert names(readable(frames, errors.append)) == ["a", "z"]
    assert [str(error).split()[1] for error in errors] == [str(broken), str(text)]


def test_videos_of_the_same_name_have_frames_of_different_names(tmp_path: Path) -> None:
    paths = []
    for folder in ("one", "two"):
        (tmp_path / folder).mkdir()
        paths.append(tmp_path / folder / "v.avi")
        video = cv2.VideoWriter(str(paths[-1]), cv2.VideoWriter.fourcc(*"MJPG"), 5, (32, 24))
        video.write(np.full((24, 32, 3), 90, np.uint8))
        video.release()
    frames = opened(list_sources(paths))
    assert frames.count is None
    assert names(frames) == ["v_000000", "two_v_000000"]
