"""Results and states for controllers at an MQTT broker, on its wire and with a real mosquitto."""

from __future__ import annotations

import json
import logging
import shutil
import socket
import ssl
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from mqtt_broker import Broker, Certificates, make_certificates

from basetree.errors import InputError, InputFileError, MissingPackage
from edgetree.results import STEMS_SCHEMA
from edgetree.results.service_state import STATE_SCHEMA, ServiceState
from edgetree.sinks import MqttSettings, MqttSink, mqtt

STEMS, STATE = "edgetree/stems", "edgetree/state"
RUNNING = ServiceState("running", "", 10.0, 1)
LOST = ServiceState("camera lost", "camera 0 is gone", 11.0, 9)


@pytest.fixture
def broker() -> Iterator[Broker]:
    one = Broker()
    yield one
    one.close()


@pytest.fixture
def certificates(tmp_path: Path) -> Certificates:
    pytest.importorskip("cryptography")
    return make_certificates(tmp_path / "pem")


@pytest.fixture
def connected() -> Iterator[Any]:
    """A function that makes a sink that is connected to a broker."""
    pytest.importorskip("paho")
    made: list[MqttSink] = []

    def make(broker: Broker, settings: MqttSettings | None = None) -> MqttSink:
        made.append(MqttSink(f"127.0.0.1:{broker.port}", settings))
        broker.wait(lambda: made[-1]._client.is_connected())
        return made[-1]

    yield make
    for sink in made:
        sink.close()


def test_stems_and_states_have_their_topics(broker: Broker, connected, live_result) -> None:
    sink = connected(broker, MqttSettings(topic="wood/stems", state_topic="wood/state", qos=1))
    sink.tell(RUNNING)
    sink.tell(RUNNING)
    sink.write(live_result(4))
    broker.wait(lambda: len(broker.messages) == 2)
    state, stems = broker.messages
    assert (state.topic, state.retain) == ("wood/state", True)
    assert json.loads(state.content)["state"] == "running"
    assert (stems.topic, stems.qos, stems.retain) == ("wood/stems", 1, False)
    record = json.loads(stems.content)
    assert (record["schema"], record["frame"], record["sequence"]) == (STEMS_SCHEMA, 4, 1)
    assert sink.lost == 0


def test_the_broker_gets_a_will(broker: Broker, connected) -> None:
    connected(broker)
    will = broker.connects[0].will
    assert will is not None
    assert (will.topic, will.qos, will.retain) == (STATE, 1, True)
    record = json.loads(will.content)
    assert (record["schema"], record["state"], record["since"]) == (STATE_SCHEMA, "gone", None)


def test_the_last_state_leaves_before_the_end(broker: Broker, connected) -> None:
    sink = connected(broker)
    sink.tell(ServiceState("stopping", "", 12.0, 9))
    sink.close()
    broker.wait(lambda: broker.of(STATE))
    assert json.loads(broker.of(STATE)[-1].content)["state"] == "stopping"


def test_the_password_comes_from_a_file(broker: Broker, connected, tmp_path: Path) -> None:
    (tmp_path / "password").write_text("sésame\nmore\n", encoding="utf-8")
    connected(broker, MqttSettings(user="cab", password_file=tmp_path / "password"))
    assert broker.connects[0][:2] == ("cab", "sésame")


