"""Orders from `heronry top`, through Textual's pilot, to a manager's core and a demo behind their real sockets."""

import asyncio
import threading
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest
from textual.widgets import Input, OptionList, TextArea

from heronry_dg.loader import load
from heronry_manager.core.vocabulary import Reply
from heronry_manager.events import Place, Status
from heronry_manager.shell.control_protocol import ORDER_NAMES, FlyScript
from heronry_manager.shell.control_socket import ControlSocket
from heronry_manager.shell.script_orders import ScriptSaid
from heronry_tools.watch.live_feeds import FollowedManager
from heronry_tools.watch.offered_orders import ORDERS
from heronry_tools.watch.snapshot import Script as ScriptShown
from heronry_tools.watch.top.app import Reading, TopApp
from heronry_tools.watch.top.order_pages import Choice, Number, Question, Script
from heronry_tools.watch.top.orders import Operator, Order
from heronry_tools.watch.top.sources import LiveSource, RecordedSource
from manager.one_manager import SPEC_TEXT, OneManager
from manager.test_script_orders import MOVED
from tools.test_process_orders import Demo
from watch.flights import PICTURES, big_blue
from watch.test_top import LARGE, SMALL, shown, words_on_the_screen

PHASES = "phases: {climb: {}, glide: {}}\n"
LEFT_AT = {Choice: ("escape",), Question: ("n", "escape", "q")}  # a page, and the keys that leave it


class Manager:
    """A manager's core of three PEs behind a socket; `orders` are those that have come."""

    def __init__(self, folder: Path) -> None:
        file = folder / "two_tails.dg.yaml"
        file.write_text(SPEC_TEXT + PHASES)
        self.path, self.orders = folder / "two_tails.sock", []
        self.may_answer = threading.Event()
        self.may_answer.set()
        self._core = OneManager(load(file))
        self._core.start()
        place = Place("can0", "softbus", "/no/such.sock")
        self._first = Status(self._core.now_ns, self._core.core.status(), plan=None, bus=place, file=str(file))

    @contextmanager
    def listening(self):
        over = threading.Event()

        def serve(control: ControlSocket) -> None:
            while not over.wait(0.005):
                for said in control.poll():
                    self.orders.append(said.order)
                    self.may_answer.wait()
                    told = len(self._core.events)
                    is_script = isinstance(said, ScriptSaid)
                    asked = said.target(self._core.spec, self._core.core) if is_script else said
                    for action in self._core.give(asked):
                        if isinstance(action, Reply):
                            control.answer(action)
                    for event in self._core.events[told:]:
                        control.followers.tell(event)
                control.followers.pump(lambda: self._first)

        with ControlSocket(self.path) as control:
            server = threading.Thread(target=serve, args=(control,))
            server.start()
            try:
                yield self
            finally:
                over.set()
                server.join()


def give(managed, size, play) -> Manager:
    """Play at a manager, or at a new one in a folder."""
    manager = managed if isinstance(managed, Manager) else Manager(managed)

    async def run() -> None:
        source = LiveSource(FollowedManager(manager.path))
        app = TopApp(source)
        async with app.run_test(size=size) as pilot:
            while not app.snapshot().events:
                await pilot.pause(0.02)
            app.paint()
            await pilot.pause()
            await play(app, pilot)
        source.close()

    with manager.listening():
        asyncio.run(run())
    return manager


async def until(pilot, holds) -> None:
    async with asyncio.timeout(30):
        while not holds():
            await pilot.pause(0.02)


def listed(app) -> list[str]:
    orders = app.screen.query_one(OptionList)
    return [str(orders.get_option_at_index(at).prompt) for at in range(orders.option_count)]


async def choose(app, pilot, letters) -> None:
    await pilot.press("o")
    await until(pilot, lambda: isinstance(app.screen, Choice))
    app.screen.query_one(Input).value = letters
    await pilot.pause()
    await pilot.press("enter")


