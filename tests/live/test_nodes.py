"""Manager and PEs as processes on a bus, with foreign nodes: a CANopen master, a CANaerospace tool, a second manager.

Also mistakes of the user who starts them: each gives one sentence on standard error and an exit code, and no traceback.
"""

import os
import re
import select
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import count
from pathlib import Path
from typing import Any, Self

import can
import canopen
import pytest

from heronry_agent.shell.cli import main as pe_agent
from heronry_dg.loader import load
from heronry_manager import events
from heronry_manager.events.reading import events_in
from heronry_tools.cli import main
from heronry_tools.runtime.softbus.starter import start_hub
from heronry_tools.runtime.table_files import write_tables
from heronry_wire.frame import Frame
from heronry_wire.identifiers import Command, management_id, state_id
from heronry_wire.management import FaultCode
from heronry_wire.node_services import (
    Identification,
    Service,
    ServiceMessage,
    decode_service,
    encode_service,
    read_identification,
    request,
    service_id,
)
from heronry_wire.state_frames import PeState, StatePage0, decode_state
from live.told_events import E

pytestmark = pytest.mark.live

PATIENCE_S = 30.0
ROOT = Path(__file__).resolve().parents[2]
TESTS = ROOT / "tests"
SPEC_FILE = ROOT / "dg_specs" / "elevator_and_chute.dg.yaml"
MANAGER = [sys.executable, "-m", "heronry_tools", "manager"]
AGENT = [sys.executable, "-m", "heronry_agent", "--simulated"]
BOOT_UP, PRE_OPERATIONAL = 0x00, 0x7F


class Process:
    """A manager or an agent, and its output."""

    def __init__(self, *arguments: str) -> None:
        self.process = subprocess.Popen(
            arguments,
            stdin=subprocess.PIPE,  # held open: they are started to end with it
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env={**os.environ, "PYTHONPATH": os.pathsep.join([os.environ.get("PYTHONPATH", ""), str(TESTS)])},
        )
        self._unread = b""

    def event(self, *kinds: type[E]) -> E:
        """Return a manager's next event of one of these kinds."""
        last = self.events_until(*kinds)[-1]
        assert isinstance(last, kinds)
        return last

    def events_until(self, *kinds: type[events.Event]) -> list[events.Event]:
        """Return a manager's events up to the next one of these kinds."""
        assert self.process.stdout is not None
        come: list[events.Event] = []
        while True:
            line, newline, rest = self._unread.partition(b"\n")
            if not newline:
                assert select.select([self.process.stdout], [], [], PATIENCE_S)[0], f"none of {kinds} comes"
                chunk = os.read(self.process.stdout.fileno(), 65536)
                assert chunk, f"it ended before {kinds}"
                self._unread += chunk
                continue
            self._unread = rest
            come += events_in([line])
            if come and isinstance(come[-1], kinds):
                return come

    def kill(self) -> None:
        """End it as a crash would."""
        self.process.kill()
        self.process.communicate()

    def end(self) -> tuple[int, list[str]]:
        """Wait for its end, which must come by itself: exit code, and what it said on standard error."""
        self.process.wait(PATIENCE_S)
        _, said = self.process.communicate()
        return self.process.returncode, said.decode().splitlines()


