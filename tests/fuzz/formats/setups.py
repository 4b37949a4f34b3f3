"""Set-up files of `edgetree live`, and the passwords that they name."""

from __future__ import annotations

from pathlib import Path

from basetree.program.setup_file import SetupFile, read_setup
from edgetree.commands.live import live
from edgetree.sinks.mqtt_settings import MqttSettings
from formats.form import Format

_SETUP = b"""# The crane camera
source = "realsense"
model = "depth"
score-threshold = 0.5
topic = ["colour=/camera", "depth=/depth"]
page = true
port = 8420
mqtt = "broker.local:8883"
"up" = '0,-1,0'
"""


def _read(path: Path) -> SetupFile:
    return read_setup(path, live)


def _password(path: Path) -> str | None:
    return MqttSettings(user="edgetree", password_file=path).password()


FORMATS = {
    "password": Format((b"secret\n",), _password),
    "set-up": Format((_SETUP, b'source = "a"\nmap-origin = """60,\n24"""\n'), _read),
}
