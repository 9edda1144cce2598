"""A demo with its page: the address is told, the page follows the manager, and what it orders is done."""

import json
import subprocess
import sys
import urllib.request
from collections.abc import Iterable, Iterator
from typing import Any
from urllib.error import HTTPError

import pytest

from heronry_manager import events
from heronry_manager.events.reading import events_in
from live.told_events import E, next_event

pytestmark = pytest.mark.live


class Demo:
    """A demo that goes on until it is ended."""

    def __init__(self) -> None:
        command = [sys.executable, "-m", "heronry_tools", "demo", "elevator_and_chute", "--web", "--json"]
        self.process = subprocess.Popen(
            [*command, "--contingencies", "none", "--kill", "pe:sensor_pe@600"],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        self.address, self.token = "", ""

    def until(self, kind: type[E], **fields: Any) -> E:
        """Wait for an event; notes the address of the page on the way."""
        assert self.process.stdout is not None
        return next_event(self._noted(self.process.stdout), kind, **fields)

    def _noted(self, lines: Iterable[bytes]) -> Iterator[bytes]:
        for line in lines:
            for told in events_in([line]):
                if isinstance(told, events.Page):
                    self.address, _, self.token = told.address.partition("#token=")
            yield line

    def order(self, token: str, **order: str) -> dict[str, Any]:
        head = {
            "content-type": "application/json",
            "origin": self.address.removesuffix("/"),
            "authorization": f"Bearer {token}",
        }
        asked = urllib.request.Request(f"{self.address}api/order", json.dumps(order).encode(), head)
        try:
            with urllib.request.urlopen(asked, timeout=20) as answer:
                found: dict[str, Any] = json.load(answer)
                return found
        except HTTPError as error:
            return {"code": error.code}

    def snapshot(self) -> dict[str, Any]:
        with urllib.request.urlopen(f"{self.address}api/snapshot", timeout=20) as answer:
            found: dict[str, Any] = json.load(answer)
            return found


@pytest.fixture
def demo() -> Iterator[Demo]:
    flying = Demo()
    yield flying
    flying.process.terminate()
    flying.process.communicate(timeout=30)


def test_a_demo_shows_itself_and_executes_what_its_page_orders(demo: Demo) -> None:
    epoch = demo.until(events.Reconfigured).epoch
    if not demo.address:
        demo.until(events.Page)
    assert demo.order("another", do="kill", what="pe:tail_pe") == {"code": 401}
    killed = demo.order(demo.token, do="kill", what="pe:tail_pe")
    assert killed["done"], killed
    demo.until(events.Process, pe="tail_pe", what="killed")
    assert "does not run" in demo.order(demo.token, do="kill", what="pe:tail_pe")["sentence"]
    assert demo.until(events.Reconfigured).epoch > epoch
    assert not demo.order(demo.token, do="start", what="pe:sensor_pe")["done"]
    assert demo.order(demo.token, do="start", what="pe:tail_pe")["done"]
    demo.until(events.PeJoined, pe="tail_pe")
    phase = demo.order(demo.token, do="phase", what="war")
    assert not phase["done"]
    shown = demo.snapshot()
    assert shown["source"] == "manager"
    assert shown["epoch"] > epoch
    assert any("tail_pe" in cause for one in shown["reconfigurations"] for cause in one["causes"])
    assert any(bus["load"] for bus in shown["buses"].values())
