"""`heronry top` on a recorded flight, through Textual's pilot and in a pseudo-terminal."""

import asyncio
import os
import pty
import re
import select
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
from textual.widgets import Input, Static

from heronry_manager.events.line import to_line
from heronry_tools.watch.recording import Recording
from heronry_tools.watch.reducer import Reducer
from heronry_tools.watch.snapshot import Plant, Stranger, Transfer
from heronry_tools.watch.top import panels
from heronry_tools.watch.top.app import REPAINT_S, Reading, TopApp
from heronry_tools.watch.top.panels import Look
from heronry_tools.watch.top.sources import LiveSource, RecordedSource
from thoroughness import sample
from watch.flights import ALL, MS, PICTURES, big_blue
from web.flight import big_blue as three_lost_spec
from web.flight import three_lost

pytestmark = pytest.mark.xdist_group("big_blue_log")  # it is flown once

SMALL, LARGE = (80, 24), (200, 50)


def shown(app: TopApp, name: str) -> str:
    return str(app.query_one(f"#{name}", Static).content)


def inside(app: TopApp, name: str) -> bool:
    region = app.query_one(f"#{name}").region
    return (
        region.width > 0 and region.height > 0 and region.right <= app.size.width and region.bottom <= app.size.height
    )


def fly(size: tuple[int, int], play, recording: Recording | None = None) -> None:
    async def run() -> None:
        app = TopApp(RecordedSource(recording or big_blue()))
        async with app.run_test(size=size) as pilot:
            await pilot.pause()
            await play(app, pilot)

    asyncio.run(run())


@pytest.mark.parametrize("size", [SMALL, LARGE])
def test_every_panel_says_what_the_snapshot_says(size: tuple[int, int]) -> None:
    async def play(app: TopApp, pilot) -> None:
        for at_s in sample((0.1, 0.5, 1.2, 1.04, 2.0, 2.6, 3.0), 1 if size == SMALL else 3):
            app.source.move_to(app.source.timeline.begins_ns + round(at_s * 1e9))
            app.paint()
            await pilot.pause()
            view = app.snapshot()
            assert f"epoch {view.epoch if view.epoch is not None else '-'}" in shown(app, "head")
            assert f"{at_s:.2f} of" in shown(app, "head")
            for name, pe in view.pes.items():
                letter = panels._STANDING[pe.standing][0]
                assert any(line.startswith(letter) and name in line for line in shown(app, "pes").splitlines())
            for name, one in view.functions.items():
                if not one.wanted:
                    assert name in shown(app, "functions").splitlines()[-1]
                    continue
                line = next(line for line in shown(app, "functions").splitlines() if f" {name:<16.16} " in line)
                assert line[0] == panels.function_state(one)[0]
            for name in view.buses:
                assert name in shown(app, "buses")
            if view.reconfigurations:
                assert str(view.reconfigurations[-1].epoch) in shown(app, "reconfigurations").splitlines()[1]
            assert view.told[-1].sentence in shown(app, "events")
        for name in ("head", "buses", "pes-scroll", "functions-scroll", "events-box"):
            assert inside(app, name), name
        PICTURES.mkdir(parents=True, exist_ok=True)
        (PICTURES / f"top-{size[0]}x{size[1]}.svg").write_text(app.export_screenshot())

    fly(size, play)


def test_a_small_terminal_shows_one_panel_below_and_a_large_one_all() -> None:
    async def small(app: TopApp, pilot) -> None:
        assert [app.query_one(f"#{name}-box").display for name in ("events", "reconfigurations", "modules")] == [
            True,
            False,
            False,
        ]
        await pilot.press("3")
        assert inside(app, "modules-box")
        await pilot.press("tab")
        assert inside(app, "events-box")

    async def large(app: TopApp, pilot) -> None:
        assert all(inside(app, f"{name}-box") for name in ("events", "reconfigurations", "modules"))

    fly(SMALL, small)
    fly(LARGE, large)


def test_the_keys() -> None:
    async def play(app: TopApp, pilot) -> None:
        first, second = list(app.snapshot().pes)[:2]
        assert app.look.selected == first
        await pilot.press("down")
        assert app.look.selected == second
        await pilot.press("up", "up")
        assert app.look.selected == list(app.snapshot().pes)[-1]
        await pilot.press("d")
        assert isinstance(app.screen, Reading)
        await pilot.press("escape")
        await pilot.press("question_mark")
        assert isinstance(app.screen, Reading)
        await pilot.press("q")
        assert not isinstance(app.screen, Reading)
        await pilot.press("slash")
        app.query_one("#filter", Input).value = "tail_b"
        await pilot.press("enter")
        assert "tail_b" in shown(app, "pes")
        assert "nav" not in shown(app, "pes")
        await pilot.press("left_square_bracket")
        assert app.source.at_ns == app.source.timeline.reconfigurations()[-1].done_ns
        await pilot.press("right_square_bracket", "left", "right", "home")
        assert app.source.at_ns == app.source.timeline.begins_ns
        await pilot.press("end", "p")
        assert "1x" in app.source.note()

    fly(SMALL, play)


