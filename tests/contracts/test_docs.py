"""The README and the documentation match the code: commands, options, examples, reference."""

import ast
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from textwrap import dedent
from typing import Any

import cv2
import pytest
import typer

from calib import load_camera, load_transform
from calib.files.stereo import load_stereo
from edgetree import sample_frames
from edgetree.cli import app as edgetree_app
from edgetree.sample_files import write_samples
from perceptree.cli import app as perceptree_app

ROOT = Path(__file__).resolve().parents[2]
TOP_PAGES = ["README.md", "CONTRIBUTING.md", "RELEASING.md"]
PAGES = [*(ROOT / name for name in TOP_PAGES), *sorted((ROOT / "docs").rglob("*.md"))]
PROGRAMS = {
    "edgetree": typer.main.get_command(edgetree_app),
    "perceptree": typer.main.get_command(perceptree_app),
}


def examples(language: str) -> Iterator[tuple[str, str]]:
    """Page and content of every fenced block of one language."""
    for page in PAGES:
        blocks = re.findall(
            rf"^( *)```{language}\n(.*?)^\1```$",
            page.read_text("utf-8"),
            flags=re.DOTALL | re.MULTILINE,
        )
        for _, content in blocks:
            yield page.relative_to(ROOT).as_posix(), dedent(content)


def typed_commands(block: str) -> Iterator[list[str]]:
    """The words of every call of one of the programs, also by the path of an environment."""
    for part in re.split(r"\n|&&", block.replace("\\\n", " ")):
        words = shlex.split(part.partition(" > ")[0], comments=True)
        if words and Path(words[0]).name in PROGRAMS:
            yield [Path(words[0]).name, *words[1:]]


COMMANDS = [(page, words) for page, block in examples("sh") for words in typed_commands(block)]
PYTHON = list(examples("python"))
# Files that a command opens while its words are parsed.
DEPLOYED = {"edgetree.toml": str(ROOT / "deploy" / "edgetree.toml")}
JSON = list(examples("json"))


def check_command(words: list[str]) -> None:
    """Parse the words as the program does; raises for a wrong command, option or value."""
    command: Any = PROGRAMS[words[0]]
    names, rest = [words[0]], words[1:]
    while rest and rest[0] in getattr(command, "commands", {}):
        command = command.commands[rest[0]]
        names.append(rest.pop(0))
    known = getattr(command, "commands", {})
    assert not known or not rest, f"{names} has no command {rest[0]}, only {sorted(known)}"
    command.make_context(" ".join(names), [DEPLOYED.get(word, word) for word in rest])


def test_there_are_examples() -> None:
    assert len(COMMANDS) >= 50
    assert len(PYTHON) >= 5
    assert {page for page, _ in COMMANDS} >= {"README.md", "docs/guides/machine.md"}


@pytest.mark.parametrize(
    ("page", "words"), COMMANDS, ids=[f"{page}: {' '.join(words)}" for page, words in COMMANDS]
)
def test_a_command_exists_with_its_options(
    page: str, words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copy(ROOT / "deploy" / "edgetree.toml", tmp_path)  # the file of `--config edgetree.toml`
    monkeypatch.chdir(tmp_path)
    check_command(words)


def test_a_wrong_option_is_seen() -> None:
    with pytest.raises(Exception, match="--no-such-option"):
        check_command(["edgetree", "bench", "--no-such-option"])
    with pytest.raises(AssertionError, match="no-such-command"):
        check_command(["perceptree", "data", "no-such-command"])


@pytest.fixture
def frame_folder(tmp_path: Path) -> Path:
    """What the examples read: the samples, and the folder of the program that measures files."""
    write_samples(tmp_path / "samples")
    shutil.copy(tmp_path / "samples" / "camera.json", tmp_path)
    frame = sample_frames()[0]
    (tmp_path / "spool").mkdir()
    shutil.copy(frame.image_path, tmp_path / "spool" / "frame.jpg")
    shutil.copy(frame.depth_path, tmp_path / "spool" / "frame_depth_mm.png")
    return tmp_path


@pytest.mark.parametrize(
    ("page", "code"), PYTHON, ids=[f"{page} {n}" for n, (page, _) in enumerate(PYTHON)]
)
def test_a_python_example_runs(page: str, code: str, frame_folder: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", code, "--once"],
        cwd=frame_folder,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout
    if "interval95" in code:
        printed = r"^0\.\d{3} m, 0\.\d{3} to 0\.\d{3} m$"
        assert re.search(printed, done.stdout, flags=re.MULTILINE)


@pytest.mark.parametrize(
    ("page", "text"), JSON, ids=[f"{page} {n}" for n, (page, _) in enumerate(JSON)]
)
def test_a_json_example_can_be_read(page: str, text: str, tmp_path: Path) -> None:
    values = json.loads(text)
    path = tmp_path / "example.json"
    path.write_text(text)
    if values.get("schema") == "calib.camera/1":
        assert load_camera(path).width == values["width"]
    elif values.get("schema") == "calib.transform/1":
        assert load_transform(path).rotation.shape == (3, 3)
    elif values.get("schema") == "calib.stereo/1":
        assert load_stereo(path).left.width == values["left"]["width"]


@pytest.mark.parametrize("page", TOP_PAGES)
def test_a_link_to_a_file_leads_somewhere(page: str) -> None:
    text = (ROOT / page).read_text("utf-8")
    links = [link for link in re.findall(r"\]\(([^)#]+)", text) if "://" not in link]
    assert len(links) > 2
    assert [link for link in links if not (ROOT / link).exists()] == []


def test_a_named_file_of_the_repository_is_there() -> None:
    tops = (
        "basetree|benchmarks|calib|checkpoints|docs|edgetree|perceptree|release|requirements|tests"
    )
    missing = set()
    for page in PAGES:
        text = re.sub(
            r"^ *```.*?^ *```$", "", page.read_text("utf-8"), flags=re.DOTALL | re.MULTILINE
        )
        for name in re.findall(rf"`((?:{tops})/[\w./-]+)`", text):
            if not (ROOT / name).exists():
                missing.add((page.name, name))
    assert missing == set()


def names_in_all(package: str) -> set[str]:
    """The public names of a package or module."""
    folder = ROOT.joinpath(*package.split("."))
    path = folder / "__init__.py" if folder.is_dir() else folder.with_suffix(".py")
    tree = ast.parse(path.read_text("utf-8"))
    for node in tree.body:
        target = getattr(node, "target", None) or getattr(node, "targets", [None])[0]
        if target is not None and ast.unparse(target) == "__all__":
            return set(ast.literal_eval(node.value))  # type: ignore[attr-defined]
    return set()


def test_the_reference_holds_every_public_name() -> None:
    packages = [
        ".".join(path.parent.relative_to(ROOT).parts)
        for top in ("basetree", "calib", "edgetree", "fleet", "perceptree")
        for path in (ROOT / top).rglob("__init__.py")
    ]
    text = "".join(page.read_text("utf-8") for page in PAGES)
    shown = {
        name
        for package in re.findall(r"^<!-- api: ([\w.]+)", text, flags=re.MULTILINE)
        for name in names_in_all(package)
    }
    missing = {f"{package}.{name}" for package in packages for name in names_in_all(package)}
    assert {name for name in missing if name.rpartition(".")[2] not in shown} == set()


def test_the_picture_of_a_result_can_be_read_and_is_small() -> None:
    path = ROOT / "docs" / "images" / "measured.jpg"
    picture = cv2.imread(str(path))
    assert picture is not None
    assert picture.shape[1] >= 1000
    assert path.stat().st_size < 200_000