class Aircraft:
    """A hub, a spec's manager and agents on it, and the test's own place on the bus; at its end all are gone."""

    def __init__(self, folder: Path, spec_file: Path = SPEC_FILE) -> None:
        self.folder, self.spec_file, self.spec = folder, spec_file, load(spec_file)
        self.hub = start_hub(folder / "can0.sock", 1_000_000)
        self.bus_flags = ["-i", "softbus", "-c", str(folder / "can0.sock")]
        self.bus = can.Bus(interface="softbus", channel=str(folder / "can0.sock"))
        self._tables = write_tables(self.spec, self.spec.pes, folder)
        self._started: list[Process] = []
        self._managers = count()

    def start_manager(self, *more: str, program: Sequence[str] = MANAGER) -> Process:
        arguments = [str(self.spec_file), *self.bus_flags, "--contingencies", "none", "--json", "--until-eof"]
        own_socket = self.folder / f"manager-{next(self._managers)}.sock"  # two of them are no rivals for that
        arguments += ["--socket", str(own_socket)]
        return self._start(*program, *arguments, "--state-dir", str(self.folder / "state"), *more)

    def start_agents(self) -> list[Process]:
        return [
            self._start(*AGENT, "--table", str(table), *self.bus_flags, "--until-eof", "--quiet")
            for table in self._tables.values()
        ]

    def hear(self, wanted: Callable[[Frame], bool]) -> Frame:
        """Return the next wanted frame."""
        until_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < until_s:
            message = self.bus.recv(PATIENCE_S)
            assert message is not None, "the bus is silent"
            frame = Frame(message.arbitration_id, bytes(message.data))
            if wanted(frame):
                return frame
        raise AssertionError("what is wanted is not heard")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        for process in self._started:
            process.kill()
        self.bus.shutdown()
        self.hub.close()

    def _start(self, *arguments: str) -> Process:
        self._started.append(Process(*arguments))
        return self._started[-1]


@pytest.fixture
def aircraft(tmp_path: Path) -> Iterator[Aircraft]:
    with Aircraft(tmp_path) as aircraft:
        yield aircraft


class CanopenMaster:
    """The `canopen` package as a user would use it; what it hears, by node-ID."""

    def __init__(self, aircraft: Aircraft) -> None:
        self.heartbeats: defaultdict[int, list[int]] = defaultdict(list)
        self.emergencies: defaultdict[int, list[canopen.emcy.EmcyError]] = defaultdict(list)
        self._link_events, self._wake = os.pipe()
        self.network = canopen.Network()
        for pe in aircraft.spec.pes.values():
            node = self.network.add_node(pe.node_id, canopen.ObjectDictionary())  # type: ignore[no-untyped-call]
            node.nmt.add_heartbeat_callback(self._noting(self.heartbeats[pe.node_id]))
            node.emcy.add_callback(self._noting(self.emergencies[pe.node_id]))
        self.network.connect(interface="softbus", channel=str(aircraft.folder / "can0.sock"))

    def wait_until(self, what: Callable[[], bool]) -> None:
        until_s = time.monotonic() + PATIENCE_S
        while not what():
            left_s = max(0.0, until_s - time.monotonic())
            assert select.select([self._link_events], [], [], left_s)[0], "the CANopen master waits in vain"
            os.read(self._link_events, 4096)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.network.disconnect()
        os.close(self._link_events)
        os.close(self._wake)

    def _noting(self, place: list[Any]) -> Callable[[Any], None]:
        def note(one: Any) -> None:
            place.append(one)
            os.write(self._wake, b"!")

        return note


def faults_of(told: Iterable[list[canopen.emcy.EmcyError]]) -> list[canopen.emcy.EmcyError]:
    """The EMCYs that report a fault: a module that starts after its reader makes it report a silence at first."""
    return [one for of_node in told for one in of_node if one.code != FaultCode.STALE]


def test_a_canopen_master_hears_boot_up_and_heartbeats_and_every_node_identifies_itself(aircraft: Aircraft) -> None:
    """A node answers a request by its node-ID, and one to all nodes (CANaerospace IDS on channel 0)."""
    with CanopenMaster(aircraft) as master:
        heard = master.heartbeats
        aircraft.start_agents()
        master.wait_until(lambda: all(PRE_OPERATIONAL in states for states in heard.values()))
        assert {tuple(states[:2]) for states in heard.values()} == {(BOOT_UP, PRE_OPERATIONAL)}
        aircraft.start_manager().event(events.Reconfigured)
        master.wait_until(lambda: {node.nmt.state for node in master.network.values()} == {"OPERATIONAL"})
        assert not any(faults_of(master.emergencies.values()))
    nodes = [126, *(pe.node_id for pe in aircraft.spec.pes.values())]
    own = Identification(hardware_revision=0, software_revision=1)
    for code, node in enumerate(nodes):
        assert answers(aircraft, request(Service.IDS, node, message_code=code), 1) == {node: own}
    assert answers(aircraft, request(Service.IDS, 0, message_code=200), len(nodes)) == dict.fromkeys(nodes, own)


