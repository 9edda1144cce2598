"""The operator's socket: a permitted caller is answered; another caller, or malformed input, has no effect."""

import json
import os
import resource
import select
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Thread
from typing import Any, get_args

import pytest

from heronry_manager.core.vocabulary import (
    AskStatus,
    AskTraceback,
    ClearElement,
    EnterPhase,
    FailElement,
    OperatorSaid,
    ReleaseTarget,
    Reply,
    RestoreElement,
    RetireElement,
    SetPriority,
    UnlockPe,
)
from heronry_manager.shell import control_client
from heronry_manager.shell.control_client import call, find_socket
from heronry_manager.shell.control_place import ControlError, default_socket
from heronry_manager.shell.control_protocol import (
    LONGEST_ORDER_BYTES,
    Answer,
    FlyScript,
    Reload,
    Spoken,
    order_line,
    read_answer,
    read_order,
)
from heronry_manager.shell.control_socket import MOST_CALLERS, ControlSocket
from heronry_manager.shell.script_orders import ScriptSaid

ORDERS: list[Spoken] = [
    AskStatus(),
    AskTraceback("module:autopilot"),
    EnterPhase("glide"),
    SetPriority("imaging", 90),
    SetPriority("imaging", None),
    FailElement("pe:nav"),
    ClearElement("device:gps"),
    RetireElement("pe:nav"),
    RestoreElement("pe:nav"),
    UnlockPe("pe:nav"),
    FlyScript("G.PruneEdges ();\n"),
    ReleaseTarget(),
    Reload("changed.dg.yaml", "0123456789abcdef"),
    Reload("changed.dg.yaml"),
    Reload("changed.dg.yaml", "0123456789abcdef", for_standby=True),
]


def test_every_order_is_tried_here() -> None:
    assert {type(order) for order in ORDERS} == set(get_args(Spoken))


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A runtime folder of the test's own; gives where the manager of `big_blue` listens."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    return default_socket("big_blue")


@contextmanager
def manager_on(path: Path) -> Iterator[list[OperatorSaid | ScriptSaid]]:
    """A manager that executes every order; gives the orders."""
    heard: list[OperatorSaid | ScriptSaid] = []
    stop_read, stop_write = os.pipe()

    def serve(control: ControlSocket) -> None:
        watched: list[Any] = [*control.readers(), stop_read]
        while stop_read not in select.select(watched, [], [])[0]:
            for said in control.poll():
                heard.append(said)
                control.answer(Reply(said.number, True, "done", {"phase": "glide"}))
            watched = [*control.readers(), stop_read]

    with ControlSocket(path) as control:
        server = Thread(target=serve, args=(control,))
        server.start()
        try:
            yield heard
        finally:
            os.write(stop_write, b"x")
            server.join()
            os.close(stop_read)
            os.close(stop_write)


@pytest.mark.parametrize("order", ORDERS)
def test_an_order_arrives_as_it_was_given_and_is_answered(place: Path, order: Spoken) -> None:
    with manager_on(place) as heard:
        assert call(place, order) == Answer(True, "done", {"phase": "glide"})
    assert [said.order for said in heard] == [order]


def test_the_only_manager_is_found_and_of_two_one_must_be_named(place: Path) -> None:
    with pytest.raises(ControlError, match="no manager runs here"):
        find_socket(None)
    with ControlSocket(place):
        assert find_socket(None) == place
        with ControlSocket(default_socket("other")), pytest.raises(ControlError, match="2 managers: big_blue, other"):
            find_socket(None)
    assert find_socket("big_blue") == place
    assert not place.exists()


def left_behind(path: Path) -> Path:
    """The socket of a manager that was killed."""
    path.parent.mkdir(exist_ok=True, mode=0o700)
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as dead:
        dead.bind(str(path))
    return path


