"""Settings and fixtures of all tests: threads, hypothesis, recorded data, golden files."""

import difflib
import functools
import os
import sys
from collections.abc import Callable, Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import own_machine
import pytest
from hypothesis import HealthCheck, settings
from once import Once

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


MACHINES = own_machine.machines()


@pytest.fixture(autouse=True)
def machine_of_the_test() -> Iterator[None]:
    """Gives each test, and the processes that it starts, trust files of their own."""
    with pytest.MonkeyPatch.context() as patched:
        for name, value in next(MACHINES).items():
            patched.setenv(name, value)
        own_machine.use()
        yield


@pytest.fixture(scope="session")
def once(tmp_path_factory: pytest.TempPathFactory) -> Once:
    """Makes files once for all processes that run the tests."""
    base = tmp_path_factory.getbasetemp()
    return Once((base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "once")


@pytest.fixture(scope="session")
def kit_of(once: Once) -> Callable[[str], Path]:
    """The conformance kit of a packaged model, by its name."""
    from edgetree.catalogue import default_model
    from edgetree.conformance import make_kit

    def find(name: str) -> Path:
        make = functools.partial(make_kit, default_model(name))
        return once.folder(f"kit-{name}", lambda folder: make(folder / "kit")) / "kit"

    return find


@pytest.fixture(autouse=True)
def torch_threads() -> Iterator[None]:
    """Sets the number of torch's threads back, on which the sums of a training depend."""
    torch: Any = sys.modules.get("torch")
    before = torch and torch.get_num_threads()
    yield
    if before and torch.get_num_threads() != before:
        torch.set_num_threads(before)


@pytest.fixture(scope="session")
def golden_path() -> Callable[[str], Path]:
    """The path of a stored result in ``tests/data/golden``."""
    return lambda name: GOLDEN / name


@pytest.fixture
def check_golden_picture(tmp_path: Path) -> Callable[[str, np.ndarray], None]:
    """Compares a picture with a stored PNG, by a mean and a largest difference of its levels."""

    def check(name: str, picture: np.ndarray) -> None:
        path = GOLDEN / name
        expected = cv2.imread(str(path), cv2.IMREAD_COLOR) if path.is_file() else None
        told = "there is no such file"
        if expected is not None and expected.shape != picture.shape:
            told = f"it is {expected.shape}, expected {picture.shape}"
        elif expected is not None:
            levels = np.abs(expected.astype(int) - picture)
            mean, high = float(levels.mean()), float(np.percentile(levels, 99.9))
            told = f"off by {mean:.2f} levels on average, and by {high:.0f} at the 99.9 percentile"
            if mean < 1 and high < 8:
                return
        cv2.imwrite(str(tmp_path / name), picture)
        pytest.fail(_how_to_accept(name, told, tmp_path))

    return check


@pytest.fixture
def check_golden_layout(tmp_path: Path) -> Callable[[str, str], None]:
    """Compares the layout of an HTML page with a stored one; its words may change.

    The layout is one line for each heading, picture and chart, and for each table with the names
    of its columns.
    """

    def check(name: str, html: str) -> None:
        reader = _Layout()
        reader.feed(html)
        found = "\n".join(reader.lines) + "\n"
        path = GOLDEN / name
        expected = path.read_text("utf-8") if path.is_file() else ""
        if found != expected:
            (tmp_path / name).write_text(found, "utf-8")
            changed = difflib.unified_diff(expected.splitlines(), found.splitlines(), lineterm="")
            pytest.fail(_how_to_accept(name, "\n".join(changed), tmp_path))

    return check


def _how_to_accept(name: str, told: str, folder: Path) -> str:
    return f"{name} has changed: {told}\nTo accept the change: cp '{folder / name}' '{GOLDEN}'"


class _Layout(HTMLParser):
    """Reads a page's layout into lines."""

    def __init__(self) -> None:
        super().__init__()
        self.lines: list[str] = []
        self._cell: list[str] | None = None

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag in ("h1", "h2", "h3", "img", "svg", "table"):
            self.lines.append(tag)
        if tag == "th":
            self._cell = []

    def handle_endtag(self, tag: str) -> None:
        if tag == "th" and self._cell is not None:
            self.lines[-1] += " | " + " ".join("".join(self._cell).split())
            self._cell = None

    def handle_data(self, data: str) -> None:
        if self._cell is not None:
            self._cell.append(data)


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
