"""A pytest plugin for the base install: the runtime's tests must really run, and without torch.

The run fails if a package of the training side or another extra is installed, if a test was skipped
for another reason than one of them or the data beside the checkout missing, or if so few tests
passed that most cannot have been found.
"""

import re
from collections.abc import Iterable
from importlib.util import find_spec

import pytest

ABSENT = (
    "torch",
    "torchvision",
    "timm",
    "onnx",
    "onnxscript",
    "numba",
    "pycocotools",
    "cryptography",
    "av",
    "rosbags",
    "mcap",
    "mcap_protobuf",
    "zstandard",
    "laspy",
    "small_gicp",
    "lzfse",
    "zmq",
    "paho",
    "prometheus_client",
    "pillow_heif",
    "ray",
    "fsspec",
    "s3fs",
    "moto",
    "playwright",
    "supervision",
    "jsonschema",
)
FEWEST_PASSED = 400


def complaints(installed: Iterable[str], skips: Iterable[str], passed: int) -> list[str]:
    """What is wrong with a run; `skips` are the reasons of the skipped tests."""
    names = "|".join(ABSENT)
    expected = re.compile(
        rf"could not import '.+': No module named '({names})(\..+)?'"
        "|the folder shared is not beside the checkout"
    )
    found = [f"{name} is installed: expected the base install alone" for name in installed]
    found += [
        f"skipped, and not for an extra: {reason}"
        for reason in skips
        if not expected.search(reason)
    ]
    if passed < FEWEST_PASSED:
        found.append(f"{passed} tests passed: expected {FEWEST_PASSED} or more")
    return found


class BaseInstall:
    """Counts, and has the last word on the exit code."""

    def __init__(self) -> None:
        self.passed = 0
        self.skips: list[str] = []
        self.complaints: list[str] = []

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Count a test."""
        self.passed += report.when == "call" and report.passed
        self._note_skip(report)

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        """See files that were skipped as a whole."""
        self._note_skip(report)

    def _note_skip(self, report: pytest.TestReport | pytest.CollectReport) -> None:
        if report.skipped:
            location = report.longrepr
            reason = location[2] if isinstance(location, tuple) else str(location)
            self.skips.append(f"{report.nodeid}: {reason}")

    @pytest.hookimpl(tryfirst=True)
    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        """Fail a run that has complaints."""
        installed = [name for name in ABSENT if find_spec(name)]
        self.complaints = complaints(installed, self.skips, self.passed)
        if self.complaints and session.exitstatus == pytest.ExitCode.OK:
            session.exitstatus = pytest.ExitCode.TESTS_FAILED

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        """Say them."""
        for line in self.complaints:
            terminalreporter.write_line(f"base install: {line}", red=True)


def pytest_configure(config: pytest.Config) -> None:
    """Join the run."""
    config.pluginmanager.register(BaseInstall())