def test_a_canopen_master_hears_the_emcy_of_a_module_that_fails(tmp_path: Path) -> None:
    """A driver raises again and again: EMCY, and a plan without it that runs."""
    file = tmp_path / "failing.dg.yaml"
    own_code = "pressure_driver: {image: 'agent.modules_for_host:Raising', "
    file.write_text(SPEC_FILE.read_text().replace("pressure_driver: {", own_code))
    with Aircraft(tmp_path, file) as aircraft, CanopenMaster(aircraft) as master:
        aircraft.start_agents()
        manager = aircraft.start_manager()
        node = aircraft.spec.pes["sensor_pe"].node_id
        master.wait_until(lambda: FaultCode.MODULE_EXCEPTION in {e.code for e in master.emergencies[node]})
        first, *_ = faults_of([master.emergencies[node]])
        assert first.code == FaultCode.MODULE_RESTARTED
        assert first.register & 1
        assert manager.event(events.FaultReported).element == "module:pressure_driver"
        assert "pressure_driver" not in manager.event(events.PlanReady).plan.modules
        manager.event(events.Reconfigured)
        assert [n for n, emergencies in master.emergencies.items() if faults_of([emergencies])] == [node]


def answers(aircraft: Aircraft, asked: ServiceMessage, count: int) -> dict[int, Identification]:
    """Send a request, and return the answers by node-ID."""
    frame = encode_service(asked)
    aircraft.bus.send(can.Message(arbitration_id=frame.can_id, data=frame.data, is_extended_id=False))
    found: dict[int, Identification] = {}
    while len(found) < count:
        answer = decode_service(aircraft.hear(lambda f: f.can_id == service_id(0, is_answer=True)))
        assert isinstance(answer, ServiceMessage)
        assert answer.datum.message_code == asked.datum.message_code
        identification = read_identification(answer)
        assert isinstance(identification, Identification)
        found[answer.datum.node_id] = identification
    return found


@pytest.mark.timing
def test_a_manager_that_was_killed_comes_back_with_a_higher_term_and_no_pe_reboots(aircraft: Aircraft) -> None:
    aircraft.start_agents()
    first = aircraft.start_manager()
    assert first.event(events.ManagerStarted).term == 1
    before = first.event(events.Reconfigured).epoch
    incarnations = {pe: running_state(aircraft, pe, PeState.ACTIVE).incarnation for pe in aircraft.spec.pes}
    first.kill()

    second = aircraft.start_manager()
    assert second.event(events.ManagerStarted).term == 3  # the next one that is its own
    match second.event(events.Reconfigured, events.Adopted):
        case events.Adopted(epoch=after):  # what runs is adopted where it is what would be planned now
            assert after >= before
        case events.Reconfigured(epoch=after):
            assert after > before
    for pe, incarnation in incarnations.items():
        state = running_state(aircraft, pe, PeState.ACTIVE, after)
        assert state.incarnation == incarnation


def running_state(aircraft: Aircraft, pe: str, wanted: PeState, epoch: int = 0) -> StatePage0:
    """Wait until a PE reports a state, in this epoch or a later one; on the way it must be configured."""
    own = state_id(aircraft.spec.pes[pe].node_id)
    while True:
        page = decode_state(aircraft.hear(lambda frame: frame.can_id == own).data)
        if isinstance(page, StatePage0) and page.state is wanted and page.epoch >= epoch:
            return page
        assert not (epoch and isinstance(page, StatePage0) and page.state is PeState.UNCONFIGURED)


@pytest.mark.timing
def test_a_loss_that_was_pre_planned_is_reported_in_order(aircraft: Aircraft) -> None:
    agents = aircraft.start_agents()
    manager = aircraft.start_manager()
    manager.event(events.Reconfigured)
    for _ in range(100):  # time for pre-planning
        aircraft.hear(lambda frame: frame.can_id == management_id(126, Command.LEASE))
    agents[-1].kill()
    kinds = [event.kind for event in manager.events_until(events.Reconfigured)]
    steps = ["pe_lost", "plan_requested", "plan_ready", "epoch_prepared", "epoch_step", "reconfigured"]
    assert [kind for kind in kinds if kind in steps] == steps