def test_the_socket_of_a_killed_manager_is_no_manager(place: Path) -> None:
    left_behind(default_socket("dead"))
    with pytest.raises(ControlError, match="no manager runs here"):
        find_socket(None)
    with ControlSocket(place):
        assert find_socket(None) == place
        with pytest.raises(ControlError, match=r"no manager listens on .*dead.sock; these run here: big_blue$"):
            find_socket("dead")


def test_a_folder_that_others_can_write_is_not_searched(place: Path) -> None:
    with ControlSocket(place):
        place.parent.chmod(0o777)
        for name in (None, "big_blue"):
            with pytest.raises(ControlError, match="other users can write to it: name the manager's socket"):
                find_socket(name)


def test_another_users_process_gets_no_order(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with manager_on(place) as heard:
        monkeypatch.setattr(os, "getuid", lambda: 4711)
        monkeypatch.setattr(control_client, "user_beyond", lambda _: 815)
        with pytest.raises(ControlError, match=r"another user's \(user ID 815\), so nothing is sent to it; "):
            call(place, AskStatus())
        monkeypatch.undo()
        assert heard == []


def test_a_second_manager_is_told_which_process_listens_there(place: Path) -> None:
    with (
        ControlSocket(place),
        pytest.raises(ControlError, match=rf"process {os.getpid()}\) listens on .*big_blue.sock"),
    ):
        ControlSocket(place)


def test_a_socket_left_behind_by_a_killed_manager_is_taken_over(place: Path) -> None:
    script = (
        "import sys, os, signal; from pathlib import Path; "
        "from heronry_manager.shell.control_socket import ControlSocket; "
        "ControlSocket(Path(sys.argv[1])); os.kill(os.getpid(), signal.SIGKILL)"
    )
    subprocess.run([sys.executable, "-c", script, str(place)], check=False)
    assert place.is_socket()
    with pytest.raises(ControlError, match="no manager listens on"):
        call(place, AskStatus())
    with manager_on(place):
        assert call(place, AskStatus()).done


def test_only_its_owner_can_open_it(place: Path) -> None:
    with ControlSocket(place):
        assert place.stat().st_mode & 0o777 == 0o600
        assert place.parent.stat().st_mode & 0o777 == 0o700


def test_a_folder_that_others_can_write_and_one_that_cannot_be_made_are_refused(tmp_path: Path) -> None:
    shared = tmp_path / "shared"
    shared.mkdir()
    shared.chmod(0o777)
    with pytest.raises(ControlError, match="other users can write to it"):
        ControlSocket(shared / "a.sock")
    (tmp_path / "file").touch()
    with pytest.raises(ControlError, match="name a socket in a folder of your own with --socket"):
        ControlSocket(tmp_path / "file" / "a.sock")


def test_a_path_that_is_too_long_or_taken_by_a_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ControlError, match="longer than 107 bytes"):
        ControlSocket(tmp_path / ("x" * 120))
    (tmp_path / "a.sock").mkdir()
    with pytest.raises(ControlError, match=r"a\.sock"):
        ControlSocket(tmp_path / "a.sock")
    (tmp_path / "b.sock.lock").mkdir()
    with pytest.raises(ControlError, match=r"b\.sock\.lock"):
        ControlSocket(tmp_path / "b.sock")


def caller_of(path: Path) -> socket.socket:
    caller = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    caller.settimeout(10)
    caller.connect(str(path))
    return caller


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        (b"hello\n", "this is no order"),
        (b"[" * 3000 + b"\n", "this is no order"),
        (b'{"v": 1, "do": "explode"}\n', "this is no order"),
        (b'{"v": 1, "do": "fail"}\n', "this is no order"),
        (b'{"v": 2, "do": "status"}\n', "version 1 of the control protocol, not 2"),
    ],
)
def test_nonsense_is_answered_with_what_an_order_looks_like(place: Path, line: bytes, sentence: str) -> None:
    with manager_on(place) as heard, caller_of(place) as caller, caller.makefile("rb") as replies:
        caller.sendall(line)
        answer = read_answer(replies.readline())
        assert answer is not None
        assert not answer.done
        assert sentence in answer.sentence
        caller.sendall(order_line(AskStatus()))
        assert json.loads(replies.readline())["done"]
    assert len(heard) == 1