def test_a_frozen_picture_stays_while_counting_goes_on() -> None:
    async def play(app: TopApp, pilot) -> None:
        timeline = app.source.timeline
        app.source.move_to(timeline.begins_ns + 500 * MS)
        await pilot.press("space")
        before = shown(app, "events")
        app.source.move_to(timeline.ends_ns)
        app.paint()
        assert shown(app, "events") == before
        assert "FROZEN" in shown(app, "head")
        assert "0 events since" not in shown(app, "head")
        await pilot.press("space")
        assert shown(app, "events") != before

    fly(SMALL, play)


def test_a_live_feed_is_taken_as_it_comes_and_painted_at_most_twice_a_second() -> None:
    events, ours = list(big_blue().events), os.pipe()

    class Feed:
        spec, source, socket, trouble, frames = big_blue().spec, "manager", None, "the manager has gone", []

        def readers(self):
            return [ours[0]] if events else []

        def poll(self):
            return [events.pop(0) for _ in range(min(50, len(events)))]

        def close(self):
            os.close(ours[0])

    async def run() -> None:
        source = LiveSource(Feed())
        app = TopApp(source)
        begun = time.monotonic()
        async with app.run_test(size=SMALL) as pilot:
            os.write(ours[1], b"x")
            while events:
                await pilot.pause(0.05)
            app.paint()
            assert "has gone" in shown(app, "head")
            most = (time.monotonic() - begun) / REPAINT_S + 4  # at the start, at a change of size, by this test
            assert app.repaints <= most
        assert source.snapshot() == Reducer(big_blue().spec).all(big_blue().events).snapshot
        source.close()

    asyncio.run(run())
    os.close(ours[1])


def test_what_is_not_known_is_shown_as_that() -> None:
    view = Reducer(big_blue().spec).start().snapshot
    assert "not heard here" in str(panels.buses(view, 80)[0])
    assert "no PE is selected" in str(panels.modules(view, Look())[0])
    assert "none yet" in str(panels.reconfigurations(view, Look())[-1])
    assert "nothing yet" in str(panels.events(view, Look(), 5)[0])
    assert list(panels.details(view, Look()))[-1].endswith("nothing runs yet")


def test_what_is_coming_is_in_the_head() -> None:
    view = Reducer(big_blue().spec).start().snapshot
    assert panels.coming(view) == []
    transfers = (Transfer("flight", "table", "its table: 512 of 1024 bytes", 50), Transfer("nav", "code", "no bundle"))
    strangers = (Stranger(101, "waits for a table", "arm64, 4 cores", ("a",), "heronry adopt big_blue 101"),)
    coming = replace(view, transfers=transfers, strangers=(*strangers, Stranger(102, "runs for another system")))
    lines = [
        "flight waits for 50 % of its table: its table: 512 of 1024 bytes",
        "nav waits for its code: no bundle",
        "node 101 is not in the spec: it waits for a table (arm64, 4 cores): heronry adopt big_blue 101",
        "node 102 is not in the spec: it runs for another system",
    ]
    assert panels.coming(coming) == lines
    assert [str(line)[2:] for line in panels.head(coming)[1:5]] == lines


def test_a_plant_has_a_line_and_a_letter() -> None:
    view = Reducer(big_blue().spec).start().snapshot
    assert panels.plants(view, Look()) == []
    why = "nothing leads from gyro, which sees it, to servo, which moves it"
    seen = {"pitch": Plant("open", why), "roll": Plant("on_path"), "yaw": Plant()}
    head, *lines = map(str, panels.plants(replace(view, plants=seen), Look()))
    assert head.strip() == "loop through"
    assert [line.split(None, 2)[::2] for line in lines] == [
        ["O", f"open <- {why}"],
        ["C", "closed"],
        ["?", "not known"],
    ]
    assert len(panels.plants(replace(view, plants=seen), Look(words="roll"))) == 2
    notes = str(panels.head(replace(view, plants=seen))[-1])
    assert "the loop through pitch is open" in notes
    assert "yaw" not in notes


def test_the_heads_of_columns_stand_above_them() -> None:
    view = big_blue().timeline().last()
    head, first = (str(line) for line in panels.pes(view, Look())[:2])
    assert len(head) == len(first)
    head, last = (str(line) for line in panels.reconfigurations(view, Look())[:2])
    assert head.index("lost <-") == last.index("lost ")
    assert head.index("m/s/s") == last.index("1/1/3")