@pytest.mark.parametrize("size", [SMALL, LARGE])
def test_an_order_is_chosen_confirmed_and_answered(tmp_path, size) -> None:
    async def play(app, pilot) -> None:
        assert app.look.selected == "left"
        await pilot.press("o")
        await until(pilot, lambda: isinstance(app.screen, Choice))
        assert listed(app)[:2] == ["Fail pe:left", "Retire pe:left"]
        PICTURES.mkdir(parents=True, exist_ok=True)
        (PICTURES / f"top-orders-{size[0]}x{size[1]}.svg").write_text(app.export_screenshot())
        await pilot.press(*"fail pe:", "down", "down", "up", "enter")
        await until(pilot, lambda: isinstance(app.screen, Question))
        asked = words_on_the_screen(app, "page")
        assert "Plan without pe:middle, whatever is heard of it?" in asked
        assert "y gives the order, n leaves it." in asked
        (PICTURES / f"top-question-{size[0]}x{size[1]}.svg").write_text(app.export_screenshot())
        await pilot.press("o", "space")  # no key of the panels
        await pilot.press("y")
        await until(pilot, lambda: "pe:middle counts as failed until it is cleared" in shown(app, "head"))
        await until(pilot, lambda: [one.element for one in app.snapshot().faults] == ["pe:middle"])
        await pilot.press("o")
        await until(pilot, lambda: isinstance(app.screen, Choice))
        assert "Clear pe:middle" in listed(app)
        assert "Fail pe:middle" not in listed(app)

    manager = give(tmp_path, size, play)
    assert [(type(one).__name__, one.element) for one in manager.orders] == [("FailElement", "pe:middle")]


def test_a_second_order_waits_for_the_answer_to_the_first(tmp_path) -> None:
    async def play(app, pilot) -> None:
        manager.may_answer.clear()
        await pilot.press("o")
        await until(pilot, lambda: isinstance(app.screen, Choice))
        await pilot.press("enter")
        await until(pilot, lambda: isinstance(app.screen, Question))
        await pilot.press("y")
        await until(pilot, lambda: manager.orders)
        await pilot.press("o")
        await until(pilot, lambda: "the last order is not answered yet" in shown(app, "head"))
        assert len(app.screen_stack) == 1
        manager.may_answer.set()
        await until(pilot, lambda: "pe:left counts as failed until it is cleared" in shown(app, "head"))
        await pilot.press("o")
        await until(pilot, lambda: isinstance(app.screen, Choice))

    manager = Manager(tmp_path)
    give(manager, SMALL, play)


def test_an_order_that_is_left_at_any_page_is_not_given(tmp_path) -> None:
    async def play(app, pilot) -> None:
        for page, key in ((page, key) for page, keys in LEFT_AT.items() for key in keys):
            await pilot.press("o")
            await until(pilot, lambda: isinstance(app.screen, Choice))
            if page is Question:
                await pilot.press("enter")
                await until(pilot, lambda: isinstance(app.screen, Question))
            await pilot.press(key)
            await until(pilot, lambda: len(app.screen_stack) == 1)
        await pilot.press("o")
        await until(pilot, lambda: isinstance(app.screen, Choice))
        await pilot.press(*"none of them", "down", "enter", "escape")
        await until(pilot, lambda: len(app.screen_stack) == 1)
        await pilot.press("question_mark")
        await until(pilot, lambda: isinstance(app.screen, Reading))
        assert "give an order to the manager, or to the demo, after a question" in words_on_the_screen(app, "page")

    assert give(tmp_path, SMALL, play).orders == []


