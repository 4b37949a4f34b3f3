"""Results for controllers: UDP datagrams and MQTT messages."""

import json
import logging
import socket
import sys
import time
import types

import pytest

from basetree.errors import InputError, MissingPackage
from edgetree.measure import Failure
from edgetree.results import STEMS_SCHEMA, stems_message
from edgetree.sinks import MqttSink, UdpSink


@pytest.fixture
def receiver():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.bind(("127.0.0.1", 0))
        one.settimeout(5)
        yield one


def test_each_frame_is_one_datagram(receiver, live_result) -> None:
    sink = UdpSink(f"127.0.0.1:{receiver.getsockname()[1]}")
    for number in (1, 2):
        sink.write(live_result(number, cut_height_m=Failure("hidden")))
        message = json.loads(receiver.recv(65536))
        assert (message["schema"], message["frame"]) == (STEMS_SCHEMA, number)
    sink.close()
    stem = message["stems"][0]
    assert stem["position_camera_m"] == [-0.5, 1.6, 3.0]
    assert (stem["track"], stem["in_view"], stem["state"]) == (1, True, "confirmed")
    assert (stem["diameter_m"], stem["diameter_std_m"]) == (0.211, 0.006)
    assert (stem["cut_height_m"], stem["cut_height_std_m"]) == (None, None)
    assert sink.lost == 0


@pytest.mark.parametrize("stems", [0, 1, 5, 12, 150])
@pytest.mark.parametrize("max_bytes", [256, 700, 1400, 65_507])
def test_a_message_never_exceeds_its_limit_and_counts_what_is_left_out(
    live_result, stems: int, max_bytes: int
) -> None:
    content = stems_message(live_result(stems=stems), max_bytes)
    message = json.loads(content)
    numbers = [stem["track"] for stem in message["stems"]]
    assert len(content) <= max_bytes
    assert numbers == list(range(1, len(numbers) + 1))  # the nearest ones
    assert message["left_out"] == stems - len(numbers)
    if message["left_out"]:
        assert len(content) > max_bytes - 250  # and another one would not fit


def test_a_datagram_that_cannot_be_sent_is_counted_and_logged_once(
    live_result, caplog: pytest.LogCaptureFixture
) -> None:
    sink = UdpSink("255.255.255.255:9")  # a broadcast, which the system forbids
    with caplog.at_level(logging.WARNING):
        for _ in range(3):
            sink.write(live_result())
    assert sink.lost == 3
    assert [record.getMessage().startswith("a datagram") for record in caplog.records] == [True]


@pytest.mark.parametrize(
    "address", ["", "machine", "1.2.3.4:", "1.2.3.4:0", "1.2.3.4:70000", "a b:1", "http://x:1"]
)
def test_an_address_without_host_and_port_is_refused(address: str) -> None:
    with pytest.raises(InputError, match="expected HOST:PORT"):
        UdpSink(address)


def test_limits_and_names_that_cannot_be_used_are_refused() -> None:
    with pytest.raises(InputError, match="max_bytes is 100"):
        UdpSink("127.0.0.1:9000", max_bytes=100)
    with pytest.raises(InputError, match=r"no-such-machine\.invalid"):
        UdpSink("no-such-machine.invalid:9000")


class FakeInfo:
    """paho's MQTTMessageInfo: an error code, and whether the message has left."""

    def __init__(self) -> None:
        self.rc, self.left = 0, True

    def is_published(self) -> bool:
        if self.rc > 0:
            raise RuntimeError("not sent")
        return self.left


class FakeClient:
    """paho's client of version 2, as documented."""

    def __init__(self, version: object) -> None:
        assert version == "version 2"
        self.calls: list[object] = []
        self.connected = True
        self.infos: list[FakeInfo] = []

    def username_pw_set(self, name: str, password: str | None) -> None:
        self.calls.append(("user", name, password))

    def connect_async(self, host: str, port: int) -> None:
        self.calls.append(("connect", host, port))

    def loop_start(self) -> None:
        self.calls.append("start")

    def is_connected(self) -> bool:
        return self.connected

    def publish(self, topic: str, payload: bytes, qos: int) -> FakeInfo:
        self.calls.append((topic, json.loads(payload)["frame"], qos))
        self.infos.append(FakeInfo())
        return self.infos[-1]

    def disconnect(self) -> None:
        self.calls.append("disconnect")

    def loop_stop(self) -> None:
        self.calls.append("stop")


@pytest.fixture
def paho(monkeypatch: pytest.MonkeyPatch) -> list[FakeClient]:
    made: list[FakeClient] = []
    module = types.ModuleType("paho.mqtt.client")
    module.Client = lambda version: made.append(FakeClient(version)) or made[-1]
    module.CallbackAPIVersion = types.SimpleNamespace(VERSION2="version 2")
    package = types.ModuleType("paho.mqtt")
    package.client = module
    monkeypatch.setitem(sys.modules, "paho", types.ModuleType("paho"))
    monkeypatch.setitem(sys.modules, "paho.mqtt", package)
    monkeypatch.setitem(sys.modules, "paho.mqtt.client", module)
    return made


def test_messages_go_to_the_topic(paho: list[FakeClient], live_result) -> None:
    sink = MqttSink("broker.local", "wood/stems", username="cab", password="secret")
    sink.write(live_result(4))
    sink.close()
    assert paho[0].calls == [
        ("user", "cab", "secret"),
        ("connect", "broker.local", 1883),
        "start",
        ("wood/stems", 4, 0),
        "disconnect",
        "stop",
    ]


def test_messages_are_lost_not_queued_while_the_broker_is_away_or_slow(
    paho: list[FakeClient], live_result
) -> None:
    sink = MqttSink("10.0.0.1:1884")
    client = paho[0]
    client.connected = False
    sink.write(live_result(1))
    client.connected = True
    sink.write(live_result(2))
    client.infos[-1].left = False
    sink.write(live_result(3))
    client.infos[-1].rc = 7  # the connection was lost: this one never leaves
    sink.write(live_result(4))
    assert [call[1] for call in client.calls if call[0] == "edgetree/stems"] == [2, 4]
    assert sink.lost == 2


@pytest.mark.parametrize("topic", ["", "a/#", "+/b"])
def test_a_topic_with_wildcards_is_refused(paho: list[FakeClient], topic: str) -> None:
    with pytest.raises(InputError, match="the topic is"):
        MqttSink("10.0.0.1", topic)


def test_without_the_package_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "paho", None)
    with pytest.raises(MissingPackage, match="mqtt"):
        MqttSink("10.0.0.1")


def test_writing_a_datagram_never_waits(live_result) -> None:
    sink = UdpSink("127.0.0.1:9")  # nobody listens there
    result = live_result(stems=20)
    start = time.monotonic()
    for _ in range(100):
        sink.write(result)
    sink.close()
    assert time.monotonic() - start < 2
