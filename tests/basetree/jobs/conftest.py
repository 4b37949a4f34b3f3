"""Fixtures of the tests of jobs: small ones, and an S3 server on loopback that can fail."""

import threading
import urllib.request
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import pytest

from basetree.jobs import Job, Progress, Store


@dataclass
class FaultyServer:
    """What an S3 server does wrong.

    Attributes:
        url: Address of the server.
        unavailable_every: Answer each request of this number with 503; 0 for none.
        is_full: Refuse to store anything.
        requests: Method and path of all requests.
    """

    url: str = ""
    unavailable_every: int = 0
    is_full: bool = False
    requests: list[str] = field(default_factory=list)

    def answer(self, app: Any, environ: dict[str, Any], start_response: Any) -> Any:
        """Answer a request as moto does, or with the fault."""
        self.requests.append(f"{environ['REQUEST_METHOD']} {environ['PATH_INFO']}")
        number = len(self.requests)
        if self.unavailable_every and number % self.unavailable_every == 0:
            return _refusal(start_response, "503 Service Unavailable", "ServiceUnavailable")
        if self.is_full and environ["REQUEST_METHOD"] == "PUT":
            return _refusal(start_response, "507 Insufficient Storage", "XMinioStorageFull")
        return app(environ, start_response)


def _refusal(start_response: Any, status: str, code: str) -> list[bytes]:
    start_response(status, [("Content-Type", "application/xml")])
    return [f"<Error><Code>{code}</Code><Message>{status[4:]}</Message></Error>".encode()]


@pytest.fixture
def s3(monkeypatch: pytest.MonkeyPatch) -> Iterator[FaultyServer]:
    """A server with an empty bucket named "forest", where URLs s3://... lead to."""
    s3fs = pytest.importorskip("s3fs")
    pytest.importorskip("moto")
    import boto3
    from moto.moto_server.werkzeug_app import DomainDispatcherApplication, create_backend_app
    from werkzeug.serving import make_server

    faults = FaultyServer()
    app = DomainDispatcherApplication(create_backend_app)
    server = make_server(
        "127.0.0.1",
        0,
        lambda environ, start: faults.answer(app, environ, start),
        threaded=True,
    )
    threading.Thread(target=server.serve_forever, daemon=True).start()
    faults.url = f"http://127.0.0.1:{server.port}"
    monkeypatch.setenv("AWS_ENDPOINT_URL", faults.url)
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", "key")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "secret")
    monkeypatch.setenv("AWS_DEFAULT_REGION", "us-east-1")
    s3fs.S3FileSystem.clear_instance_cache()  # which know the server of the test before
    boto3.client("s3").create_bucket(Bucket="forest")
    yield faults
    urllib.request.urlopen(f"{faults.url}/moto-api/reset", b"").close()
    server.shutdown()


@pytest.fixture
def job() -> Callable[..., Job]:
    """Makes a job of 11 frames in units of 3 in a store."""

    def make(store: Store, **changes: Any) -> Job:
        values = {"kind": "test", "identity": {"seed": 1}, "frames": 11, "block": 3}
        return Job(store, **{**values, **changes})

    return make


@pytest.fixture
def quiet() -> Progress:
    """A progress that says nothing."""
    return Progress("testing", shown=False)
