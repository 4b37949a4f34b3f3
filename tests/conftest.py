"""Settings and fixtures of all tests: threads, hypothesis, recorded data, golden files."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

# Processes that run tests side by side share the cores: each computes with its part of them.
workers = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
if workers > 1:
    threads = str(max(1, (os.cpu_count() or 1) // workers))
    for name in ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ.setdefault(name, threads)

# The same examples in every run and on every machine. No time limit for one example, because a
# busy machine is no failure. Fixtures are shared by all examples, so tests must not change them.
settings.register_profile(
    "edgetree",
    derandomize=True,
    database=None,
    deadline=None,
    max_examples=50,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
settings.load_profile("edgetree")

SHARED = Path(__file__).resolve().parents[2] / "shared"
GOLDEN = Path(__file__).resolve().parent / "data" / "golden"
NOT_HERE = "the folder shared is not beside the checkout"


@pytest.fixture(scope="session")
def shared_path() -> Callable[[str], Path]:
    """Finds real captures and other programs' outputs in ``../shared``, or skips the test."""

    def find(name: str) -> Path:
        path = SHARED / name
        if not path.exists():
            pytest.skip(NOT_HERE)
        return path

    return find


@pytest.fixture(scope="session")
def golden_path() -> Callable[[str], Path]:
    """The path of a stored result in ``tests/data/golden``."""
    return lambda name: GOLDEN / name


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Say how many tests were skipped because their recorded data is missing."""
    reasons = (str(report.longrepr) for report in terminalreporter.getreports("skipped"))
    count = sum(NOT_HERE in reason for reason in reasons)
    if count:
        tests = "test" if count == 1 else "tests"
        terminalreporter.write_line(
            f"{count} {tests} skipped: real captures and reference outputs are not here"
            " (see CONTRIBUTING.md)"
        )
