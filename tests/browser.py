"""A real browser for tests: Debian's chromium without a window, its WebGL computed by the processor."""

from __future__ import annotations

import os
import shutil
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from socketserver import BaseServer

import cv2
import numpy as np
import pytest
from playwright.sync_api import Browser, FloatRect, Locator, Page, ViewportSize, sync_playwright

from cuboid.ground.arrays import UInt8Array

NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
FLAGS = ("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
# What a processor is slow at, and no test looks at: smooth edges, and text painted by WebGL.
FLAGS += ("--webgl-antialiasing-mode=none", "--disable-gpu-rasterization")

# Small: every pixel is computed by the processor.
VIEWPORT: ViewportSize = {"width": 1000, "height": 640}


def chromium() -> str:
    """Return where chromium lies; without one the test skips: nothing else needs it."""
    path = os.environ.get("CUBOID_CHROMIUM") or next(filter(None, map(shutil.which, NAMES)), None)
    if path is None:
        pytest.skip("no chromium is installed (Debian: apt-get install chromium; elsewhere set CUBOID_CHROMIUM)")
    return path


@contextmanager
def browser() -> Iterator[Browser]:
    path = chromium()
    with sync_playwright() as playwright:
        launched = playwright.chromium.launch(executable_path=path, args=list(FLAGS))
        yield launched
        launched.close()


class Watched:
    """A page that keeps what it complains about and what it asks for.

    Attributes
    ----------
    page : Page
    complaints : list of str
        Errors and warnings in its console, and faults of its scripts.
    requests : list of str
        Addresses, without those that hold their content themselves.

    `strict` leaves the page's own content policy in force; `motion` lets it animate, as most readers do.
    """

    def __init__(self, launched: Browser, scheme: str = "dark", *, strict: bool = False, motion: bool = False) -> None:
        self.page: Page = launched.new_page(
            viewport=VIEWPORT,
            color_scheme="light" if scheme == "light" else "dark",
            reduced_motion="no-preference" if motion else "reduce",
            bypass_csp=not strict,  # waiting for a condition evaluates it in the page, which its policy forbids
        )
        self.complaints: list[str] = []
        self.requests: list[str] = []
        self.page.on("console", lambda said: self._note(said.type, said.text))
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on("request", lambda asked: asked.url.startswith("data:") or self.requests.append(asked.url))

    def _note(self, kind: str, text: str) -> None:
        # reading the screen back is slow, says the driver, and so it is: only tests do it
        if kind in ("error", "warning") and "ReadPixels" not in text:
            self.complaints.append(text)

    def open(self, address: str | Path) -> None:
        """Open a file or an address, and wait until the scene is there."""
        self.page.goto(address.as_uri() if isinstance(address, Path) else address)
        self.page.wait_for_selector("body[data-ready]", timeout=30_000)


def pixels(place: Locator) -> UInt8Array:
    """Return what a place of the page looks like, (H, W, 3), RGB."""
    shown = cv2.imdecode(np.frombuffer(place.screenshot(), np.uint8), cv2.IMREAD_COLOR)
    assert shown is not None
    return np.asarray(shown[..., ::-1], np.uint8)


def press_layer(page: Page, name: str) -> None:
    """Show or hide a part of the scene, by the menu over it."""
    if page.locator("#show-menu").is_hidden():
        page.click("#show")
    page.click(f'[data-layer="{name}"]')
    page.keyboard.press("Escape")


def settle(page: Page) -> None:
    """Wait until what was asked for is on the screen."""
    page.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")


def rect(place: Locator) -> FloatRect:
    """Return where a place of the page is: x, y, width, height."""
    found = place.bounding_box()
    assert found is not None
    return found


class OpenPage:
    """Opens pages; in the end none of them must have complained."""

    def __init__(self, launched: Browser) -> None:
        self._launched, self._opened = launched, list[Watched]()

    def __call__(
        self, address: str | Path, scheme: str = "dark", *, width: int = VIEWPORT["width"], motion: bool = False
    ) -> Page:
        """Open a page of its own, and wait until the scene is there."""
        watched = Watched(self._launched, scheme, motion=motion)
        self._opened.append(watched)
        watched.page.set_viewport_size({**VIEWPORT, "width": width})
        watched.open(address)
        settle(watched.page)
        return watched.page

    def close(self) -> None:
        """Close the pages."""
        for watched in self._opened:
            assert watched.complaints == []
            watched.page.close()


@contextmanager
def answering(server: BaseServer) -> Iterator[None]:
    """Let a server answer from a thread of its own."""
    thread = threading.Thread(target=server.serve_forever, args=(0.02,), daemon=True)
    thread.start()
    yield
    server.shutdown()
    thread.join()
