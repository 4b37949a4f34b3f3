"""Files are read and written in one place, so that every name works."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SOURCES = [
    path
    for folder in ("basetree", "calib", "edgetree", "fleet", "perceptree", "benchmarks")
    for path in sorted((ROOT / folder).rglob("*.py"))
]
# OpenCV crashes on names that are not UTF-8, and writes files that a killed process leaves half.
BY_PATH = (
    r"cv2\.(imread|imreadmulti|imwrite|haveImageReader|VideoCapture|VideoWriter|FileStorage)\("
)

# Writers beside basetree/files/writing.py: files that only this process sees, and files that grow.
WRITERS = {
    "basetree/program/process.py",  # the null device
    "perceptree/data/cache.py",  # in a folder of `replacing_folder`
    "perceptree/training/run_log.py",  # appends
    "edgetree/sources/bags/opening.py",  # in a temporary folder
}
WRITES = (
    r"\.write_(bytes|text)\(|open\([^)]*[\"'][wxa]b?\+?[\"']"
    r"|mkstemp|NamedTemporaryFile|\(io\.FileIO\)"
)


def uses(pattern: str) -> set[str]:
    return {
        str(path.relative_to(ROOT))
        for path in SOURCES
        if re.search(pattern, path.read_text(encoding="utf-8"))
    }


def test_paths_are_given_to_opencv_in_one_place_only() -> None:
    addresses = {"edgetree/sources/cameras/opencv.py"}  # of cameras; it refuses those not in UTF-8
    videos = {"edgetree/sinks/video.py"}  # which refuses names that are not in UTF-8
    assert uses(BY_PATH) == {"basetree/files/reading.py"} | addresses | videos


def test_files_are_written_whole() -> None:
    found = {name for name in uses(WRITES) if not name.startswith("benchmarks")}
    assert found == WRITERS | {"basetree/files/writing.py"}


@pytest.mark.parametrize("call", ["path.write_bytes(data)", 'path.open("w", encoding="utf-8")'])
def test_the_check_finds_writers(call: str) -> None:
    assert re.search(WRITES, call)
    assert not re.search(WRITES, 'path.open("rb")')


@pytest.mark.parametrize("call", ["cv2.imread(str(path))", "cv2.FileStorage(name, 0)"])
def test_the_check_finds_calls(call: str) -> None:
    assert re.search(BY_PATH, call)
    assert not re.search(BY_PATH, "cv2.imdecode(data, flags)")