def test_a_hub_that_is_killed_ends_no_node_and_with_the_next_one_all_fly_again(aircraft: Aircraft) -> None:
    """The PEs come back as new incarnations; the manager, which stood still meanwhile, in the same mastership."""
    aircraft.start_agents()
    manager = aircraft.start_manager()
    assert manager.event(events.ManagerStarted).term == 1
    before = manager.event(events.Reconfigured).epoch
    incarnations = {pe: running_state(aircraft, pe, PeState.ACTIVE).incarnation for pe in aircraft.spec.pes}
    aircraft.hub.kill()
    assert f"softbus {aircraft.folder}/can0.sock is lost: " in manager.event(events.BusTrouble).sentence
    aircraft.bus.shutdown()
    aircraft.hub = start_hub(aircraft.folder / "can0.sock", 1_000_000)
    aircraft.bus = can.Bus(interface="softbus", channel=str(aircraft.folder / "can0.sock"))
    while "is back after" not in manager.event(events.BusTrouble).sentence:
        pass  # it may say another reason first, while there is no hub at all
    after = manager.event(events.Reconfigured).epoch
    assert after > before
    for pe, incarnation in incarnations.items():
        assert running_state(aircraft, pe, PeState.ACTIVE).incarnation != incarnation


# Mistakes of the user who starts them


Complaint = Callable[..., str]


@pytest.fixture
def complaint(capsys: pytest.CaptureFixture[str]) -> Complaint:
    """Return the one sentence with which a program refuses; it runs in this process."""

    def refused(program: Callable[[Sequence[str]], int], *arguments: str) -> str:
        assert program(arguments) == 2
        told = capsys.readouterr()
        assert told.out == ""
        (sentence,) = told.err.splitlines()
        return sentence

    return refused


def test_a_second_manager_leaves_the_bus_to_the_first(aircraft: Aircraft) -> None:
    first = aircraft.start_manager()
    aircraft.hear(lambda frame: frame.can_id == management_id(126, Command.LEASE))
    second = aircraft.start_manager("--node", "127", "--state-dir", str(aircraft.folder / "other"))
    assert second.event(events.SecondManager).node == 126
    code, said = second.end()
    assert code == 1
    assert said == [
        "heronry: manager 126 is already active on can0 (term 1); stop that manager first, or do not start this one"
    ]
    first.event(events.PlanReady)


@pytest.fixture
def table(tmp_path: Path) -> str:
    return str(write_tables(load(SPEC_FILE), ("tail_pe",), tmp_path)["tail_pe"])


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["-i", "socketcan", "-c", "can7"], "socketcan can7 cannot be opened: "),
        (
            ["-i", "softbus", "-c", "/no/such.sock"],
            "start one with: heronry softbus /no/such.sock",
        ),
        (["-i", "softbus"], "channel"),
        (["--bus", "radio=softbus:/no/such.sock"], "tail_pe has no such bus; it has can0"),
    ],
)
def test_an_agent_without_its_bus(complaint: Complaint, table: str, arguments: list[str], says: str) -> None:
    sentence = complaint(pe_agent, "--table", table, "--simulated", *arguments)
    assert sentence.startswith("pe-agent: ")
    assert says in sentence


@pytest.mark.parametrize("command", [[*AGENT, "--table", "x"], [*MANAGER, str(SPEC_FILE)]], ids=["agent", "manager"])
def test_an_interface_that_does_not_exist(command: list[str]) -> None:
    """It is refused in one sentence, as every mistyped flag is; the sentence says what there is."""
    done = subprocess.run([*command, "-i", "nonsense", "-c", "x"], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert re.search(r"-i/--interface: 'nonsense' is none of the choices; there is .*softbus.*\n$", done.stderr)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (None, "No such file or directory; write the table with 'heronry table'"),
        ('{"format": 1, "name": "tail_pe"}', "write the table anew with 'heronry table'"),
        ("dg: 1", "the text is a spec, not a table; compile the spec first"),
    ],
)
def test_an_agent_without_a_table(complaint: Complaint, tmp_path: Path, content: str | None, says: str) -> None:
    file = tmp_path / "bad.table"
    if content is not None:
        file.write_text(content)
    sentence = complaint(pe_agent, "--table", str(file), "-i", "softbus", "-c", "x")
    assert sentence.startswith(f"pe-agent: {file}: ")
    assert says in sentence