def test_a_caller_that_never_ends_a_line_is_hung_up_on_and_others_are_heard(place: Path) -> None:
    with manager_on(place), caller_of(place) as caller:
        caller.sendall(b"x" * LONGEST_ORDER_BYTES)
        caller.sendall(b"x")
        assert caller.recv(1) == b""
        assert call(place, AskStatus()).done


def test_an_order_that_no_manager_takes_is_not_sent(place: Path) -> None:
    with manager_on(place) as heard:
        with pytest.raises(ControlError, match=r"the order has 3000\d\d bytes, and a manager takes at most 65536"):
            call(place, FlyScript("x" * 300_000))
        assert call(place, AskStatus()).done
    assert len(heard) == 1


def test_a_manager_that_hangs_up_was_there(place: Path) -> None:
    with ControlSocket(place) as control, caller_of(place):

        def hang_up() -> None:
            while len(control.readers()) < 3:
                control.poll()
            control.close()

        hanging = Thread(target=hang_up)
        hanging.start()
        with pytest.raises(ControlError, match=r"has closed the connection|is no manager of this version"):
            call(place, AskStatus())
        hanging.join()


def test_the_caller_that_has_been_idle_for_longest_makes_room(place: Path) -> None:
    with manager_on(place):
        callers = [caller_of(place) for _ in range(MOST_CALLERS)]
        for caller in reversed(callers):  # the last one has spoken first
            caller.sendall(order_line(AskStatus()))
            assert caller.recv(1)
        assert call(place, AskStatus()).done
        while callers[-1].recv(1 << 16):
            pass
        callers[0].sendall(order_line(AskStatus()))
        assert callers[0].recv(1)
        for caller in callers:
            caller.close()


def test_who_waits_for_an_answer_makes_no_room(place: Path) -> None:
    with ControlSocket(place) as control:
        callers, said = [], 0
        for _ in range(MOST_CALLERS):
            callers.append(caller_of(place))
            callers[-1].sendall(order_line(AskStatus()))
        while said < MOST_CALLERS:
            said += len(control.poll())
        with caller_of(place) as late:
            control.poll()
            assert late.recv(1) == b""
        for caller in callers:
            caller.close()


def test_each_turn_takes_one_order_and_no_caller_delays_another(place: Path) -> None:
    with ControlSocket(place) as control, caller_of(place) as many, caller_of(place) as one:
        many.sendall(order_line(AskStatus()) * 1000)
        first: list[OperatorSaid | ScriptSaid] = []
        while not first:
            first = control.poll()
        one.sendall(order_line(ReleaseTarget()))
        control.answer(Reply(first[0].number, True, "done"))
        turns = [control.poll(), control.poll()]
        assert [len(said) for said in turns] == [1, 1]
        assert ReleaseTarget() in [said[0].order for said in turns]


def test_the_next_order_of_a_caller_waits_for_the_answer_to_its_last(place: Path) -> None:
    with ControlSocket(place) as control, caller_of(place) as caller:
        caller.sendall(order_line(AskTraceback("module:imu")) + order_line(AskStatus()))
        said: list[OperatorSaid | ScriptSaid] = []
        while not said:
            said = control.poll()
        assert (control.has_orders, control.poll()) == (False, [])
        control.answer(Reply(said[0].number, True, "a traceback"))
        assert control.has_orders
        assert [one.order for one in control.poll()] == [AskStatus()]