def test_a_broker_that_goes_and_comes_back_gets_the_state_of_now(
    connected, live_result, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = Broker()
    sink = connected(first)
    sink.tell(RUNNING)
    first.wait(lambda: first.of(STATE))
    with caplog.at_level(logging.WARNING):
        first.close()
        first.wait(lambda: not sink._client.is_connected())
        sink.tell(LOST)
        sink.write(live_result(5))
        assert sink.lost == 1
        again = Broker(first.port)
        try:
            again.wait(lambda: again.of(STATE))
            sink.write(live_result(6))
            again.wait(lambda: again.of(STEMS))
        finally:
            again.close()
    assert json.loads(again.of(STATE)[0].content)["state"] == "camera lost"
    assert [json.loads(each.content)["frame"] for each in again.of(STEMS)] == [6]
    told = [record.getMessage() for record in caplog.records]
    assert sum("is gone" in line for line in told) >= 1
    assert sum("is back" in line for line in told) == 1


def test_a_broker_that_refuses_is_told_once(caplog: pytest.LogCaptureFixture) -> None:
    pytest.importorskip("paho")
    broker = Broker(return_code=5)
    with caplog.at_level(logging.WARNING):
        sink = MqttSink(f"127.0.0.1:{broker.port}")
        broker.wait(lambda: len(broker.connects) > 1)
        sink.close()
        broker.close()
    told = [record.getMessage() for record in caplog.records]
    assert sum("refuses the connection (Not authorized)" in line for line in told) == 1


def test_messages_are_lost_not_queued_while_the_broker_is_slow(
    broker: Broker, connected, live_result, monkeypatch: pytest.MonkeyPatch
) -> None:
    sink = connected(broker)
    sink.write(live_result(1))
    broker.wait(lambda: broker.of(STEMS))
    monkeypatch.setattr(type(sink._last), "is_published", lambda info: False)
    sink.write(live_result(2))
    sink._last.rc = 7  # the connection was lost: this one never leaves
    sink.write(live_result(3))
    broker.wait(lambda: len(broker.of(STEMS)) == 2)
    records = [json.loads(each.content) for each in broker.of(STEMS)]
    assert [(each["frame"], each["sequence"]) for each in records] == [(1, 1), (3, 3)]
    assert sink.lost == 1


def test_the_connection_is_encrypted_and_both_sides_are_known(
    connected, certificates: Certificates, live_result
) -> None:
    broker = Broker(context=certificates.server_context(asks_client=True))
    settings = MqttSettings(
        ca=certificates.ca, certificate=certificates.client, key=certificates.client_key
    )
    try:
        sink = connected(broker, settings)
        sink.write(live_result(3))
        broker.wait(lambda: broker.of(STEMS))
    finally:
        broker.close()


def test_a_broker_of_another_authority_is_not_trusted(
    certificates: Certificates, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    pytest.importorskip("paho")
    others = make_certificates(tmp_path / "others")
    broker = Broker(context=certificates.server_context())
    with caplog.at_level(logging.WARNING):
        sink = MqttSink(f"127.0.0.1:{broker.port}", MqttSettings(ca=others.ca))
        broker.wait(lambda: "cannot be reached" in caplog.text)
        sink.close()
        broker.close()
    assert "certificate" in caplog.text
    assert broker.connects == []


def test_the_port_of_encrypted_connections_is_another(
    certificates: Certificates, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("paho")
    monkeypatch.setattr(mqtt.MqttSink, "close", lambda sink: sink._client.loop_stop())
    for settings, port in ((MqttSettings(), 1883), (MqttSettings(ca=certificates.ca), 8883)):
        sink = MqttSink("127.0.0.1", settings)
        assert sink._client._port == port
        sink._client.disconnect()
        sink.close()


MISTAKES = {
    "no topic": ({"topic": ""}, "--mqtt-topic is ''"),
    "wildcard": ({"topic": "a/#"}, "--mqtt-topic is 'a/#': expected a name without"),
    "state topic": ({"state_topic": "+/b"}, r"--mqtt-state-topic is '\+/b'"),
    "same topics": ({"topic": "a", "state_topic": "a"}, "expected two topics"),
    "quality": ({"qos": 3}, "--mqtt-qos is 3: expected 0 to 2"),
    "password alone": ({"password_file": Path("p")}, "given without --mqtt-user"),
    "key alone": ({"key": Path("k")}, "given without --mqtt-certificate"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_settings_that_cannot_be_used_are_refused(mistake: str) -> None:
    values, message = MISTAKES[mistake]
    with pytest.raises(InputError, match=message):
        MqttSettings(**values)


def test_files_that_cannot_be_used_are_named(tmp_path: Path) -> None:
    empty, missing = tmp_path / "empty", tmp_path / "missing"
    empty.write_text("\n")
    user = {"user": "cab"}
    with pytest.raises(InputFileError, match="empty: the first line is empty"):
        MqttSettings(**user, password_file=empty).password()
    with pytest.raises(InputFileError, match="missing: no such file, expected a password"):
        MqttSettings(**user, password_file=missing).password()
    for path, reason in ((empty, "not such a file"), (missing, "No such file")):
        with pytest.raises(InputFileError, match=rf"{path.name}: cannot be used \({reason}"):
            MqttSettings(ca=path).tls_context()
        with pytest.raises(InputFileError, match=rf"{path.name}: cannot be used \({reason}"):
            MqttSettings(certificate=path).tls_context()


def test_an_encrypted_connection_checks_the_brokers_name(certificates: Certificates) -> None:
    for settings in (MqttSettings(tls=True), MqttSettings(ca=certificates.ca)):
        context = settings.tls_context()
        assert context is not None
        assert context.check_hostname
        assert context.verify_mode is ssl.CERT_REQUIRED
    assert MqttSettings().tls_context() is None


def test_without_the_package_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "paho.mqtt", None)
    with pytest.raises(MissingPackage, match="mqtt"):
        MqttSink("10.0.0.1")


def free_port() -> int:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


@pytest.fixture
def mosquitto(tmp_path: Path, certificates: Certificates) -> Iterator[tuple[int, Path]]:
    """A mosquitto that asks for certificate and password: its port, and the password's file."""
    pytest.importorskip("paho")
    program, tool = shutil.which("mosquitto"), shutil.which("mosquitto_passwd")
    if program is None or tool is None:
        pytest.skip("mosquitto is not installed")
    port, password = free_port(), tmp_path / "password"
    password.write_text("sesame\n")
    subprocess.run([tool, "-b", "-c", tmp_path / "users", "cab", "sesame"], check=True)
    (tmp_path / "mosquitto.conf").write_text(
        f"listener {port} 127.0.0.1\nallow_anonymous false\npassword_file {tmp_path}/users\n"
        f"cafile {certificates.ca}\ncertfile {certificates.server}\nkeyfile {certificates.server}\n"
        "require_certificate true\nuser root\n"
    )
    process = subprocess.Popen([program, "-c", tmp_path / "mosquitto.conf"])
    for _ in range(200):
        with socket.socket() as one:
            if one.connect_ex(("127.0.0.1", port)) == 0:
                break
        time.sleep(0.05)
    yield port, password
    process.kill()
    process.wait()


def test_a_real_broker_keeps_the_state_and_publishes_the_will(
    mosquitto: tuple[int, Path], certificates: Certificates, live_result
) -> None:
    from paho.mqtt import client as paho

    port, password = mosquitto
    settings = MqttSettings(
        qos=1,
        user="cab",
        password_file=password,
        ca=certificates.ca,
        certificate=certificates.client,
        key=certificates.client_key,
    )
    sink = MqttSink(f"127.0.0.1:{port}", settings)
    sink.tell(RUNNING)
    got: list[Any] = []
    watcher = paho.Client(paho.CallbackAPIVersion.VERSION2)
    watcher.username_pw_set("cab", "sesame")
    watcher.tls_set_context(settings.tls_context())
    watcher.on_connect = lambda client, *_: client.subscribe("edgetree/#", 1)
    watcher.on_message = lambda client, data, message: got.append(message)

    def wait(happened) -> None:
        end_s = time.monotonic() + 20
        while not happened():
            assert time.monotonic() < end_s, [(each.topic, each.payload) for each in got]
            time.sleep(0.02)

    wait(sink._client.is_connected)
    time.sleep(0.2)
    watcher.connect("127.0.0.1", port)
    watcher.loop_start()
    wait(lambda: got)
    assert (got[0].topic, got[0].retain) == (STATE, True)
    assert json.loads(got[0].payload)["state"] == "running"
    sink.write(live_result(7))
    wait(lambda: len(got) > 1)
    assert (got[1].topic, got[1].qos, json.loads(got[1].payload)["frame"]) == (STEMS, 1, 7)
    sink._client._sock.shutdown(socket.SHUT_RDWR)  # as if the process was killed
    wait(lambda: len(got) > 2)
    assert json.loads(got[2].payload)["state"] == "gone"
    wait(lambda: len(got) > 3)  # it connects again, and says how it goes
    assert json.loads(got[3].payload)["state"] == "running"
    watcher.disconnect()
    watcher.loop_stop()
    sink.close()