def words_on_the_screen(app: TopApp, name: str) -> str:
    """What a user reads in a panel, with one blank between words, wherever lines end."""
    region = app.screen.query_one(f"#{name}").region
    strips = app.screen._compositor.render_strips()[region.y : region.bottom]
    return " ".join(re.sub("[▁-█]", " ", " ".join(strip.crop(region.x, region.right).text for strip in strips)).split())


def test_a_small_terminal_shows_reasons_whole() -> None:
    async def play(app: TopApp, pilot) -> None:
        view = app.snapshot()
        lost = view.functions["servo_watch"]
        assert len(lost.why_not) > SMALL[0]
        assert f"lost: servo_watch <- {lost.why_not}" in words_on_the_screen(app, "head")
        assert "3.00 of 3.00 s lost: " in words_on_the_screen(app, "head"), "long reasons push out no note"
        assert view.pes["tail_b"].why in words_on_the_screen(app, "pes-scroll")
        assert f"only <- {view.functions['parachute'].shortfalls[0]}" in words_on_the_screen(app, "functions-scroll")
        assert "imaging" not in words_on_the_screen(app, "functions-scroll")
        await pilot.press("pagedown")
        await pilot.pause()
        assert f"<- {lost.why_not} d flight_log" in words_on_the_screen(app, "functions-scroll")
        assert "S imaging" in words_on_the_screen(app, "functions-scroll")
        await pilot.press("pageup")
        await pilot.pause()
        assert "imaging" not in words_on_the_screen(app, "functions-scroll")

    fly(SMALL, play)


@pytest.mark.parametrize(("size", "least"), [(SMALL, 2), ((160, 44), None)])
def test_with_three_pes_lost_every_pe_is_seen_and_its_modules_with_all_wires(size, least) -> None:
    async def play(app: TopApp, pilot) -> None:
        await pilot.press("3")
        view = app.snapshot()
        for name, pe in view.pes.items():
            await pilot.pause()
            assert app.look.selected == name
            assert f">{name} " in words_on_the_screen(app, "pes-scroll")
            if pe.standing == "down":
                assert pe.why in words_on_the_screen(app, "pes-scroll")
            seen = words_on_the_screen(app, "modules-box")
            assert f"modules of {name} (CPU {pe.cpu.used}/{pe.cpu.of}," in seen
            for module in pe.modules[:least]:
                wires = ", ".join(dict.fromkeys(wire.producer for wire in view.modules[module].wires.values()))
                assert f"{module} {view.modules[module].mode}{' <- ' if wires else ''}{wires}" in seen
            await pilot.press("down")
        PICTURES.mkdir(parents=True, exist_ok=True)
        (PICTURES / f"top-three-lost-{size[0]}x{size[1]}.svg").write_text(app.export_screenshot())

    fly(size, play, Recording(three_lost_spec(), [], list(three_lost()), "simulator"))


def test_a_real_run_in_a_pseudo_terminal(tmp_path: Path) -> None:
    log = tmp_path / "events.jsonl"  # as a manager tells them: opened without the solver
    log.write_text("".join(to_line(one) + "\n" for one in ALL))
    ours, theirs = pty.openpty()
    environment = {**os.environ, "TERM": "xterm-256color", "COLUMNS": "80", "LINES": "24"}
    typed = [sys.executable, "-m", "heronry_tools", "top", "--log", str(log), "big_blue"]
    process = subprocess.Popen(typed, stdin=theirs, stdout=theirs, stderr=theirs, env=environment)
    os.close(theirs)
    seen, until_s, has_typed = b"", time.monotonic() + 120, False
    while time.monotonic() < until_s and process.poll() is None:
        if select.select([ours], [], [], 0.2)[0]:
            try:
                seen += os.read(ours, 1 << 16)
            except OSError:  # the process has closed its end
                break
        if b"big_blue" in seen:
            os.write(ours, b"q" if has_typed else b"\xff\xfe")  # the second is no UTF-8, and passed over
            has_typed = True
    assert has_typed, seen[-2000:]
    assert process.wait(timeout=30) == 0
    assert b"Traceback" not in seen
    os.close(ours)


def test_it_ends_with_its_terminal(tmp_path: Path) -> None:
    log = tmp_path / "events.jsonl"
    log.write_text("".join(to_line(one) + "\n" for one in ALL))
    ours, theirs = pty.openpty()
    typed = [sys.executable, "-m", "heronry_tools", "top", "--log", str(log), "big_blue"]
    environment = {**os.environ, "TERM": "xterm-256color", "COLUMNS": "80", "LINES": "24"}
    process = subprocess.Popen(typed, stdin=theirs, stdout=theirs, stderr=theirs, env=environment)
    os.close(theirs)
    seen = b""
    while b"big_blue" not in seen:
        assert select.select([ours], [], [], 60)[0]
        seen += os.read(ours, 1 << 16)
    os.close(ours)
    try:
        process.wait(timeout=30)
    finally:
        process.kill()
