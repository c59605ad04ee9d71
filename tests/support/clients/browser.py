"""A real browser without a screen: Debian's Chromium, controlled by playwright, with software rendering."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any
from urllib.parse import urlsplit

import pytest

CHROMIUM = shutil.which("chromium") or ""
OPTIONS = [
    "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
]  # fmt: skip
PATIENCE_MS = 120_000  # of a loaded machine without a graphics card


class BrowserPage:
    """A page, the errors in its console, and the hosts to which it sent requests."""

    def __init__(self, page: Any) -> None:
        self.page = page
        self.errors: list[str] = []
        self.hosts: set[str] = set()
        page.set_default_timeout(PATIENCE_MS)
        page.on("console", self._on_console)
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.on("request", lambda request: self.hosts.add(urlsplit(request.url).hostname or ""))

    def _on_console(self, message: Any) -> None:
        if message.type == "error":
            self.errors.append(message.text)


@contextmanager
def open_page(width: int = 1000, height: int = 640, dark: bool = False) -> Iterator[BrowserPage]:
    """Provide an empty page in a new browser. Skips where there is no Chromium."""
    if not CHROMIUM:
        pytest.skip("needs Debian's chromium")
    sync_api = pytest.importorskip("playwright.sync_api", reason="needs playwright")
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=OPTIONS)
        try:
            scheme = "dark" if dark else "light"
            size = {"width": width, "height": height}
            # playwright waits by eval(), which the rules of our pages forbid
            yield BrowserPage(browser.new_page(viewport=size, color_scheme=scheme, bypass_csp=True))
        finally:
            browser.close()
