"""The notebooks of the documentation run from the first cell to the last, and stay small."""

import json
import os
import shutil
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))
LAST_FILES = {
    "first": "samples/camera.json",
    "train": "found/labels.json",
    "live": "stems.geojson",
}
by_name = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)


def outputs(book):
    """All outputs of the cells of a notebook."""
    return [output for cell in book["cells"] for output in cell.get("outputs", [])]


def pictures(book):
    """The pictures among the outputs."""
    return [output for output in outputs(book) if "image/jpeg" in output.get("data", {})]


@by_name
def test_a_notebook_keeps_one_picture_and_is_small(path):
    book = json.loads(path.read_text("utf-8"))
    assert path.stat().st_size < 300_000
    assert len(pictures(book)) == 1
    assert str(Path.home()) not in path.read_text("utf-8")


@pytest.mark.parametrize(
    "path",
    [
        pytest.param(path, id=path.stem, marks=[pytest.mark.slow] if path.stem == "train" else [])
        for path in NOTEBOOKS
    ],
)
def test_a_notebook_runs(path, tmp_path, monkeypatch):
    nbclient = pytest.importorskip("nbclient")
    nbformat = pytest.importorskip("nbformat")
    pytest.importorskip("ipykernel")
    if path.stem == "train":
        pytest.importorskip("torch")
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    python_path = os.environ.get("PYTHONPATH", "")
    monkeypatch.setenv("PYTHONPATH", f"{ROOT}{os.pathsep}{python_path}")
    assert shutil.which("edgetree")
    book = nbformat.read(path, as_version=4)
    client = nbclient.NotebookClient(
        book, timeout=300, resources={"metadata": {"path": str(tmp_path)}}
    )
    client.execute()
    assert len(pictures(book)) == 1
    assert (tmp_path / LAST_FILES[path.stem]).is_file()
