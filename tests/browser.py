"""Chromium, and pages of the viewer in it."""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from playwright.sync_api import Browser, Page, ViewportSize, sync_playwright

OPTIONS = (
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--use-gl=angle",  # without a graphics card
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
)

SIZE: ViewportSize = {"width": 900, "height": 600}


@contextmanager
def chromium() -> Iterator[Browser]:
    """The browser of this machine; LookupError if it has none."""
    program = shutil.which("chromium")
    if program is None:
        raise LookupError("chromium is not installed")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=[*OPTIONS])
        yield browser
        browser.close()


def open_viewer(page: Page, address: str) -> None:
    """Open the viewer, until it has shown the map and follows it."""
    page.goto(address)
    page.evaluate("semmap.ready")
    until(page, "document.getElementById('status').value === 'live'")


def until(page: Page, what: str, value: Any = None, seconds: float = 10) -> None:
    """Wait until an expression is true; the page's policy forbids Playwright's own wait."""
    end = time.monotonic() + seconds
    while not page.evaluate(what, value):
        assert time.monotonic() < end, what
        page.wait_for_timeout(20)
