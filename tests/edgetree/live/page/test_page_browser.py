"""The page in Chromium: needs the package playwright and the program chromium.

Slow, because a browser starts. Run it with: pytest -m slow tests/edgetree/live/page
"""

import dataclasses
import shutil
import threading
import time
from collections.abc import Iterator

import pytest

from edgetree.live.page import PageServer
from edgetree.measure import Estimate

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
pytestmark = pytest.mark.slow


@pytest.fixture
def browser() -> Iterator[object]:
    playwright = pytest.importorskip("playwright.sync_api")
    if CHROMIUM is None:
        pytest.skip("there is no program chromium or google-chrome")
    with playwright.sync_playwright() as started:
        browser = started.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield browser
        browser.close()


@pytest.fixture
def publishing(serve, live_result) -> Iterator[tuple[PageServer, threading.Event]]:
    """A server that gets ten results of 14 stems each second, until the event is set."""
    server, done = serve(), threading.Event()

    def publish() -> None:
        number = 0
        while not done.wait(0.1):
            number += 1
            server.publish(live_result(number, stems=14))

    thread = threading.Thread(target=publish)
    thread.start()
    yield server, done
    done.set()
    thread.join()


def until(page, expression: str) -> None:
    """Wait until something is true. The page's policy forbids playwright's own way, `eval`."""
    end_s = time.monotonic() + 30
    while not page.evaluate(expression):
        assert time.monotonic() < end_s, expression
        page.wait_for_timeout(100)


def wait_for(page, text: str) -> None:
    until(page, f"document.getElementById('state').textContent === '{text}'")


@pytest.mark.parametrize(("width", "height"), [(1920, 1080), (800, 480)])
def test_the_page_shows_stems_without_scrolling_and_blanks_what_is_old(
    browser, publishing, width: int, height: int
) -> None:
    server, done = publishing
    page = browser.new_page(viewport={"width": width, "height": height})
    faults: list[str] = []
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.on("console", lambda told: faults.append(told.text) if told.type == "error" else None)
    page.goto(server.address)
    wait_for(page, "LIVE")
    until(page, "document.getElementById('age').textContent.startsWith('picture')")
    until(page, "document.querySelectorAll('#list li').length >= 5")
    assert page.inner_text("#list li:first-child .diameter") == "21.1 ± 0.6"
    assert page.inner_text("#list li:first-child .cut_height") == "12 ± 2"
    assert "not a safety function" in page.inner_text("header")
    assert "13 of 14 in view" in page.inner_text("#more")
    size = "[document.documentElement.scrollWidth, document.documentElement.scrollHeight]"
    assert page.evaluate(size) == [width, height]
    pixel = "document.getElementById('picture').getContext('2d').getImageData(5, 5, 1, 1).data[3]"
    until(page, f"{pixel} === 255")
    done.set()
    wait_for(page, "OLD")
    assert "No new frame" in page.inner_text("#view")
    assert page.evaluate(pixel) == 0
    assert faults == []
    server.close()
    wait_for(page, "NO CONNECTION")
    assert "No connection to edgetree" in page.inner_text("#view")


def test_the_theme_is_kept(browser, publishing) -> None:
    server, _ = publishing
    page = browser.new_page()
    page.goto(server.address)
    theme = "document.documentElement.dataset.theme"
    assert page.evaluate(theme) == "day"
    page.click("#theme")
    page.reload()
    assert page.evaluate(theme) == "night"


def test_a_page_that_is_one_too_many_says_so(browser, serve, live_result) -> None:
    server = serve(max_clients=1)
    server.publish(live_result())
    pages = [browser.new_page() for _ in range(2)]
    for page in pages:
        page.goto(server.address)
        time.sleep(1)
    wait_for(pages[1], "NO DATA")
    assert "too many pages are open" in pages[1].inner_text("#view")


def test_the_token_opens_the_page_and_leaves_the_address_line(browser, serve, live_result) -> None:
    server = serve(token="correct-horse-battery")
    server.publish(live_result())
    page = browser.new_page()
    page.goto(server.address)
    until(page, "document.getElementById('state').textContent !== 'NO CONNECTION'")
    assert "token" not in page.url
    page.reload()
    assert "Display only" in page.inner_text("header")


def test_the_button_marks_and_says_how_much_is_kept(browser, serve, live_result, recorder) -> None:
    server = serve(recorder=recorder, token="correct-horse-battery")
    server.publish(live_result())
    page = browser.new_page()
    page.goto(server.address)
    until(page, "!document.getElementById('mark').hidden")
    page.click("#mark")
    until(page, "!document.getElementById('said').hidden")
    assert page.inner_text("#said") == "Marked: 5 s kept"
    assert recorder.texts == ["page"]
    server.close()
    page.click("#mark")
    until(page, "document.getElementById('said').textContent.startsWith('Not marked')")


def test_without_a_recorder_there_is_no_button(browser, serve, live_result) -> None:
    server = serve()
    server.publish(live_result())
    page = browser.new_page()
    page.goto(server.address)
    until(page, "document.getElementById('state').textContent !== 'NO CONNECTION'")
    assert not page.is_visible("#mark")


WARNINGS = (
    "the views contradict each other: 24.1 and 31.9 cm, 3.4 deviations apart",
    "the cut is 0.52 m above the ground: more than the 0.3 m of a stump",
)
# Texts of the rows that are wider than their place, but for the notes, which end in dots.
CUT = """[...document.querySelectorAll('#list li > div:not(.note)')].filter((each) => {
  const text = document.createRange();
  text.selectNodeContents(each);
  const next = each.nextElementSibling.getBoundingClientRect();
  const own = each.getBoundingClientRect();
  const end = each.className.startsWith('diameter') ? next.left : own.right;
  return text.getBoundingClientRect().right > end + 1;
}).map((each) => each.textContent)"""


@pytest.mark.parametrize(("width", "height"), [(800, 480), (1024, 600), (480, 800)])
def test_long_numbers_fit_and_warnings_can_be_read_in_full(
    browser, serve, live_result, width: int, height: int
) -> None:
    server = serve(stale_s=60.0)
    result = live_result(stems=4)
    first, second, *others = result.tracks
    large = {"diameter_m": Estimate(1.234, 0.089), "cut_height_m": Estimate(1.23, 0.12)}
    tracks = [
        dataclasses.replace(first, number=12345, warnings=WARNINGS, **large),
        dataclasses.replace(second, number=1234, diameter_m=Estimate(1.234, 0.123)),
        *others,
    ]
    server.publish(dataclasses.replace(result, tracks=tracks))
    page = browser.new_page(viewport={"width": width, "height": height})
    page.goto(server.address)
    until(page, "document.querySelectorAll('#list li').length >= 2")
    assert page.evaluate(CUT) == []
    diameters = page.locator("#list .diameter").all_inner_texts()
    assert diameters[:2] == ["123.4 ± 8.9", "123 ± 12"]
    page.dispatch_event("#list li:first-child", "pointerdown")
    lines = page.locator("#detail .warning").all_inner_texts()
    assert lines == [f"⚠ {text}" for text in WARNINGS]
    page.focus("#list")
    page.keyboard.press("ArrowDown")
    assert "No warnings" in page.inner_text("#detail")
    page.keyboard.press("Escape")
    assert page.is_hidden("#detail")
