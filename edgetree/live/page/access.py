"""Who may open the page: addresses of this machine only, and a token unless it is on loopback."""

from __future__ import annotations

import hmac
import ipaddress
import re
import secrets
import socket
from http import HTTPStatus
from typing import Final, NamedTuple
from urllib.parse import parse_qs

from basetree.errors import InputError

_TOKEN: Final = re.compile(r"[A-Za-z0-9_-]{16,128}")


class Refusal(NamedTuple):
    """Why a request is refused."""

    status: HTTPStatus
    text: str


class Access:
    """Decides on requests.

    Args:
        host: The address that the server listens on.
        token: What a client must know; None makes a random one, or none on loopback.

    Raises:
        InputError: The token is too short or has other signs than letters, digits, - and _.
    """

    def __init__(self, host: str, token: str | None) -> None:
        if token is not None and not _TOKEN.fullmatch(token):
            raise InputError(
                f"the page's token has {len(token)} characters:"
                " expected 16 to 128 letters, digits, - or _"
            )
        if token is None and not is_loopback(host):
            token = secrets.token_urlsafe(16)
        self.token = token
        machine = socket.gethostname().lower()
        self._names = {"localhost", host.lower(), machine, f"{machine}.local"}

    def refusal_of_host(self, values: list[str]) -> Refusal | None:
        """Check the Host header: a foreign name that leads here is an attack by DNS rebinding."""
        if len(values) != 1:
            return Refusal(HTTPStatus.BAD_REQUEST, "expected one Host header")
        name = re.sub(r":\d*$", "", values[0].strip().lower())
        if name in self._names or _is_address(name.removeprefix("[").removesuffix("]")):
            return None
        return Refusal(
            HTTPStatus.MISDIRECTED_REQUEST, "open the page by this machine's address or name"
        )

    def refusal_of_origin(self, origins: list[str], hosts: list[str]) -> Refusal | None:
        """Check the Origin header, which browsers send with each POST, against the Host header."""
        hosts = [host.strip().lower() for host in hosts]
        if all(origin.strip().lower().partition("://")[2] in hosts for origin in origins):
            return None
        return Refusal(HTTPStatus.FORBIDDEN, "another site asks for this")

    def knows_token(
        self, query: str, cookies: str, cookie_name: str, authorization: str = ""
    ) -> bool:
        """Whether the query, the cookies or the header have the token; true if there is none."""
        if self.token is None:
            return True
        scheme, _, bearer = authorization.partition(" ")
        given = [bearer.strip()] if scheme.lower() == "bearer" else []
        given += parse_qs(query, max_num_fields=8).get("token", [])
        given += [
            value.strip()
            for name, _, value in (part.partition("=") for part in cookies.split(";"))
            if name.strip() == cookie_name
        ]
        # All are compared, in a time that does not depend on where they differ.
        token, tried = self.token.encode(), (each.encode("utf-8", "replace") for each in given[:8])
        return sum(hmac.compare_digest(each, token) for each in tried) > 0


def is_loopback(host: str) -> bool:
    """Whether an address can be reached from this machine only."""
    if host.lower() == "localhost":
        return True
    return _is_address(host) and ipaddress.ip_address(host).is_loopback


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True
