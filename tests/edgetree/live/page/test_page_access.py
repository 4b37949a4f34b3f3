"""Who may open the page: tokens, names of the machine, other sites."""

import re

import pytest

from edgetree.live.page import PageServer

TOKEN = "correct-horse-battery"


def test_loopback_needs_no_token_and_another_host_gets_a_random_one(serve) -> None:
    assert "token" not in serve().address
    addresses = [serve(host="0.0.0.0").address for _ in range(2)]
    tokens = {re.search(r"\?token=([\w-]{22})$", address)[1] for address in addresses}
    assert len(tokens) == 2


@pytest.mark.parametrize("path", ["/", "/events", "/picture.mjpeg"])
@pytest.mark.parametrize("query", ["", "?token=", "?token=wrong", f"?token={TOKEN}x", "?x=1"])
def test_without_the_token_nothing_is_shown(serve, connect, path: str, query: str) -> None:
    client = connect(serve(token=TOKEN)).send(path + query, "Cookie: edgetree_1=x; other=y")
    assert client.status() == 403
    answer = client.rest()
    assert b"token that edgetree printed" in answer
    assert b"Set-Cookie" not in answer


def test_the_token_in_the_address_gives_a_cookie_that_opens_the_rest(serve, connect) -> None:
    server = serve(token=TOKEN)
    client = connect(server).send(f"/?token={TOKEN}")
    assert client.status() == 200
    head = client.until(b"\r\n\r\n").decode()
    cookie = re.search("Set-Cookie: (.*)\r\n", head)[1]
    value, *attributes = cookie.split("; ")
    assert set(attributes) == {"Path=/", "HttpOnly", "SameSite=Strict"}
    assert connect(server).send("/events", f"Cookie: a=b; {value}").status() == 200
    assert connect(server).send("/events", f"Cookie: {value}x").status() == 403


@pytest.mark.parametrize(
    "host", ["127.0.0.1", "localhost:8420", "LOCALHOST", "[::1]:8420", "192.168.1.7:80"]
)
def test_addresses_and_names_of_this_machine_are_served(serve, connect, host: str) -> None:
    assert connect(serve()).send("/", host=host).status() == 200


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1.evil.example:8420", "localhost.", "["])
def test_foreign_names_are_refused_against_dns_rebinding(serve, connect, host: str) -> None:
    client = connect(serve()).send("/events", host=host)
    assert client.status() == 421
    assert b"by this machine's address or name" in client.rest()


def test_two_host_headers_are_refused(serve, connect) -> None:
    assert connect(serve()).send("/", "Host: evil.example").status() == 400


def test_other_sites_may_link_here_but_not_embed(serve, connect) -> None:
    server = serve()
    assert connect(server).send("/", "Sec-Fetch-Site: cross-site").status() == 200
    assert connect(server).send("/picture.mjpeg", "Sec-Fetch-Site: cross-site").status() == 403
    assert connect(server).send("/events", "Sec-Fetch-Site: same-origin").status() == 200


def test_a_query_with_many_fields_is_refused(serve, connect) -> None:
    server: PageServer = serve(token=TOKEN)
    assert connect(server).send("/?" + "token=x&" * 50).status() == 400
