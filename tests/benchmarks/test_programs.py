"""Every program of `benchmarks` and `release` starts, and says how it is run."""

import argparse
import importlib
import json
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
# They run in the environments of other projects.
ELSEWHERE = ("export_libreyolo", "export_rfdetr", "export_ultralytics", "run_openvino")
PROGRAMS = sorted(
    path.relative_to(ROOT).with_suffix("").as_posix().replace("/", ".")
    for folder in ("benchmarks", "release")
    for path in (ROOT / folder).rglob("*.py")
    if "def main()" in path.read_text("utf-8") and path.stem not in ELSEWHERE
)


def test_there_are_programs() -> None:
    assert {"benchmarks.measure", "benchmarks.peers.measure", "release.make"} <= set(PROGRAMS)


@pytest.mark.parametrize("name", PROGRAMS)
def test_a_program_starts(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", [name, "--help"])
    with pytest.raises(SystemExit) as ended:
        importlib.import_module(name).main()
    assert ended.value.code == 0
    assert "usage:" in capsys.readouterr().out


@pytest.mark.parametrize("name", PROGRAMS)
def test_a_program_tells_its_own_command(
    name: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The command at the top names the program, with options that it has."""
    module = importlib.import_module(name)
    text = (module.__doc__ or "").replace("\\\n", " ")
    told = re.findall(r"^python -m ([\w.]+) ?(.*)$", text, flags=re.MULTILINE)
    if not told:
        assert ".peers." in name, "only what the benchmark of peers runs may not tell"
        return
    known: set[str] = set()
    add = argparse.ArgumentParser.add_argument

    def noted(self: argparse.ArgumentParser, *flags: str, **more: object) -> object:
        known.update(flags)
        return add(self, *flags, **more)  # type: ignore[arg-type]

    monkeypatch.setattr(argparse.ArgumentParser, "add_argument", noted)
    monkeypatch.setattr("sys.argv", [name, "--help"])
    with pytest.raises(SystemExit):
        module.main()
    called = name.removesuffix(".__main__")
    assert called in {module for module, _ in told}
    own = " ".join(words for module, words in told if module == called)
    assert set(re.findall(r"(?<!\S)\[?(--[\w-]+)", own)) <= known


@pytest.mark.parametrize(
    "path", sorted((ROOT / "benchmarks" / "results").glob("*.json")), ids=lambda path: path.stem
)
def test_a_stored_result_can_be_read(path: Path) -> None:
    assert json.loads(path.read_text("utf-8"))
