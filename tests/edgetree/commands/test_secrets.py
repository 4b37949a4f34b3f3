"""Passwords and tokens that a command gets are in nothing that it prints, writes or answers."""

from __future__ import annotations

import http.client
import itertools
import json
import socket
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from basetree.program.setup_file import setup_keys
from calib import PinholeCamera
from edgetree.commands.live import live_command
from edgetree.commands.run import run

Cli = Callable[..., Any]

SECRET = "hunter2hunter2hunter2"
PIPELINE = f'rtspsrc location="rtsp://camera/1" user-id=forest user-pw={SECRET} ! appsink'
SOURCES = (
    f"rtsp://forest:{SECRET}@camera/1",
    f"rtsp//forest:{SECRET}@camera/1",  # misspelt, it is taken for a path
    f"http://127.0.0.1:1/video?user=forest&pwd={SECRET}",
    f"rtsp://127.0.0.1:1/user=forest_password={SECRET}_channel=1",
    PIPELINE,
)
_FORMS = (f"rtsp://forest:{SECRET}@camera:1/x", f"forest:{SECRET}@broker:1883")


def options(command: Callable[..., Any]) -> list[str]:
    """The options of a command that take a text or a path, those of lists among them."""
    keys = setup_keys(command).values()
    return [key.name for key in keys if key.kind in (str, Path) and key.name != "source"]


@pytest.mark.parametrize("form", _FORMS)
@pytest.mark.parametrize(("name", "command"), [("live", live_command), ("run", run)])
def test_no_option_shows_a_secret(
    run_cli: Cli,
    images: Path,
    monkeypatch: pytest.MonkeyPatch,
    name: str,
    command: Callable[..., Any],
    form: str,
) -> None:
    """Whether the option can use it or not, nothing that is printed has it."""
    monkeypatch.chdir(images.parent)  # where files of such names may be written
    for option in options(command):
        others = ("--model", "no.onnx") if option != "model" else ()
        done = run_cli(name, images, f"--{option}", form, *others)
        assert done.code, option  # at least the model is wrong
        assert SECRET not in done.out + done.err, option


@pytest.mark.parametrize("source", SOURCES)
@pytest.mark.parametrize("command", ["live", "run", "measure", "check", "check-rig"])
def test_no_source_shows_a_secret(run_cli: Cli, command: str, source: str) -> None:
    done = run_cli(command, source)
    assert done.code
    assert SECRET not in done.out + done.err


@pytest.mark.parametrize(
    "line",
    [
        f'token = "{SECRET}"',
        f'token = ["{SECRET}"]',
        *(f"source = {json.dumps(source)}" for source in SOURCES),
        f'mqtt = "forest:{SECRET}@broker"',
    ],
)
def test_no_set_up_file_shows_a_secret(run_cli: Cli, tmp_path: Path, line: str) -> None:
    setup = tmp_path / "edgetree.toml"
    setup.write_text(f"{line}\n")
    for command in (("config", "show", setup), ("config", "check", setup)):
        done = run_cli(*command)
        assert SECRET not in done.out + done.err


class Camera:
    """A camera that answers, and is lost after some frames."""

    def __init__(self, *_: object) -> None:
        self.left = 4

    def isOpened(self) -> bool:
        return True

    def read(self) -> tuple[bool, np.ndarray | None]:
        time.sleep(0.05)
        self.left -= 1
        return (True, np.zeros((480, 640, 3), np.uint8)) if self.left >= 0 else (False, None)

    def release(self) -> None:
        pass


@pytest.fixture
def unused_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@pytest.fixture
def answers(unused_port: int) -> Iterator[list[str]]:
    """What the page of a service answers while it runs, head and body."""
    found: list[str] = []
    paths = ("healthz", "readyz", "metrics", "version", "stems.json", "")
    is_over = threading.Event()

    def ask() -> None:
        for path in itertools.cycle(paths):
            address = f"http://127.0.0.1:{unused_port}/{path}"
            allowed = {"Authorization": f"Bearer {SECRET}"} if path else {}
            try:
                with urllib.request.urlopen(
                    urllib.request.Request(address, headers=allowed)
                ) as got:
                    found.append(f"{got.headers}{got.read().decode()}")
            except urllib.error.HTTPError as error:
                found.append(f"{error.headers}{error.read().decode()}")
            except (OSError, http.client.HTTPException):
                pass
            if is_over.wait(0.02):
                return

    asking = threading.Thread(target=ask)
    asking.start()
    yield found
    is_over.set()
    asking.join()


@pytest.mark.parametrize("source", [SOURCES[0], SOURCES[2], PIPELINE])
def test_a_service_shows_no_secret(
    run_cli: Cli,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    model: Path,
    answers: list[str],
    unused_port: int,
    source: str,
) -> None:
    """Neither on the terminal, in its log, files and recordings, nor in what its page answers."""
    pytest.importorskip("rosbags")
    monkeypatch.setattr(cv2, "VideoCapture", Camera)
    monkeypatch.setattr(cv2.videoio_registry, "hasBackend", lambda _: True)
    written = ("jsonl", "csv", "report", "bag", "record", "log-file")
    outputs = [(f"--{name}", tmp_path / f"{name}.html") for name in written]
    camera = tmp_path / "camera.json"
    camera.write_text(json.dumps(PinholeCamera(640, 480, 400.0, 400.0, 319.5, 239.5).to_dict()))
    heights = ("--camera", camera, "--camera-height", "1.6", "--up", "0,-1,0")
    page = ("--page", "--port", unused_port, "--token", SECRET)
    done = run_cli(
        *("live", source, "--model", model, "--record-all", "--frames", 8, "--verbose"),
        *heights,
        *page,
        *itertools.chain(*outputs),
    )
    assert done.code == 0, done.err
    assert "?token=..." in done.err
    assert "lost" in done.err
    files = [file for file in tmp_path.rglob("*") if file.is_file()]
    assert {name for name in written if (tmp_path / f"{name}.html").exists()} == set(written)
    texts = [done.out, done.err, *answers, *(file.read_bytes().decode("latin-1") for file in files)]
    assert len(answers) > len(files)
    assert not [text for text in texts if SECRET in text]
