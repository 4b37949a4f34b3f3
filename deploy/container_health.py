"""The container's health check: whether the page of `edgetree live` answers on this machine.

Exit code 0 if it does, even if it asks for a token; 1 if nothing listens, nothing answers in time,
or the answer is that of a server which is not well (5xx).
"""

import sys
from http.client import HTTPConnection, HTTPException

_PORT = 8420
_LIMIT_S = 3.0


def fault(port: int = _PORT) -> str | None:
    """What is wrong with the server, in a line; None if it answers."""
    connection = HTTPConnection("127.0.0.1", port, timeout=_LIMIT_S)
    try:
        connection.request("GET", "/healthz")
        status = connection.getresponse().status
    except (OSError, HTTPException) as error:
        return f"port {port} does not answer ({error}): expected `edgetree live` with --page"
    finally:
        connection.close()
    return (
        f"port {port} answers with status {status}: expected one below 500"
        if status >= 500
        else None
    )


if __name__ == "__main__":
    sys.exit(fault())
