"""The schema of the service's messages is that of the code, and holds for what is really sent."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import edgetree.serve
from edgetree.frames.frame import Frame
from edgetree.serve.messages import schema_text

FILE = Path(edgetree.serve.__file__).parent / "messages.schema.json"


def test_the_schema_file_is_that_of_the_code() -> None:
    assert FILE.read_text("utf-8") == schema_text(), (
        f'accept it: python -c "from edgetree.serve.messages import schema_text as text;'
        f' print(text(), end=str())" > {FILE}'
    )


def test_messages_that_are_sent_fit_the_schema(
    running: Any, dealer: Any, make_frame: Callable[..., Frame], monkeypatch: pytest.MonkeyPatch
) -> None:
    validators = pytest.importorskip("jsonschema")
    check = validators.Draft202012Validator(json.loads(FILE.read_text("utf-8"))).validate
    sent: list[bytes] = []
    with edgetree.serve.Client(running.service.address, timeout_s=20) as client:
        send = client._send
        monkeypatch.setattr(client, "_send", lambda *parts: (sent.append(parts[0]), send(*parts)))
        client.measure(make_frame())
        client.status()
    for text in (*sent, b'{"schema":"edgetree.serve.watch/1"}'):
        check(json.loads(text))
        dealer.send(text)
        if b"watch" not in text and b"bye" not in text:
            check(json.loads(dealer.recv()))
    with pytest.raises(validators.ValidationError):
        check({"schema": "edgetree.serve.frame/1", "id": -1, "time_s": 0})