def test_an_agent_whose_node_id_is_taken(aircraft: Aircraft) -> None:
    aircraft.start_agents()
    node = aircraft.spec.pes["tail_pe"].node_id
    aircraft.hear(lambda frame: frame.can_id == state_id(node))
    table = str(aircraft.folder / "tail_pe.table")
    done = subprocess.run(
        [*AGENT, "--table", table, *aircraft.bus_flags], capture_output=True, text=True, timeout=60, check=False
    )
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == (f"pe-agent: another node on the bus has node-ID {node}; change one of the two in the spec\n")


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["-i", "socketcan", "-c", "can7"], "socketcan can7 cannot be opened: "),
        (
            ["-i", "softbus", "-c", "/no/such.sock"],
            "start one with: heronry softbus /no/such.sock",
        ),
        ([], "no bus is named: give -i INTERFACE and -c CHANNEL"),
    ],
)
def test_a_manager_without_its_bus(complaint: Complaint, tmp_path: Path, arguments: list[str], says: str) -> None:
    sentence = complaint(main, "manager", str(SPEC_FILE), *arguments, "--state-dir", str(tmp_path))
    assert sentence.startswith("heronry: ")
    assert says in sentence


WAITING_ENDS_IT = """
import sys
from heronry_manager.planner.client import PlannerClient
from heronry_tools.cli import main

PlannerClient.wait_until_ready = lambda _: sys.exit("it waits for its planner")
sys.exit(main(["manager", *sys.argv[1:]]))
"""


def test_a_manager_with_plans_made_ahead_does_not_wait_for_its_planner(aircraft: Aircraft) -> None:
    program = [sys.executable, "-c", WAITING_ENDS_IT]
    assert aircraft.start_manager(program=program).end() == (1, ["it waits for its planner"])
    made = str(aircraft.folder / "made")
    assert main(["contingencies", str(SPEC_FILE), "--faults", "0", "-o", made, "--jobs", "1"]) == 0
    aircraft.start_manager("--contingencies", made, program=program).event(events.ManagerStarted)


def test_a_manager_that_cannot_keep_its_term(aircraft: Aircraft) -> None:
    (aircraft.folder / "state").write_text("a file, where a folder should be\n")
    code, said = aircraft.start_manager().end()
    assert code == 2
    place, remedy = f"{aircraft.folder}/state/manager-126.journal", "name another folder with --state-dir"
    assert said == [f"heronry: {place}: Not a directory; make it a file that you can read, or {remedy}"]


def test_a_manager_with_a_spec_that_is_wrong_in_two_places(tmp_path: Path) -> None:
    text = SPEC_FILE.read_text().replace("device: gps,", "device: gpps,").replace("cpu: 0.3,", "cpu: lots,")
    file = tmp_path / "wrong.dg.yaml"
    file.write_text(text)
    done = subprocess.run(
        [*MANAGER, str(file), "-i", "softbus", "-c", "/no/such.sock"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    places = [line for line in done.stderr.splitlines() if f"{file}:" in line]
    lines = text.splitlines()
    wrong = [number for number, line in enumerate(lines, 1) if "gpps" in line or "lots" in line]
    assert [int(place.partition(f"{file}:")[2].split(":")[0]) for place in places] == wrong
    assert "Traceback" not in done.stderr


def test_a_manager_with_a_spec_that_is_not_there(complaint: Complaint) -> None:
    assert "/no/such.dg.yaml" in complaint(main, "manager", "/no/such.dg.yaml", "-i", "softbus", "-c", "x")
    assert "neither a file nor a shipped spec" in complaint(main, "manager", "big_bule", "-i", "softbus", "-c", "x")
