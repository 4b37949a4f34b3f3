"""Results and states for controllers as UDP datagrams."""

import json
import logging
import socket
import time

import pytest
from schema_check import check_schema

from basetree.errors import InputError, Unavailable
from edgetree.measure import Failure
from edgetree.results import STEMS_SCHEMA, stems_message
from edgetree.results.service_state import STATE_SCHEMA, ServiceState
from edgetree.sinks import UdpSink


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


def test_datagrams_of_stems_and_states_are_numbered_together(receiver, live_result) -> None:
    sink = UdpSink(f"127.0.0.1:{receiver.getsockname()[1]}")
    lost = ServiceState("camera lost", "camera 0 is gone", 1.5, 4)
    sink.write(live_result(1))
    sink.tell(lost)
    sink.tell(lost)  # repeated, as a datagram may be lost
    sink.write(live_result(2))
    sink.close()
    messages = [json.loads(receiver.recv(65536)) for _ in range(4)]
    assert [each["sequence"] for each in messages] == [1, 2, 3, 4]
    assert [check_schema(each) for each in messages] == [
        *(STEMS_SCHEMA, STATE_SCHEMA, STATE_SCHEMA, STEMS_SCHEMA)
    ]
    assert messages[1]["state"] == "camera lost"
    assert messages[1]["since"] == "1970-01-01T00:00:01.500Z"


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
    with pytest.raises(Unavailable, match=r"no-such-machine\.invalid"):
        UdpSink("no-such-machine.invalid:9000")


def test_writing_a_datagram_never_waits(live_result) -> None:
    sink = UdpSink("127.0.0.1:9")  # nobody listens there
    result = live_result(stems=20)
    start = time.monotonic()
    for _ in range(100):
        sink.write(result)
    sink.close()
    assert time.monotonic() - start < 2
