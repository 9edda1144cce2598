"""Views of real processes: a demo is followed, listened to, recorded and scraped while it flies."""

import json
import os
import select
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.request import urlopen

import pytest

from heronry_manager.events import Bus, Event, Reconfigured
from heronry_manager.events.reading import events_in
from heronry_tools.sources.recordings import open_recording

pytestmark = pytest.mark.live
SPEC = "dg_specs/examples/triplex_voting.dg.yaml"  # so small that a slow computer keeps up with it
HERONRY = [sys.executable, "-m", "heronry_tools"]
PATIENCE_S = 120


@pytest.fixture
def home(monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Folders of this test alone, with a short name: sockets go into them."""
    with tempfile.TemporaryDirectory(prefix="w-", dir="/tmp") as folder:
        monkeypatch.setenv("TMPDIR", folder)
        monkeypatch.setenv("XDG_RUNTIME_DIR", folder)
        yield Path(folder)


@pytest.fixture
def flight(home: Path) -> Iterator[list[Event]]:
    """A demo whose first configuration runs; gives its events up to then."""
    typed = [*HERONRY, "demo", SPEC, "--for", "60", "--json", "--contingencies", "none"]
    process = subprocess.Popen(typed, stdout=subprocess.PIPE, text=True)
    events: list[Event] = []
    assert process.stdout is not None
    try:
        for line in process.stdout:
            events += events_in([line])
            if isinstance(events[-1], Reconfigured):
                break
        yield events
    finally:
        process.terminate()
        process.communicate(timeout=PATIENCE_S)


def snapshots(*arguments: str, until) -> dict[str, Any]:
    """What `heronry top --json` prints, up to a snapshot that is awaited."""
    process = subprocess.Popen([*HERONRY, "top", "--json", *arguments], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    until_s, last = time.monotonic() + PATIENCE_S, {}
    try:
        while time.monotonic() < until_s and select.select([process.stdout], [], [], PATIENCE_S)[0]:
            last = json.loads(process.stdout.readline())
            if until(last):
                return last
        pytest.fail(f"this never came; the last snapshot was {json.dumps(last)[:3000]}")
    finally:
        process.terminate()
        process.communicate(timeout=PATIENCE_S)


def test_a_flight_is_followed_listened_to_recorded_and_scraped(flight: list[Event], home: Path) -> None:
    epoch = next(one.epoch for one in flight if isinstance(one, Reconfigured))
    bus = next(one for one in flight if isinstance(one, Bus))

    def is_whole(view: dict[str, Any]) -> bool:
        load = view["buses"][bus.name]["load"]
        heard = any(one["heard"] for one in view["functions"].values())
        return (view["epoch"] or 0) >= epoch and bool(load) and heard and any(m["pe"] for m in view["modules"].values())

    followed = snapshots(until=is_whole)
    assert (followed["source"], followed["knows_why"], followed["stage"]) == ("manager", True, "running")
    listened = snapshots(SPEC, "-i", bus.interface, "-c", bus.channel, until=lambda view: view["manager"]["node"])
    assert (listened["source"], listened["knows_why"], listened["manager"]["node"]) == ("bus", False, 126)

    folder = home / "flight"
    subprocess.run([*HERONRY, "record", "-o", str(folder), "--for", "3"], check=True, timeout=PATIENCE_S)
    recorded = open_recording(folder, None)
    view = recorded.timeline().last()
    assert (view.source, view.manager.node) == ("record", 126)
    assert len(recorded.frames) > 100
    assert view.epoch >= epoch

    served = subprocess.Popen([*HERONRY, "metrics", "--port", "0"], stdout=subprocess.PIPE, text=True, env=os.environ)
    assert served.stdout is not None
    try:
        address = served.stdout.readline().strip()
        with urlopen(address, timeout=PATIENCE_S) as page:
            assert b"heronry_pe_standing{" in page.read()
        with pytest.raises(OSError, match="404"):
            urlopen(address.removesuffix("metrics"), timeout=PATIENCE_S)
    finally:
        served.terminate()
        served.communicate(timeout=PATIENCE_S)
