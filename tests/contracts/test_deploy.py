"""The files of `deploy` are valid, name what there is, and are what the guide says."""

from __future__ import annotations

import configparser
import os
import re
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest
import typer

from basetree.program.setup_file import read_setup
from edgetree.cli import app
from edgetree.commands.live import live
from edgetree.serve import Service

ROOT = Path(__file__).resolve().parents[2]
DEPLOY = ROOT / "deploy"
GUIDE = (ROOT / "docs" / "guides" / "machine.md").read_text("utf-8")
FILES = sorted(path.name for path in DEPLOY.iterdir())


def unit() -> configparser.ConfigParser:
    parser = configparser.ConfigParser(strict=True, interpolation=None)
    parser.optionxform = str
    parser.read(DEPLOY / "edgetree.service")
    return parser


def program(name: str) -> str:
    path = shutil.which(name)
    if path is None:
        pytest.skip(f"{name} is not installed")
    return path


def test_systemd_finds_no_fault_in_the_unit(tmp_path: Path) -> None:
    analyze = program("systemd-analyze")
    text = (DEPLOY / "edgetree.service").read_text("utf-8")
    # The program is looked for, so that one that is there stands in its place.
    text = text.replace("/opt/edgetree/current/bin/edgetree", "/bin/true")
    (tmp_path / "edgetree.service").write_text(text)
    done = subprocess.run(
        [analyze, "verify", "--man=no", tmp_path / "edgetree.service"],
        capture_output=True,
        text=True,
        check=False,
    )
    about = [line for line in done.stderr.splitlines() if "edgetree.service" in line]
    assert (done.returncode, about) == (0, []), done.stderr


def test_systemd_would_find_a_fault(tmp_path: Path) -> None:
    analyze = program("systemd-analyze")
    text = (DEPLOY / "edgetree.service").read_text("utf-8").replace("notify", "nonsense")
    (tmp_path / "edgetree.service").write_text(text.replace("/opt/edgetree/current", "/no"))
    done = subprocess.run(
        [analyze, "verify", "--man=no", tmp_path / "edgetree.service"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert "edgetree.service" in done.stderr


def test_the_unit_starts_a_command_that_there_is() -> None:
    words = shlex.split(unit()["Service"]["ExecStart"])
    assert Path(words[0]).name == "edgetree"
    command = typer.main.get_command(app).commands[words[1]]
    assert {"--config"} <= {name for each in command.params for name in each.opts}
    assert words[2:] == ["--config", "/etc/edgetree/edgetree.toml"]


def test_the_unit_restarts_by_the_exit_codes_of_live() -> None:
    service = unit()["Service"]
    assert service["Type"] == "notify"
    assert service["RestartPreventExitStatus"] == "2"
    assert service["SuccessExitStatus"] == "143"
    assert int(service["WatchdogSec"]) >= 10


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such rights of files")
def test_programs_of_the_group_may_connect_at_a_socket_and_no_others(tmp_path: Path) -> None:
    pytest.importorskip("zmq")
    before = os.umask(int(unit()["Service"]["UMask"], 8))
    try:
        with Service(f"ipc://{tmp_path}/service"):
            rights = (tmp_path / "service").stat().st_mode & 0o777
    finally:
        os.umask(before)
    assert rights & 0o066 == 0o060  # read and write: connecting needs both


def test_the_set_up_is_valid() -> None:
    text = (DEPLOY / "edgetree.toml").read_text("utf-8")
    assert read_setup(DEPLOY / "edgetree.toml", live).values["page"] is True
    opened = re.sub(r"^# ([\w-]+ = )", r"\1", text, flags=re.MULTILINE)
    assert opened != text
    keys = re.findall(r"^([\w-]+) = ", opened, flags=re.MULTILINE)
    from basetree.program.setup_file import setup_keys

    assert set(keys) <= set(setup_keys(live))


def test_results_are_where_the_service_may_write_and_are_rotated() -> None:
    setup = read_setup(DEPLOY / "edgetree.toml", live)
    results = Path(setup.values["jsonl"])
    folders = re.findall(r"^d (\S+)", (DEPLOY / "edgetree.tmpfiles").read_text(), re.MULTILINE)
    assert str(results.parent) in folders
    assert str(results) in (DEPLOY / "edgetree.logrotate").read_text()
    assert results.is_relative_to(f"/var/lib/{unit()['Service']['StateDirectory']}")


def test_tmpfiles_makes_the_folders(tmp_path: Path) -> None:
    tool = program("systemd-tmpfiles")
    text = (DEPLOY / "edgetree.tmpfiles").read_text().replace(" edgetree", " root")
    (tmp_path / "edgetree.conf").write_text(text)
    (tmp_path / "root").mkdir()
    subprocess.run(
        [tool, "--create", f"--root={tmp_path / 'root'}", tmp_path / "edgetree.conf"],
        check=True,
        capture_output=True,
    )
    assert (tmp_path / "root" / "var/lib/edgetree/recordings").is_dir()


def test_logrotate_takes_its_file(tmp_path: Path) -> None:
    tool = program("logrotate")
    (tmp_path / "results").mkdir()
    (tmp_path / "results" / "trees.jsonl").write_text("{}\n" * 10)
    text = (DEPLOY / "edgetree.logrotate").read_text().replace("/var/lib/edgetree", str(tmp_path))
    text = re.sub(r"^ *su .*\n", "", text, flags=re.MULTILINE)
    (tmp_path / "conf").write_text(text)
    done = subprocess.run(
        [tool, "--force", "--state", tmp_path / "state", tmp_path / "conf"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "results" / "trees.jsonl").read_text() == ""
    assert (tmp_path / "results" / "trees.jsonl.1").read_text() == "{}\n" * 10


@pytest.mark.parametrize("name", FILES)
def test_a_guide_installs_each_file_or_another_file_takes_it(name: str) -> None:
    guides = GUIDE + (ROOT / "docs" / "guides" / "container.md").read_text("utf-8")
    others = "".join(each.read_text("utf-8") for each in DEPLOY.iterdir() if each.name != name)
    installed = re.search(rf"(install .* |(?<![\w-])deploy/){re.escape(name)}(?![\w.])", guides)
    assert installed or f"/{name}" in others


def test_what_the_guide_says_of_the_unit_is_in_it() -> None:
    service, said = unit()["Service"], re.findall(r"`(\w+=[^`]+)`", GUIDE)
    lines = [line for line in said if line.partition("=")[0] in service]
    assert len(lines) >= 4
    assert [
        each for each in lines if service[each.partition("=")[0]] != each.partition("=")[2]
    ] == []
