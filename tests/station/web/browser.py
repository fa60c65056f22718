"""The station's pages in a real browser: one of a module, in which people log in, each with a session of their own."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest
from station_support import PASSWORD

playwright = pytest.importorskip("playwright.sync_api")

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
LONGEST_MS = 120_000
Enter = Callable[[str], "playwright.Page"]

needs_browser = pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed: the pages are not tried in it")


@contextmanager
def launched() -> Iterator[playwright.Browser]:
    with playwright.sync_playwright() as started:
        browser = started.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield browser
        browser.close()


@contextmanager
def opened(url: str) -> Iterator[Enter]:
    """Yield what opens a page of the station for somebody, by their role, and logs in."""
    with launched() as browser:

        def entered(role: str) -> playwright.Page:
            page = browser.new_context(viewport={"width": 1920, "height": 1080}).new_page()
            page.set_default_timeout(LONGEST_MS)
            page.goto(f"{url}/")
            assert page.url.endswith("/enter"), "nobody sees the bench without an account"
            page.fill("#name", f"the {role}")
            page.fill("#password", PASSWORD)
            page.keyboard.press("Enter")
            page.wait_for_selector(".lm-word")
            return page

        yield entered
