"""Debian's Chromium, driven by Playwright, and a server for it in a thread.

Where there is no Chromium, tests of the page are skipped, but not in CI.
"""

import os
import shutil
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import uvicorn
from playwright.sync_api import Browser, Page, sync_playwright

from heronry_dg.model import Spec
from heronry_dg.shipped import shipped_spec_path
from heronry_tools.watch.orders import Orders
from heronry_tools.watch.reducer import Reducer
from heronry_tools.web.app import Site
from heronry_tools.web.guard import Access
from heronry_tools.web.live import Live
from heronry_tools.web.questions import Questions
from heronry_tools.web.recording import Recording
from heronry_tools.web.serving import access, configuration, listening
from heronry_wire.frame import LoggedFrame
from web.flight import big_blue, flown

FLAGS = [
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
]
CHROMIUM = shutil.which("chromium")
needs_chromium = pytest.mark.skipif(
    CHROMIUM is None and not os.environ.get("CI"),
    reason="there is no Chromium here: as root, apt-get install chromium (in CI these tests must run)",
)


@contextmanager
def browser() -> Iterator[Browser]:
    assert CHROMIUM is not None, "CI installs Chromium: see .ci/run"
    with sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield opened
        opened.close()


class Server:
    """The pages of one system on a free port; `stop` ends it before the test does."""

    def __init__(
        self,
        shown: Live | Recording,
        *,
        operates: bool = False,
        orders: Orders | None = None,
        spec: Spec | None = None,
        file: Path | None = None,
        frames: Sequence[LoggedFrame] = (),
    ) -> None:
        """Serve big_blue, or another spec from its file."""
        spec = spec or big_blue()
        self._listener = listening("127.0.0.1", 0)
        self.access: Access = access(self._listener, operates=operates)
        questions = Questions(spec, file or shipped_spec_path("big_blue"))
        self.site = Site(spec, shown, questions, orders or Orders(None), self.access, frames)
        self._server = uvicorn.Server(configuration(self.site))
        self._thread = threading.Thread(target=self._server.run, kwargs={"sockets": [self._listener]}, daemon=True)

    def __enter__(self) -> "Server":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    @property
    def address(self) -> str:
        return self.access.url(with_token=False)

    def stop(self) -> None:
        self.site.closing.set()  # a stream looks at it every second
        self._server.should_exit = True
        self._thread.join(10)


def recorded() -> Recording:
    return Recording(Reducer(big_blue()), flown(), "log")


class Watched:
    """A page of the browser, with what it asked for and what went wrong in it."""

    def __init__(self, opened: Browser, width: int = 1280, scheme: str = "light") -> None:
        size = {"width": width, "height": 900 if width > 500 else 844}
        self.page: Page = opened.new_page(viewport=size, color_scheme=scheme, reduced_motion="reduce")
        self.asked: list[str] = []
        self.wrong: list[str] = []
        self.page.on("request", lambda request: self.asked.append(request.url))
        self.page.on("pageerror", lambda error: self.wrong.append(str(error)))
        self.page.on("console", self._heard)

    def _heard(self, message: Any) -> None:
        if message.type in ("error", "warning"):
            self.wrong.append(message.text)

    def open(self, address: str, panel: str = "") -> None:
        self.page.goto(f"{address}{panel}")
        self.page.wait_for_selector("#functions [data-function]")

    def panel(self, name: str) -> None:
        self.page.click(f'#tabs a[href="#/{name}"]')
        self.page.wait_for_selector(f"#panel-{name}:not([hidden])")
        self.drawn()

    def drawn(self) -> None:
        """Wait until the page has drawn what it knows: it draws in its next frame, which a busy computer shows late."""
        self.page.evaluate("() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")

    def every_symbol(self) -> None:
        """Show the drawing of every symbol, and the table below it."""
        self.page.check("#graph-symbols")
        self.page.wait_for_selector("#graph .node")
        self.page.eval_on_selector("#table", "(one) => { one.open = true; }")
        self.drawn()

    def until(self, script: str, longest_s: float = 10.0) -> None:
        """Wait until a script gives true; Playwright's own way needs an `eval` that the page forbids."""
        for _ in range(round(longest_s * 40)):
            if self.page.evaluate(script):
                return
            self.page.wait_for_timeout(25)
        raise AssertionError(f"never true: {script}")

    def known(self) -> dict[str, Any]:
        """The snapshot as the page has it."""
        found: dict[str, Any] = self.page.evaluate("structuredClone(heronry.store.snapshot)")
        return found

    def attributes(self, selector: str, name: str, value: str) -> dict[str, str]:
        """One attribute of all these elements, by another one."""
        script = "(all, [name, value]) => Object.fromEntries(all.map((one) => [one.dataset[name], one.dataset[value]]))"
        found: dict[str, str] = self.page.eval_on_selector_all(selector, script, [name, value])
        return found

    def places(self) -> dict[str, list[float]]:
        """Where every symbol of the graph stands."""
        script = """(all) => Object.fromEntries(all.map((one) => {
            const box = one.querySelector(".body").getBBox();
            return [one.dataset.key, [box.x, box.y, box.width, box.height]];
        }))"""
        found: dict[str, list[float]] = self.page.eval_on_selector_all("#graph .node[data-key]", script)
        return found

    def colours(self) -> dict[str, str]:
        """The state of every symbol of the graph, as its class has it."""
        script = """(all) => Object.fromEntries(all.map((one) => [one.dataset.key,
            ["served", "degraded", "lost", "idle", "dead"].find((state) => one.classList.contains(state))]))"""
        found: dict[str, str] = self.page.eval_on_selector_all("#graph .node[data-key]", script)
        return found
