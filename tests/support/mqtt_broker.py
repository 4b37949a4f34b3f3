"""A broker of MQTT 3.1.1 that keeps what clients send, and certificates for it."""

from __future__ import annotations

import datetime
import ipaddress
import socket
import ssl
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

PATIENCE_S = 20.0


class Message(NamedTuple):
    """A published message."""

    topic: str
    content: bytes
    qos: int
    retain: bool


class Connect(NamedTuple):
    """What a client says of itself: its name, its password and its will."""

    user: str | None
    password: str | None
    will: Message | None


class Broker:
    """Accepts clients one after the other.

    Args:
        port: Port; 0 for any free one.
        context: Encrypts the connections.
        return_code: Answer to each client: 0 accepts it, 5 does not authorise it.
    """

    def __init__(
        self, port: int = 0, context: ssl.SSLContext | None = None, return_code: int = 0
    ) -> None:
        self.messages: list[Message] = []
        self.connects: list[Connect] = []
        self._context, self._return_code = context, return_code
        self._listener = socket.create_server(("127.0.0.1", port))
        self.port = self._listener.getsockname()[1]
        self._client: socket.socket | None = None
        self._is_closed = False
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Be gone, as a killed broker is."""
        self._is_closed = True
        for each in (self._client, self._listener):
            if each is not None:
                with suppress(OSError):
                    each.shutdown(socket.SHUT_RDWR)
                each.close()
        self._thread.join(5)

    def wait(self, happened: Callable[[], Any]) -> None:
        """Wait until something is true."""
        end_s = time.monotonic() + PATIENCE_S
        while not happened():
            assert time.monotonic() < end_s, (self.connects, self.messages)
            time.sleep(0.01)

    def of(self, topic: str) -> list[Message]:
        """The messages of a topic."""
        return [each for each in self.messages if each.topic == topic]

    def _serve(self) -> None:
        while not self._is_closed:
            with suppress(OSError, EOFError):
                client, _ = self._listener.accept()
                self._client = client
                if self._context is not None:
                    client = self._context.wrap_socket(client, server_side=True)
                self._client = client
                with client:
                    while True:
                        self._answer(client, *_packet(client))

    def _answer(self, client: socket.socket, head: int, body: bytes) -> None:
        kind = head >> 4
        if kind == 1:
            self.connects.append(_connect(body))
            client.sendall(bytes([0x20, 2, 0, self._return_code]))
        elif kind == 3:
            qos, (topic, rest) = head >> 1 & 3, _text(body)
            if qos:
                client.sendall(bytes([0x40 if qos == 1 else 0x50, 2]) + rest[:2])
                rest = rest[2:]
            self.messages.append(Message(topic.decode(), rest, qos, bool(head & 1)))
        elif kind == 6:
            client.sendall(bytes([0x70, 2]) + body[:2])
        elif kind == 12:
            client.sendall(bytes([0xD0, 0]))
        elif kind == 14:
            raise EOFError


def _packet(client: socket.socket) -> tuple[int, bytes]:
    head, length, shift = _exactly(client, 1)[0], 0, 0
    while True:
        part = _exactly(client, 1)[0]
        length |= (part & 127) << shift
        shift += 7
        if not part & 128:
            return head, _exactly(client, length)


def _exactly(client: socket.socket, length: int) -> bytes:
    data = b""
    while len(data) < length:
        part = client.recv(length - len(data))
        if not part:
            raise EOFError
        data += part
    return data


def _text(body: bytes) -> tuple[bytes, bytes]:
    length = int.from_bytes(body[:2])
    return body[2 : 2 + length], body[2 + length :]


def _connect(body: bytes) -> Connect:
    flags = body[7]
    _, rest = _text(body[10:])
    will = user = password = None
    if flags & 4:
        topic, rest = _text(rest)
        content, rest = _text(rest)
        will = Message(topic.decode(), content, flags >> 3 & 3, bool(flags & 32))
    if flags & 128:
        name, rest = _text(rest)
        user = name.decode()
    if flags & 64:
        password = _text(rest)[0].decode()
    return Connect(user, password, will)


class Certificates(NamedTuple):
    """PEM files: an authority, and certificates with keys that it has signed."""

    ca: Path
    server: Path
    client: Path
    client_key: Path

    def server_context(self, *, asks_client: bool = False) -> ssl.SSLContext:
        """What a broker with the server's certificate uses."""
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.load_cert_chain(self.server)
        if asks_client:
            context.verify_mode = ssl.CERT_REQUIRED
            context.load_verify_locations(self.ca)
        return context


def make_certificates(folder: Path) -> Certificates:
    """Make them, for a server at 127.0.0.1; needs the package cryptography."""
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes, serialization
    from cryptography.hazmat.primitives.asymmetric import ec
    from cryptography.x509.oid import NameOID

    folder.mkdir(exist_ok=True)
    now = datetime.datetime.now(datetime.UTC)
    authority = ec.generate_private_key(ec.SECP256R1())

    def name(text: str) -> x509.Name:
        return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, text)])

    def signed(text: str, key: ec.EllipticCurvePrivateKey, *, is_ca: bool) -> bytes:
        address = x509.IPAddress(ipaddress.ip_address("127.0.0.1"))
        made = (
            x509.CertificateBuilder()
            .subject_name(name(text))
            .issuer_name(name("authority"))
            .public_key(key.public_key())
            .serial_number(x509.random_serial_number())
            .not_valid_before(now - datetime.timedelta(days=1))
            .not_valid_after(now + datetime.timedelta(days=1))
            .add_extension(x509.BasicConstraints(ca=is_ca, path_length=None), critical=True)
            .add_extension(x509.SubjectAlternativeName([address]), critical=False)
            .sign(authority, hashes.SHA256())
        )
        return made.public_bytes(serialization.Encoding.PEM)

    def written(key: ec.EllipticCurvePrivateKey) -> bytes:
        return key.private_bytes(
            serialization.Encoding.PEM,
            serialization.PrivateFormat.PKCS8,
            serialization.NoEncryption(),
        )

    keys = {each: ec.generate_private_key(ec.SECP256R1()) for each in ("server", "client")}
    files = Certificates(*(folder / f"{each}.pem" for each in ("ca", "server", "client", "key")))
    files.ca.write_bytes(signed("authority", authority, is_ca=True))
    server = signed("server", keys["server"], is_ca=False) + written(keys["server"])
    files.server.write_bytes(server)
    files.client.write_bytes(signed("client", keys["client"], is_ca=False))
    files.client_key.write_bytes(written(keys["client"]))
    return files
