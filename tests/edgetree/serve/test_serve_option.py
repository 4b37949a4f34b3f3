"""`edgetree live --serve`: frames of other programs, and results of other sources."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from edgetree.errors import ServiceError
from edgetree.frames.frame import Frame
from edgetree.serve import Client

Cli = Callable[..., Any]


@pytest.fixture
def address(tmp_path: Path) -> str:
    pytest.importorskip("zmq")
    return f"ipc://{tmp_path}/service"


def test_programs_hand_frames_over(
    run_cli: Cli, model: Path, address: str, make_frame: Callable[..., Frame], tmp_path: Path
) -> None:
    got: list[dict[str, Any]] = []

    def hand_over() -> None:
        with Client(address, timeout_s=20) as client:
            with pytest.raises(ServiceError, match="left out: without colour"):
                client.measure(make_frame(image=None))
            got.extend(client.measure(make_frame(number)) for number in range(3))

    program = threading.Thread(target=hand_over)
    program.start()
    lines = tmp_path / "a.jsonl"
    command = ("live", "clients", "--serve", address, "--model", model, "--jsonl", lines)
    done = run_cli(*command, "--frames", 3)
    program.join()
    assert done.code == 0, done.err
    assert f"service: {address}" in done.err
    records = [json.loads(line) for line in lines.read_text("utf-8").splitlines()]
    written = [each for each in records if each["schema"] == "edgetree.live/1"]
    assert got == written


def test_results_of_other_sources_are_watched(
    run_cli: Cli, model: Path, address: str, images: Path
) -> None:
    got: list[dict[str, Any]] = []

    def watch() -> None:
        with Client(address, timeout_s=20) as client:
            for record in client.watch():
                got.append(record)
                return

    program = threading.Thread(target=watch)
    program.start()
    done = run_cli("live", images, "--loop", "--serve", address, "--model", model, "--frames", 300)
    program.join(60)
    assert done.code == 0, done.err
    assert done.out == ""
    assert got[0]["schema"] == "edgetree.live/1"


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ((), "the source is clients without --serve"),
        (("--serve", "tcp://0.0.0.0:8430"), "expected tcp://127.0.0.1:PORT or ipc://FILE"),
        (("--serve", "{address}", "--loop"), "loop is given for source clients"),
        (("--serve", "{address}", "--depth-scale", "0.001"), "depth_scale_m is given for source"),
        (("--serve", "ipc:///no/such/folder/a"), "the service cannot listen at"),
    ],
)
def test_mistakes_are_one_line(
    run_cli: Cli, model: Path, address: str, options: tuple[str, ...], expected: str
) -> None:
    given = [option.format(address=address) for option in options]
    done = run_cli("live", "clients", "--model", model, *given)
    assert done.code == 2
    assert expected in done.err
    assert done.err.strip().splitlines()[-1].count(expected) == 1


def test_a_missing_package_is_named(
    run_cli: Cli, model: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "zmq", None)
    done = run_cli("live", "clients", "--serve", "tcp://127.0.0.1:0", "--model", model)
    assert (done.code, done.err.count("\n")) == (2, 1)
    assert "pyzmq: pip install" in done.err
