"""Files are read and written in one place, so that every name works."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SOURCES = [
    path
    for folder in ("calib", "edgetree", "perceptree", "benchmarks")
    for path in sorted((ROOT / folder).rglob("*.py"))
]
# OpenCV crashes on names that are not UTF-8, and writes files that a killed process leaves half.
BY_PATH = (
    r"cv2\.(imread|imreadmulti|imwrite|haveImageReader|VideoCapture|VideoWriter|FileStorage)\("
)


def uses(pattern: str) -> set[str]:
    return {
        str(path.relative_to(ROOT))
        for path in SOURCES
        if re.search(pattern, path.read_text(encoding="utf-8"))
    }


def test_paths_are_given_to_opencv_in_one_place_only() -> None:
    assert uses(BY_PATH) == {"calib/reading.py"}


@pytest.mark.parametrize("call", ["cv2.imread(str(path))", "cv2.FileStorage(name, 0)"])
def test_the_check_finds_calls(call: str) -> None:
    assert re.search(BY_PATH, call)
    assert not re.search(BY_PATH, "cv2.imdecode(data, flags)")
