"""The set-up commands and the pinned requirements are what the README promises."""

import re
import runpy
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text("utf-8")
REQUIREMENTS = {
    "runtime.txt": 15,
    "test.txt": 5,
    "sign.txt": 3,
    "record.txt": 5,
    "fleet.txt": 50,
    "sbom.txt": 20,
    "dev.txt": 80,
}


CI_COMMANDS = [
    line
    for line in (ROOT / ".ci" / "run").read_text("utf-8").splitlines()
    if line and not line.startswith("#")
]


def setup_commands() -> list[str]:
    """README lines that make an environment, in their order."""
    return [line for line in README.splitlines() if line.startswith("python3 -m venv ")]


def pins(name: str) -> dict[str, str]:
    """Package -> version of one requirements file."""
    text = (ROOT / "requirements" / name).read_text("utf-8")
    return dict(re.findall(r"^([a-z0-9._-]+)==([^ \\\n]+)", text, flags=re.MULTILINE))


def test_the_readme_has_two_setup_commands() -> None:
    first, second = setup_commands()
    assert "requirements/runtime.txt" in first
    assert first.endswith("edgetree demo")
    assert "requirements/dev.txt" in second
    assert second.endswith("/pytest -n auto --dist worksteal")


def test_continuous_integration_runs_the_readmes_second_command() -> None:
    assert setup_commands()[1] in CI_COMMANDS


def test_continuous_integration_holds_style_types_and_documentation() -> None:
    tools = ("ruff check .", "ruff format --check .", "mypy", "mkdocs build --strict")
    assert {f".venv-dev/bin/{tool}" for tool in tools} <= set(CI_COMMANDS)


def test_continuous_integration_ends_at_the_first_command_that_fails() -> None:
    # `set -e` does not see a failure before `&&`. The README's command is the one exception.
    joined = [line for line in CI_COMMANDS if "&&" in line and not line.startswith("cd ")]
    assert joined == [setup_commands()[1]]


def test_continuous_integration_runs_the_runtimes_tests_without_the_training_stack() -> None:
    base = [line for line in CI_COMMANDS if ".venv-base" in line]
    tests = next(place for place, line in enumerate(base) if "base_install" in line)
    installed = re.findall(r"install -r (\S+)", "\n".join(base[:tests]))
    assert installed == ["requirements/runtime.txt", "requirements/test.txt"]
    assert ".venv-base/bin/pip install --no-deps --no-build-isolation ." in base[:tests]
    assert any("cyclonedx-py environment" in line for line in base)
    assert {"tests/calib", "tests/edgetree"} <= set(base[tests].split())


def test_the_runtime_needs_no_training_stack() -> None:
    heavy = {"torch", "torchvision", "timm", "numba", "onnx", "onnxscript", "pycocotools"}
    assert (pins("runtime.txt").keys() | pins("test.txt").keys()) & heavy == set()
    assert heavy <= pins("dev.txt").keys()


def test_all_files_pin_the_same_versions() -> None:
    dev, base = pins("dev.txt"), pins("runtime.txt") | pins("test.txt")
    # Object stores need an older dateutil than the development environment has.
    fleet = {name: pin for name, pin in pins("fleet.txt").items() if name in base}
    assert {name: base[name] for name in fleet} == fleet
    for file in REQUIREMENTS.keys() - {"fleet.txt"}:
        # What only lists the packages has dependencies that nothing else needs.
        small = {name: pin for name, pin in pins(file).items() if file != "sbom.txt" or name in dev}
        assert {name: dev.get(name) for name in small} == small


def test_what_the_project_declares_is_pinned() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    extras = project["optional-dependencies"]
    declared = {
        re.split(r"[\[<>=;]", line)[0]
        for line in [*project["dependencies"], *extras["cpu"], *extras["dev"]]
    }
    assert declared - {"edgetree"} <= pins("dev.txt").keys()
    base = {re.split(r"[<>=]", line)[0] for line in [*project["dependencies"], *extras["cpu"]]}
    assert base <= pins("runtime.txt").keys()
    for extra in ("sign", "record", "fleet"):
        names = {re.split(r"[<>=]", line)[0] for line in extras[extra]}
        assert names <= pins(f"{extra}.txt").keys()


def test_the_page_of_systems_names_each_extra_that_cannot_be_installed_everywhere() -> None:
    missing = runpy.run_path(str(ROOT / ".ci" / "extras.py"))["MISSING"]
    page = (ROOT / "docs" / "reference" / "systems.md").read_text("utf-8")
    table = page.partition("## Extras\n")[2].partition("\n## ")[0]
    assert set(re.findall(r"(?m)^\| `(\w+)` \|", table)) == set(missing)


@pytest.mark.parametrize("name", REQUIREMENTS)
def test_every_requirement_is_hashed_and_no_index_is_named(name: str) -> None:
    text = (ROOT / "requirements" / name).read_text("utf-8")
    entries = re.split(r"\n(?=[a-z0-9])", text.strip())
    # A package may be pinned twice, for older and for newer Pythons.
    assert {entry.partition("==")[0] for entry in entries} == pins(name).keys()
    assert len(entries) >= REQUIREMENTS[name]
    assert [entry.split()[0] for entry in entries if "--hash=sha256:" not in entry] == []
    assert "://" not in text
    assert "--index-url" not in text
