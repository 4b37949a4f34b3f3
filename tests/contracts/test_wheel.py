"""The wheel is small, holds every model, and alone makes every name in the documentation work."""

import json
import os
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
MOST_BYTES = 20_000_000
FILES = ("pyproject.toml", "README.md", "LICENSE")
PACKAGES = ("basetree", "calib", "edgetree", "fleet", "perceptree")
OPEN_ALL = """
import json, sys
from edgetree import TreeDetector
opened = {name: TreeDetector.load(name, threads=1).session.name for name in sys.argv[1:]}
print(json.dumps(opened))
"""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel, built from a copy of the sources."""
    source, out = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("wheel")
    for name in FILES:
        shutil.copy(ROOT / name, source / name)
    for name in PACKAGES:
        ignored = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / name, source / name, ignore=ignored)
    command = [sys.executable, "-m", "pip", "wheel", "--no-index", "--no-deps"]
    done = subprocess.run(
        [*command, "--no-build-isolation", "-w", str(out), str(source)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return next(out.glob("*.whl"))


def named_models() -> set[str]:
    """The names of models in the pages: those of the package, and what examples open."""
    text = "\n".join(page.read_text("utf-8") for page in PAGES)
    opened = re.findall(r"(?:\bload|\bdefault_model)\(\"([^\"]+)\"", text)
    run = re.findall(r"edgetree (?!calibrate)[^`\n]*--model ((?!FILE)[\w-]+)(?![\w.-])", text)
    return {*re.findall(r"\bedge-[a-z]-(?:rgb|depth)\b", text), *opened, *run}


def test_the_wheel_is_small(wheel: Path) -> None:
    assert wheel.stat().st_size < MOST_BYTES


def test_the_pages_name_all_models() -> None:
    assert {"rgb", "depth", "edge-n-depth", "edge-s-rgb"} <= named_models()


def test_every_name_in_the_pages_opens_from_the_wheel_alone(wheel: Path, tmp_path: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(tmp_path / "installed")
    names = sorted(named_models())
    environment = {key: value for key, value in os.environ.items() if key != "EDGETREE_MODELS"}
    done = subprocess.run(
        [sys.executable, "-P", "-c", OPEN_ALL, *names],
        cwd=tmp_path,
        env={**environment, "PYTHONPATH": str(tmp_path / "installed")},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    opened = json.loads(done.stdout)
    assert set(opened) == set(names)
    for name, path in opened.items():
        assert Path(path).is_relative_to(tmp_path / "installed"), name
        assert name in ("rgb", "depth") or Path(path).stem == name
