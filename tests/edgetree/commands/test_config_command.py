"""`edgetree live --config` and `edgetree config`."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import typer

from basetree.program.setup_file import setup_keys
from edgetree.commands.live import live_command

Cli = Callable[..., Any]


@pytest.fixture
def setup(images: Path, model: Path) -> Path:
    """A set-up file beside the folder of images, with a line for each setting."""
    path = images.parent / "edgetree.toml"
    path.write_text(
        'source = "./images"\ndepth = "depth"\ncamera = "camera.json"\n'
        f'model = "{model}"\njsonl = "trees.jsonl"\n'
    )
    return path


def test_a_run_by_a_file_is_the_run_by_options(
    run_cli: Cli, setup: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    done = run_cli("live", "--config", setup)
    assert done.code == 0, done.err
    lines = (setup.parent / "trees.jsonl").read_text().splitlines()
    second = json.loads(lines[1])
    assert second["trees"][0]["metres"]["distance_m"] == pytest.approx(4.75, abs=0.1)


@pytest.mark.parametrize("name", ["images", "clients", "realsense", "0"])
def test_a_source_is_beside_the_file_unless_its_name_is_that_of_a_camera(
    run_cli: Cli, setup: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, name: str
) -> None:
    (setup.parent / name).mkdir(exist_ok=True)
    setup.write_text(f'source = "{name}"\n')
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    shown = run_cli("config", "show", setup).out.splitlines()
    found = str(setup.parent / name) if name == "images" else name
    assert f'source = "{found}"' in shown


def test_typed_options_override_the_file(run_cli: Cli, setup: Path, tmp_path: Path) -> None:
    done = run_cli(
        "live", setup.parent / "images" / "a.jpg", "--config", setup, "--jsonl", tmp_path / "b"
    )
    assert done.code == 2  # a picture's depth is a picture
    done = run_cli("live", "--config", setup, "--jsonl", tmp_path / "b", "--frames", "1")
    assert done.code == 0, done.err
    assert len((tmp_path / "b").read_text().splitlines()) == 1
    assert not (setup.parent / "trees.jsonl").exists()


def test_every_option_of_live_is_a_setting() -> None:
    app = typer.Typer(add_completion=False)
    app.command()(live_command)
    options = {
        name.removeprefix("--")
        for parameter in typer.main.get_command(app).params
        for name in parameter.opts
        if not re.fullmatch("-[a-z]", name)
    }
    assert options - {"config", "help"} == set(setup_keys(live_command))


def test_a_valid_file_is_said_to_be_valid(run_cli: Cli, setup: Path) -> None:
    done = run_cli("config", "check", setup)
    assert (done.code, done.err) == (0, "")
    assert done.out == f"{setup}: 5 settings, all valid\n"


MISTAKES = {
    "value": ("threads = 0", "line 6: threads is 0: expected at least 1"),
    "file": ('mounting = "none.json"', "line 6: .*none.json"),
    "origin": ('map-origin = "60,24"', "line 6: --map-origin given without --map"),
    "origin value": ('map-origin = "95,24"\nmap = "a.geojson"', "line 6: --map-origin: latitude"),
    "ending": ('\nmap = "a.shp"', r"line 7: the map \(--map\) is .*a.shp"),
    "port": ("port = 70000", "line 6: --port of the page is 70000"),
    "topic": ('topic = ["blue=/a"]', "line 6: --topic is 'blue=/a'"),
    "mqtt alone": ('mqtt-user = "cab"', "line 6: --mqtt-user given without --mqtt"),
    "mqtt topic": ('mqtt = "b"\nmqtt-topic = "#"', "line 7: --mqtt-topic is '#'"),
    "quality": ('mqtt = "b"\nmqtt-qos = 7', "line 7: --mqtt-qos is 7: expected 0 to 2"),
    "password": (
        'mqtt = "b"\nmqtt-user = "u"\nmqtt-password-file = "none"',
        "line 8: .*none: no such file, expected a password",
    ),
    "broker": ('mqtt = "b:0"', "line 6: the address is 'b:0'"),
    "controller": ('udp = "cab"', "line 6: the address is 'cab': expected HOST:PORT"),
    "service": ('serve = "tcp://0.0.0.0:1"', "line 6: the address of the service is 'tcp://0"),
    "table": ('csv = "a"\ncsv-style = "exel"', "line 7: --csv-style is 'exel'"),
    "recording": ("record-all = true", "line 6: --record-all given without --record"),
    "authority": ('mqtt = "b"\nmqtt-ca = "images/a.jpg"', "line 7: .*a.jpg: cannot be used"),
}


@pytest.mark.parametrize("command", [("config", "check"), ("live", "--config")])
@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_one_line_that_names_file_and_line(
    run_cli: Cli, setup: Path, mistake: str, command: tuple[str, ...]
) -> None:
    text, message = MISTAKES[mistake]
    setup.write_text(setup.read_text() + text + "\n")
    if command[0] == "live" and mistake == "port":
        setup.write_text(setup.read_text() + "page = true\n")
    done = run_cli(*command, setup)
    assert (done.code, done.err.count("\n")) == (2, 1), done.err
    assert re.search(f"edgetree.toml {message}", done.err), done.err


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "line 1: the source is clients without --serve"),
        ('serve = "ipc:///run/a"\nloop = true\n', "line 1: loop is given for source clients"),
    ],
)
def test_what_does_not_fit_programs_as_the_source_is_told(
    run_cli: Cli, tmp_path: Path, text: str, message: str
) -> None:
    path = tmp_path / "a.toml"
    path.write_text(f'source = "clients"\n{text}')
    for command in (("config", "check"), ("live", "--config")):
        done = run_cli(*command, path)
        assert (done.code, done.err.count("\n")) == (2, 1)
        assert f"{path} {message}" in done.err


def test_a_file_says_where_messages_go(run_cli: Cli, setup: Path) -> None:
    setup.write_text(setup.read_text() + 'quiet = true\nlog-file = "live.log"\n')
    done = run_cli("live", "--config", setup, "--frames", "1")
    assert (done.code, done.err) == (0, "")
    assert "1 frame, " in (setup.parent / "live.log").read_text()


UNOPENED = {
    "model": ('model = "none.onnx"', "line 4: --model is .*none.onnx, which does not exist"),
    "model name": ('model = "edge-n-depht"', "line 4: no model is called .*mean edge-n-depth"),
    "source": ('source = "nodrive"', "line 1: --source is nodrive, which does not exist"),
    "depth": ('depth = "nodepth"', "line 2: --depth is .*nodepth, which does not exist"),
    "style": ('csv-style = "excel"', "line 6: --csv-style given without a CSV file"),
}


@pytest.mark.parametrize("mistake", UNOPENED)
def test_what_is_not_opened_is_checked_all_the_same(
    run_cli: Cli, setup: Path, mistake: str
) -> None:
    text, message = UNOPENED[mistake]
    key = text.split()[0]
    lines = setup.read_text().splitlines()
    kept = [text if line.startswith(f"{key} =") else line for line in lines]
    setup.write_text("\n".join(kept if text in kept else [*kept, text]) + "\n")
    done = run_cli("config", "check", setup)
    assert (done.code, done.err.count("\n")) == (2, 1), done.err
    assert re.search(f"edgetree.toml {message}", done.err), done.err


def test_a_folder_of_results_that_is_not_here_is_a_warning(run_cli: Cli, setup: Path) -> None:
    setup.write_text(setup.read_text() + 'csv = "/var/lib/none/stems.csv"\n')
    done = run_cli("config", "check", setup)
    assert (done.code, done.err.count("\n")) == (0, 1), done.err
    assert done.err.startswith("warning: csv is /var/lib/none/stems.csv, whose folder")
    assert done.out.endswith("all valid\n")


def test_a_file_without_source_is_told(run_cli: Cli, tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    path.write_text("page = true\n")
    done = run_cli("config", "check", path)
    assert (done.code, done.err.count("\n")) == (2, 1)
    assert "source is missing" in done.err
    done = run_cli("live", "--config", path)
    assert (done.code, done.err.count("\n")) == (2, 1)
    assert "SOURCE" in done.err


def test_all_settings_are_shown_and_secrets_are_not(run_cli: Cli, setup: Path) -> None:
    setup.write_text(setup.read_text() + 'token = "0123456789abcdef"\n')
    done = run_cli("config", "show", setup)
    assert done.code == 0
    assert "0123456789abcdef" not in done.out
    assert f'jsonl = "{setup.parent / "trees.jsonl"}"' in done.out.splitlines()
    shown = setup.parent / "shown.toml"
    shown.write_text(done.out)
    assert run_cli("config", "check", shown).out.endswith("5 settings, all valid\n")
    setup.write_text('source = "rtsp://forest:sec@ret@camera/1"\n')
    assert "ret@camera" not in run_cli("config", "show", setup).out
    defaults = run_cli("config", "show").out
    assert all(line.startswith("#") for line in defaults.splitlines() if line)
    assert "# mqtt-qos = 0" in defaults.splitlines()
