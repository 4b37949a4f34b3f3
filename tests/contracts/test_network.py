"""edgetree sends nothing by itself: what can open a connection is named in the documentation."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "reference" / "systems.md"
PACKAGES = ("basetree", "calib", "edgetree", "fleet", "perceptree")
NETWORK = [
    "aiohttp",
    "boto3",
    "botocore",
    "fsspec",
    "ftplib",
    "grpc",
    "http",
    "httpx",
    "paho",
    "ray",
    "requests",
    "s3fs",
    "smtplib",
    "socket",
    "socketserver",
    "ssl",
    "telnetlib",
    "timm",
    "urllib3",
    "websockets",
    "xmlrpc",
]


def connects(text: str) -> bool:
    """Whether a module imports something that opens connections."""
    imported = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            imported |= {name.name for name in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            imported |= {node.module, *(f"{node.module}.{name.name}" for name in node.names)}
    return "urllib.request" in imported or any(name.split(".")[0] in NETWORK for name in imported)


def test_modules_that_open_connections_are_named():
    named = re.findall(r"`((?:basetree|edgetree|perceptree)/[\w/.]+)`", PAGE.read_text("utf-8"))
    assert named
    found = [
        path.relative_to(ROOT).as_posix()
        for package in PACKAGES
        for path in sorted((ROOT / package).rglob("*.py"))
        if connects(path.read_text("utf-8"))
    ]
    assert [path for path in found if not any(path.startswith(name) for name in named)] == []


@pytest.mark.parametrize(
    ("code", "expected"),
    [
        ("import urllib.request", True),
        ("def f():\n    from urllib import request", True),
        ("from urllib.parse import quote", False),
        ("import numpy, socket", True),
        ("from . import socket", False),
    ],
)
def test_an_import_that_connects_is_seen(code, expected):
    assert connects(code) is expected