def test_a_priority_is_asked_for_and_a_phase_entered(tmp_path) -> None:
    async def play(app, pilot) -> None:
        for typed in ("7", "default"):
            await choose(app, pilot, "priority of elevator")
            await until(pilot, lambda: isinstance(app.screen, Number))
            await pilot.press(*"40000", "enter")
            assert "40000 is no priority" in words_on_the_screen(app, "wrong")
            app.screen.query_one(Input).value = typed
            await pilot.press("enter")
            await until(pilot, lambda: isinstance(app.screen, Question))
            await pilot.press("y")
            said = f"the priority of elevator is {'that of the spec' if typed == 'default' else typed} from now on"
            await until(pilot, partial(lambda said: said in shown(app, "head"), said))
        await choose(app, pilot, "enter glide")
        await until(pilot, lambda: isinstance(app.screen, Question))
        await pilot.press("y")
        await until(pilot, lambda: app.snapshot().phase == "glide")

    manager = give(tmp_path, SMALL, play)
    assert [getattr(one, "priority", one) for one in manager.orders[:2]] == [7, None]


def test_every_kind_is_an_order_of_the_socket_and_a_manager_that_has_gone_is_named(tmp_path) -> None:
    operator = Operator(big_blue().spec, tmp_path / "none.sock")
    for kind in ORDER_NAMES:
        assert "no manager listens" in operator.give(Order(kind, "pe:nav", 5 if kind == "priority" else None))


def test_a_script_is_typed_shown_and_flown(tmp_path) -> None:
    async def begin(app, pilot) -> None:
        await choose(app, pilot, "fly the script")
        await until(pilot, lambda: isinstance(app.screen, Script))

    async def play(app, pilot) -> None:
        await begin(app, pilot)
        await pilot.press("ctrl+s")
        assert "there is no statement yet" in words_on_the_screen(app, "wrong")
        await pilot.press("q", "o", "escape")
        await until(pilot, lambda: len(app.screen_stack) == 1)
        await begin(app, pilot)
        app.screen.query_one(TextArea).insert(MOVED)
        await pilot.pause()
        (PICTURES / "top-script-80x24.svg").write_text(app.export_screenshot())
        await pilot.press("ctrl+s")
        await until(pilot, lambda: isinstance(app.screen, Question))
        assert 'control = G.CreateComponent ( "state_estimator@middle" );' in words_on_the_screen(app, "page")
        await pilot.press("y")
        await until(pilot, lambda: "the script leads to a legal configuration" in shown(app, "head"))

    manager = Manager(tmp_path)
    give(manager, SMALL, play)
    assert manager.orders == [FlyScript(MOVED)]


def test_a_process_of_a_demo_is_killed_after_a_question(tmp_path) -> None:
    async def play(app, pilot) -> None:
        await choose(app, pilot, "kill pe:middle")
        await until(pilot, lambda: isinstance(app.screen, Question))
        assert "Kill the process of pe:middle (SIGKILL)?" in words_on_the_screen(app, "page")
        assert demo.done == []
        await pilot.press("y")
        await until(pilot, lambda: "pe:middle: kill" in shown(app, "head"))

    manager = Manager(tmp_path)
    demo = Demo(manager.path)
    demo.running = {"left", "middle", "right"}
    with demo.looping():
        give(manager, SMALL, play)
    assert demo.done == [("kill", "middle")]


def test_top_gives_the_orders_of_the_page_and_those_to_a_demo_only_beside_one(tmp_path) -> None:
    socket, view = tmp_path / "none.sock", big_blue().timeline().last()
    alone = {order.do for order in Operator(big_blue().spec, socket).offered(view, "nav")}
    with Demo(socket).looping():
        beside = {order.do for order in Operator(big_blue().spec, socket).offered(view, "nav")}
    assert beside - alone == {"kill", "start"}
    with Demo(socket).looping():
        operator = Operator(big_blue().spec, socket)
        held = {order.do for order in operator.offered(replace(view, script=ScriptShown("held")), "nav")}
    assert (alone | beside | held) == ORDERS.keys() - {
        "clear",
        "restore",
        "unlock",
    }  # no fault is latched, and there is no key


def test_a_recording_takes_no_orders() -> None:
    async def run() -> None:
        app = TopApp(RecordedSource(big_blue()))
        async with app.run_test(size=SMALL) as pilot:
            await pilot.press("o")
            await pilot.pause()
            assert not isinstance(app.screen, Choice)

    asyncio.run(run())
