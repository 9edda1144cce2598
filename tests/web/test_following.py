"""A page follows the active manager: after a take-over it goes on with the standby manager, by itself."""

import asyncio
import os
import time

from heronry_dg.shipped import shipped_spec_path
from heronry_manager import events
from heronry_manager.shell.control_place import standby_of
from heronry_tools.watch import live_feeds
from heronry_tools.watch.live_feeds import FollowedManager
from heronry_tools.watch.reducer import Reducer
from heronry_tools.web.following import read_in_thread
from heronry_tools.web.live import Live
from watch.test_live_feeds import OTHER, PATIENCE_S, SPEC, another_started, another_status, manager_on, status


async def until(holds):
    until_s = time.monotonic() + PATIENCE_S
    while not holds():
        assert time.monotonic() < until_s
        await asyncio.sleep(0.01)


def test_after_a_take_over_the_page_follows_the_standby_manager_and_later_its_own(tmp_path, monkeypatch):
    monkeypatch.setattr(live_feeds, "_AGAIN_NS", 0)
    path, live = tmp_path / "big_blue.sock", Live(Reducer(SPEC), "manager")
    term = {"before": 1, "silent_ns": 5, "phase": "glide"}

    async def follow():
        with manager_on(standby_of(path), status(t_ns=7)) as standby:
            with manager_on(path, status()):
                read_in_thread(lambda: FollowedManager(path), live, path)
                await until(lambda: live.snapshot.events == 1)
                standby.followers.tell(events.PhaseChanged(8, phase="landing", before="ascent", by="operator"))
            await until(lambda: live.snapshot.events == 2)
            assert (live.snapshot.t_ns, live.snapshot.phase) == (7, "ascent")  # its status, and no event of before
            standby.followers.tell(events.TakenOver(9, term=2, **term))
            await until(lambda: live.snapshot.manager.term == 2)
            assert live.trouble is None
            assert live.snapshot.manager.state == "active"
        await until(lambda: live.trouble is not None)
        with manager_on(path, status(t_ns=20)):
            await until(lambda: live.snapshot.t_ns == 20)
            await until(lambda: live.trouble is None)

    asyncio.run(follow())


def test_a_page_goes_on_with_another_spec(tmp_path, monkeypatch):
    monkeypatch.setattr(live_feeds, "_AGAIN_NS", 0)
    path, now, changes = tmp_path / "big_blue.sock", [status()], []
    live = Live(Reducer(SPEC), "manager")

    def changed(spec, file):
        changes.append((spec.name, file))
        live.change_to(spec)

    async def follow():
        with manager_on(path, lambda: now[-1]) as control:
            read_in_thread(lambda: FollowedManager(path), live, path, changed)
            await until(lambda: live.snapshot.events == 1)
            now.append(another_status(20))
            control.followers.tell(another_started(19))
            await until(lambda: live.snapshot.t_ns == 20)
        return live.snapshot

    last = asyncio.run(follow())
    assert (last.spec_digest, last.pes.keys()) == (OTHER.digest, OTHER.pes.keys())
    assert changes == [(OTHER.name, shipped_spec_path(OTHER.name))]


class Busy:
    """A feed on which something has always come."""

    spec, spec_file, source, trouble = SPEC, None, "manager", None

    def __init__(self, reader):
        self.reader, self.looks, self.is_over, self.frames = reader, 0, False, []

    def readers(self):
        return [self.reader]

    def poll(self):
        self.looks += 1
        if self.is_over:
            raise OSError
        return []

    def close(self):
        os.close(self.reader)


def test_the_feed_of_a_busy_bus_is_not_looked_at_for_each_frame():
    async def most_and_looks():
        reader, writer = os.pipe()
        os.close(writer)  # so there is always something to read: its end
        feed, live, begun_s = Busy(reader), Live(Reducer(SPEC), "manager"), time.monotonic()
        read_in_thread(lambda: feed, live, None)
        await asyncio.sleep(0.05)
        await until(lambda: feed.looks > 0)
        looks, feed.is_over = feed.looks, True
        most = (time.monotonic() - begun_s) / 0.01 + 1
        await until(lambda: live.trouble is not None)  # the thread has ended
        return most, looks

    most, looks = asyncio.run(most_and_looks())
    assert looks <= most
