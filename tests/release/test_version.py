"""What a version says of itself agrees, and the forms of the issues can be read."""

import re
import tomllib
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
FORMS = sorted((ROOT / ".github/ISSUE_TEMPLATE").glob("*.yml"))


def test_project_changelog_and_citation_name_one_version() -> None:
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text("utf-8"))
    changelog = (ROOT / "CHANGELOG.md").read_text("utf-8")
    found = re.search(r"^## \[(\d[^\]]*)\] - (\S+)$", changelog, flags=re.MULTILINE)
    assert found is not None
    assert PROJECT["version"] == cited["version"] == found[1]
    assert str(cited["date-released"]) == found[2]
    assert cited["license"] == PROJECT["license"]
    assert cited["references"][0]["url"] == PROJECT["urls"]["Paper"]


def test_the_supported_pythons_are_those_that_are_tested() -> None:
    listed = [line.rpartition(" :: ")[2] for line in PROJECT["classifiers"] if "3." in line]
    script = (ROOT / ".ci/other_pythons").read_text("utf-8")
    assert f"for version in {' '.join(listed)}; do" in script
    assert "bash .ci/other_pythons" in (ROOT / ".ci/run").read_text("utf-8").splitlines()


@pytest.mark.parametrize("path", FORMS, ids=lambda path: path.stem)
def test_a_form_asks_for_what_is_needed(path: Path) -> None:
    form = yaml.safe_load(path.read_text("utf-8"))
    if path.stem == "config":
        return
    assert form["name"]
    assert form["description"]
    asked = [each for each in form["body"] if each["type"] != "markdown"]
    assert asked
    ids = [each["id"] for each in asked]
    assert len(set(ids)) == len(ids)
    assert all(each["attributes"]["label"] for each in asked)


def test_there_is_a_form_for_each_kind_of_issue() -> None:
    expected = {"camera-file", "crash", "question", "wrong-measurement"}
    assert expected <= {path.stem for path in FORMS}
