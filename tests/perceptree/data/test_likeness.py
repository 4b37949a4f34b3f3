"""Comparison of real and simulated images."""

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from perceptree.data.likeness import MEASURES, compare_pictures, find_pictures
from perceptree.data.likeness_page import likeness_page

Call = Callable[..., tuple[int, str, str]]


def picture(
    seed: int, lightness: float = 1.0, colour: float = 1.0, blur_px: float = 0
) -> np.ndarray:
    """Bars on a textured background, (240, 320, 3) uint8."""
    rng = np.random.default_rng(seed)
    image = np.full((240, 320, 3), (90, 140, 110), float) + rng.normal(0, 12, (240, 320, 3))
    for x in rng.integers(0, 300, 5):
        image[20:200, x : x + 14] = (50, 60, 75)
    grey = image.mean(-1, keepdims=True)
    image = (grey + colour * (image - grey)) * lightness
    if blur_px:
        image = cv2.GaussianBlur(image, (0, 0), blur_px)
    return np.clip(image, 0, 255).astype(np.uint8)


def folder(path: Path, seeds: range, **looks: float) -> Path:
    path.mkdir(parents=True)
    for seed in seeds:
        assert cv2.imwrite(str(path / f"{seed:03d}.png"), picture(seed, **looks))
    return path


def separations(real: Path, simulated: Path) -> dict[str, float]:
    comparison = compare_pictures(find_pictures(real, 50), find_pictures(simulated, 50))
    return {d.measure.name: d.separation for d in comparison.differences}


def test_similar_images_are_not_separated(tmp_path: Path):
    real, same = (folder(tmp_path / name, range(10)) for name in ("a", "b"))
    assert set(separations(real, same).values()) == {0.0}


@pytest.mark.parametrize(
    ("looks", "telling"),
    [
        ({"lightness": 0.6}, "lightness"),
        ({"colour": 0.2}, "chroma"),
        ({"blur_px": 2.0}, "finest"),
        ({"lightness": 2.4}, "blown"),
    ],
)
def test_differences_are_found(tmp_path: Path, looks: dict[str, float], telling: str):
    real = folder(tmp_path / "real", range(10))
    other = folder(tmp_path / "other", range(10, 20), **looks)
    assert separations(real, other)[telling] > 0.9


def test_the_most_separating_measure_comes_first(tmp_path: Path):
    real = folder(tmp_path / "real", range(12))
    dark = folder(tmp_path / "dark", range(12, 24), lightness=0.5)
    found = compare_pictures(find_pictures(real, 50), find_pictures(dark, 50)).differences
    order = [difference.separation for difference in found]
    assert order == sorted(order, reverse=True)
    assert {d.measure.name: d.shift for d in found}["lightness"] < -3


def test_only_colour_images_of_a_simulated_dataset_are_used(tmp_path: Path):
    folder(tmp_path / "images", range(5))
    folder(tmp_path / "depth", range(5))
    (tmp_path / "scenes").mkdir()
    assert {path.parent.name for path in find_pictures(tmp_path, 50)} == {"images"}


def test_pictures_are_taken_evenly_from_a_large_folder(tmp_path: Path):
    names = [path.name for path in find_pictures(folder(tmp_path / "a", range(30)), 4)]
    assert names[0] == "000.png"
    assert names[-1] == "029.png"
    assert len(names) == 4


def test_the_page_shows_every_measure_and_both_sets(tmp_path: Path):
    real = folder(tmp_path / "real<&", range(4))
    page = likeness_page(compare_pictures(find_pictures(real, 9), find_pictures(real, 9)))
    assert all(measure.title.replace("&", "&amp;") in page for measure in MEASURES)
    assert page.count("<figure>") == 8
    assert "real<&" not in page


def test_the_command_writes_the_page_and_prints_differences(tmp_path: Path, call: Call):
    real = folder(tmp_path / "real", range(4))
    dark = folder(tmp_path / "dark", range(4, 8), lightness=0.5)
    out = tmp_path / "page.html"
    code, printed, _ = call("data", "compare", real, dark, "--out", out)
    assert code == 0
    assert "Lightness, mean grey level: separation 1.00" in printed
    assert out.read_text().startswith("<!doctype html>")
    code, printed, _ = call("data", "compare", real, dark, "--out", out, "--json")
    assert json.loads(printed)["measures"]["lightness"]["separation"] == 1.0


def test_wrong_folders_are_named_in_one_line(tmp_path: Path, call: Call):
    real = folder(tmp_path / "real", range(4))
    empty = tmp_path / "empty"
    empty.mkdir()
    code, _, told = call("data", "compare", real, empty)
    assert code == 2
    assert told.strip() == f"perceptree: {empty}: holds 0 images, expected at least 3"
    code, _, told = call("data", "compare", tmp_path / "none", real)
    assert code == 2
    assert (
        told.strip()
        == f"perceptree: {tmp_path / 'none'}: no such folder, expected a folder with images"
    )
    (real / "000.png").write_bytes(b"no picture")
    code, _, told = call("data", "compare", real, real)
    assert code == 2
    assert f"{real / '000.png'}: not a readable image" in told
    code, _, told = call("data", "compare", real, real, "--most", 0)
    assert code == 2
    assert "--most is 0: expected at least 1" in told
