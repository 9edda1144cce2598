"""The orders to a demo, from both ends of its socket: what is carried out, refused, lost, and given twice."""

import json
import select
import socket
import threading
from contextlib import contextmanager
from pathlib import Path

import pytest

from heronry_manager.shell.control_place import ControlError, standby_of
from heronry_tools.console.errors import UserError
from heronry_tools.runtime.demo.process_orders import MOST_CALLERS, ProcessOrders, order_demo, takes_orders


class Demo:
    """A demo of two PEs, `left` and `right`, whose loop does nothing but take orders."""

    def __init__(self, manager: Path) -> None:
        self.manager, self.running, self.done = manager, {"left", "right"}, []

    def do(self, what: str, pe: str) -> str:
        if (what == "kill") != (pe in self.running):
            raise UserError(f"pe:{pe} does not run" if what == "kill" else f"pe:{pe} runs")
        (self.running.discard if what == "kill" else self.running.add)(pe)
        self.done.append((what, pe))
        return f"pe:{pe}: {what}"

    @contextmanager
    def looping(self):
        over = threading.Event()

        def loop(orders: ProcessOrders) -> None:
            while not over.is_set():
                orders.execute(select.select(orders.readers(), [], [], 0.01)[0], self.do)

        with ProcessOrders(self.manager) as orders:
            thread = threading.Thread(target=loop, args=(orders,))
            thread.start()
            try:
                yield orders
            finally:
                over.set()
                thread.join()


def caller(manager: Path) -> socket.socket:
    line = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    line.settimeout(20)
    line.connect(f"{manager}.demo")
    return line


@pytest.fixture
def manager(tmp_path) -> Path:
    return tmp_path / "two-demo.sock"


def test_a_process_is_killed_and_started_and_a_second_time_refused(manager) -> None:
    demo = Demo(manager)
    with demo.looping():
        assert takes_orders(manager)
        killed = order_demo(manager, "kill", "pe:left")
        assert (killed.done, killed.sentence) == (True, "pe:left: kill")
        again = order_demo(manager, "kill", "pe:left")
        assert (again.done, again.sentence) == (False, "pe:left does not run")
        assert order_demo(standby_of(manager), "start", "pe:left").done  # a view may follow the standby manager
    assert demo.done == [("kill", "left"), ("restore", "left")]


def test_what_is_no_order_is_refused_with_a_sentence(manager) -> None:
    demo = Demo(manager)
    with demo.looping():
        for text in ("[", "[1]", '{"do": "fail", "what": "pe:left"}', '{"do": "kill"}', "\xff", "[" * 50_000):
            with caller(manager) as line:
                line.send(text.encode("latin-1"))
                answer = json.loads(line.recv(4096))
                assert not answer["done"]
                assert "no order to a demo" in answer["sentence"]
                assert line.recv(4096) == b""
    assert demo.done == []


def test_callers_that_say_nothing_or_have_gone_hold_nobody_up(manager) -> None:
    demo = Demo(manager)
    with demo.looping():
        silent = [caller(manager) for _ in range(MOST_CALLERS + 1)]
        with caller(manager) as gone:
            gone.send(b'{"do": "kill", "what": "pe:right"}')
        assert order_demo(manager, "kill", "pe:left").done
        for one in silent[:2]:
            assert one.recv(4096) == b""  # made room
        for one in silent:
            one.close()
    assert ("kill", "right") in demo.done


def test_a_demo_that_has_ended_or_was_killed_takes_none_and_the_next_one_does(manager) -> None:
    assert not takes_orders(manager)
    with Demo(manager).looping():
        pass
    assert not Path(f"{manager}.demo").exists()
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as left_behind:
        left_behind.bind(f"{manager}.demo")
    assert not takes_orders(manager)
    assert "has it ended?" in order_demo(manager, "kill", "pe:left").sentence
    with Demo(manager).looping():
        assert order_demo(manager, "kill", "pe:left").done


def test_a_place_that_cannot_be_used_is_named(tmp_path) -> None:
    with pytest.raises(UserError, match=r"none/a\.sock\.demo: No such file or directory"):
        ProcessOrders(tmp_path / "none" / "a.sock")
    with pytest.raises(ControlError, match="is longer than 107 bytes"):
        ProcessOrders(tmp_path / ("a" * 110))