def test_where_orders_of_all_callers_wait_the_longest_lines_make_room(place: Path) -> None:
    with ControlSocket(place) as control:
        callers = []
        for number in range(MOST_CALLERS):
            callers.append(caller_of(place))
            callers[-1].sendall(b"\n" * (2000 if number == 5 else 500))
            control.poll()
        for _ in range(3):
            control.poll()
        with caller_of(place) as late:
            late.sendall(order_line(AskStatus()))
            while not control.poll():
                pass
        with pytest.raises(ConnectionError):
            callers[5].sendall(b"\n")
        for caller in callers:
            caller.close()


@contextmanager
def no_descriptor_left() -> Iterator[None]:
    """Leave this process no descriptor."""
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (200, before[1]))
    taken = []
    try:
        while True:
            taken.append(os.open(os.devnull, os.O_RDONLY))
    except OSError:
        yield
    finally:
        for one in taken:
            os.close(one)
        resource.setrlimit(resource.RLIMIT_NOFILE, before)


@pytest.mark.parametrize("has_idle", [True, False])
def test_without_a_descriptor_an_idle_caller_makes_room_and_nobody_stays_in_the_queue(
    place: Path, has_idle: bool
) -> None:
    with ControlSocket(place) as control, caller_of(place) as first:
        control.poll()
        if not has_idle:
            first.sendall(order_line(AskStatus()))
            (unanswered,) = control.poll()
        with caller_of(place) as operator:
            with no_descriptor_left():
                control.poll()
                assert not select.select([control.readers()[0]], [], [], 0)[0]
                dropped, kept = (first, operator) if has_idle else (operator, first)
                assert dropped.recv(1) == b""
                if not has_idle:
                    control.answer(Reply(unanswered.number, True, "done"))
                kept.sendall(order_line(AskStatus()))
                assert len(control.poll()) == 1
            with caller_of(place) as later:
                later.sendall(order_line(AskStatus()))
                while not control.poll():
                    pass


def test_where_nothing_could_be_reserved_a_caller_waits_for_the_first_free_descriptor(place: Path) -> None:
    with ControlSocket(place) as control, caller_of(place) as caller:
        assert control._reserve is not None
        os.close(control._reserve)
        control._reserve = None
        with no_descriptor_left():
            control.poll()
        caller.sendall(order_line(AskStatus()))
        while not control.poll():
            pass


def test_an_answer_controls_no_terminal() -> None:
    line = json.dumps(
        {"v": 1, "done": True, "sentence": "a\x1b[2Jb\x9b\tc\nd", "status": {"x\x07": ["\x1b]0;", 3, None, "ok"]}}
    )
    answer = read_answer(line.encode())
    assert answer == Answer(True, "a\\x1b[2Jb\\x9b\tc\nd", {"x\\x07": ["\\x1b]0;", 3, None, "ok"]})


def test_a_caller_that_hangs_up_before_the_answer_gets_none(place: Path) -> None:
    with ControlSocket(place) as control:
        caller = caller_of(place)
        caller.sendall(order_line(AskStatus()))
        said = control.poll()
        while not said:
            said = control.poll()
        caller.close()
        control.answer(Reply(said[0].number, True, "done"))
        control.answer(Reply(said[0].number, True, "done"))
        assert control.poll() == []


def test_a_manager_that_does_not_answer_and_one_that_is_none(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(control_client, "PATIENCE_S", 0.01)
    with ControlSocket(place), pytest.raises(ControlError, match="does not answer"):
        call(place, AskStatus())
    place.parent.mkdir(exist_ok=True)
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as other:
        other.bind(str(place))
        other.listen()
        monkeypatch.setattr(control_client, "PATIENCE_S", 10)

        def hang_up() -> None:
            with other.accept()[0] as caller:
                caller.recv(100)
                caller.sendall(b"{}\n")

        server = Thread(target=hang_up)
        server.start()
        with pytest.raises(ControlError, match="is no manager of this version"):
            call(place, AskStatus())
        server.join()


@pytest.mark.parametrize("order", ORDERS)
def test_what_is_written_is_read_back(order: Spoken) -> None:
    assert read_order(order_line(order)) == order
