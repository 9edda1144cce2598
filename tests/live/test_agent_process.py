"""The agent as a process on a bus: the test is the manager and the neighbour, and looks at frames alone.

On a software bus, and on SocketCAN where there is a vcan0.
"""

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from time import monotonic, sleep

import can
import pytest

from agent.one_pe import BEAT_NS, CONTROL, DEMAND_ID, FLYING, NEIGHBOUR, NODE, TABLE, neighbour_state, slice_messages
from heronry_tools.runtime.softbus.starter import start_hub
from heronry_wire.canaerospace import Datum, decode_data
from heronry_wire.command_tags import CommandSigner
from heronry_wire.frame import Frame
from heronry_wire.identifiers import FIRST_MANAGER, actuator_echo_id, emcy_id, heartbeat_id, state_id
from heronry_wire.key_file import make_key, read_key
from heronry_wire.management import Activate, Alive, Ping, Step
from heronry_wire.pe_table import PeTable
from heronry_wire.state_frames import PeFlags, PeState, Reason, StatePage0, StatePage1, decode_state
from lab.peers import command_frame
from live.modules_that_misbehave import THIRD

PATIENCE_S = 10.0
TESTS = Path(__file__).resolve().parents[1]
EVERYBODY = frozenset({NEIGHBOUR, NODE})

_IMAGES = {"control": "agent.modules_for_host:Steady", "servo": "agent.modules_for_host:Driving"}
LIVE_TABLE = replace(
    TABLE, modules=tuple(replace(m, image=_IMAGES[m.image]) for m in TABLE.modules if m.image in _IMAGES)
)


class Ground:
    """The bus, the agents on it, and the test's own place there."""

    def __init__(self, folder: Path, interface: str, channel: str = "vcan0") -> None:
        self.folder = folder
        self.place = {"interface": interface, "channel": channel}
        if interface == "softbus":
            self.place["channel"] = str(folder / "can0.sock")
            self.hub = start_hub(self.place["channel"], 1_000_000)
        self.bus = can.Bus(**self.place, ignore_config=True)
        self.table = folder / "tail.table"
        self.table.write_text(LIVE_TABLE.to_json())
        self.agents: list[subprocess.Popen[str]] = []
        self.neighbour_beats = False  # whenever an agent does

    def start(self, *more: str) -> subprocess.Popen[str]:
        """Start an agent, and wait until it speaks or ends."""
        bus = ["-i", self.place["interface"], "-c", self.place["channel"]]
        arguments = ["--simulated", "--table", str(self.table), *bus, *more]
        agent = subprocess.Popen(
            [sys.executable, "-m", "heronry_agent", *arguments],
            stdin=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, "PYTHONPATH": os.pathsep.join([os.environ.get("PYTHONPATH", ""), str(TESTS)])},
        )
        self.agents.append(agent)
        return agent

    def say(self, *frames: Frame) -> None:
        for frame in frames:
            self.bus.send(can.Message(arbitration_id=frame.can_id, data=frame.data, is_extended_id=False), PATIENCE_S)

    def hear(self, wanted: Callable[[Frame], bool]) -> list[Frame]:
        """Return all frames up to the first wanted one."""
        heard: list[Frame] = []
        end_s = monotonic() + 3 * PATIENCE_S
        while True:
            assert monotonic() < end_s, f"what is wanted does not come; the last frames were {heard[-20:]}"
            message = self.bus.recv(PATIENCE_S)
            assert message is not None, "the agent has fallen silent"
            heard.append(Frame(message.arbitration_id, bytes(message.data)))
            if self.neighbour_beats and heard[-1].can_id == state_id(NODE):
                self.say(neighbour_state(7))
            if wanted(heard[-1]):
                return heard

    def hear_page_0(self) -> StatePage0:
        page = decode_state(self.hear(lambda f: f.can_id == state_id(NODE) and f.data[0] < 0x40)[-1].data)
        assert isinstance(page, StatePage0)
        return page

    def configure(self, table: PeTable = LIVE_TABLE) -> None:
        """Give it the configuration in which it flies, alive and with a neighbour; `table` is the one that it has."""
        slices = slice_messages(FLYING, 7, 1007, table=table)
        messages = [Alive(1, 0, EVERYBODY), *slices, Activate(1, 7, Step.GO_ALL, 1007)]
        self.say(*map(command_frame, messages), neighbour_state(7))
        self.neighbour_beats = True

    def close(self) -> None:
        for agent in self.agents:
            agent.kill()
            agent.communicate()
        self.bus.shutdown()
        if self.place["interface"] == "softbus":
            self.hub.close()


_NO_VCAN = pytest.mark.skipif(not Path("/sys/class/net/vcan0").exists(), reason="there is no vcan0")
_SOFTBUS = pytest.param("softbus", marks=pytest.mark.live)
_SOCKETCAN = [pytest.mark.vcan, _NO_VCAN]
on_every_bus = pytest.mark.parametrize("ground", [_SOFTBUS, pytest.param("socketcan", marks=_SOCKETCAN)], indirect=True)
# What an agent does by itself hardly depends on its bus, and a user-mode Linux takes seconds to start one.
mostly_on_softbus = pytest.mark.parametrize(
    "ground", [_SOFTBUS, pytest.param("socketcan", marks=[*_SOCKETCAN, pytest.mark.soak])], indirect=True
)


@pytest.fixture
def ground(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Ground]:
    ground = Ground(tmp_path, request.param)
    yield ground
    ground.close()


def end(agent: subprocess.Popen[str]) -> tuple[int, list[str]]:
    """Wait for its end: exit code, and what it said."""
    _, said = agent.communicate(timeout=PATIENCE_S)
    return agent.returncode, said.splitlines()


@on_every_bus
def test_it_boots_is_configured_drives_and_stops_in_order(ground: Ground) -> None:
    agent = ground.start()
    boot_up = ground.hear(lambda frame: frame.can_id == heartbeat_id(NODE))[-1]
    assert boot_up == Frame(heartbeat_id(NODE), b"\x00")
    assert ground.hear_page_0().state is PeState.UNCONFIGURED

    ground.configure()
    ground.hear(lambda frame: frame.can_id == actuator_echo_id(NODE))
    ground.hear(lambda frame: frame.can_id == DEMAND_ID)
    assert ground.hear_page_0().state is PeState.ACTIVE

    agent.send_signal(signal.SIGTERM)
    code, said = end(agent)
    assert code == 0
    assert "Traceback" not in "\n".join(said)


@mostly_on_softbus
def test_code_that_cannot_be_loaded_is_reported_and_refused_from_then_on(ground: Ground) -> None:
    table = replace(LIVE_TABLE, modules=tuple(replace(m, image="nonsense") for m in LIVE_TABLE.modules))
    ground.table.write_text(table.to_json())
    ground.start()
    ground.hear_page_0()
    ground.configure(table)
    ground.hear(lambda frame: frame.can_id == emcy_id(NODE))
    slices = slice_messages(replace(FLYING, publish={}), 8, 1008, table=table)
    ground.say(*map(command_frame, [*slices, Ping(1, NODE, 0)]))
    ground.hear(lambda f: f.can_id == state_id(NODE) and f.data[0] >= 0x40 and _reason(f) is Reason.IMAGE)


def descendants(process: int) -> set[int]:
    """Process numbers of the children of a process, of their children, and so on."""
    found, parents = {process}, dict[int, int]()
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            parents[int(stat.parent.name)] = int(stat.read_text(errors="replace").rpartition(") ")[2].split()[1])
    while more := {one for one, parent in parents.items() if parent in found} - found:
        found |= more
    return found - {process}


def lives(process: int) -> bool:
    try:
        state = Path(f"/proc/{process}/stat").read_text(errors="replace").rpartition(") ")[2][0]
    except OSError:
        return False
    return state != "Z"


def steps_of(frame: Frame) -> float:
    """What a misbehaving module gives: the number of its steps."""
    datum = decode_data(frame)
    assert isinstance(datum, Datum)
    assert isinstance(datum.value, float)
    return datum.value


@pytest.mark.parametrize("ground", [_SOFTBUS], indirect=True)
def test_what_a_module_has_forked_ends_when_the_agent_is_killed(ground: Ground) -> None:
    forks = "live.modules_that_misbehave:Forks"
    modules = tuple(replace(m, image=forks) if m.index == CONTROL else m for m in LIVE_TABLE.modules)
    table = replace(LIVE_TABLE, modules=modules)
    ground.table.write_text(table.to_json())
    agent = ground.start()
    ground.hear_page_0()
    ground.configure(table)
    ground.hear(lambda frame: frame.can_id == DEMAND_ID and steps_of(frame) >= THIRD)
    forked = descendants(agent.pid)
    parents = {one for one in forked if descendants(one)}
    assert len(parents) == 1, "one partition has a child"
    agent.kill()
    agent.wait(PATIENCE_S)
    end_s = monotonic() + PATIENCE_S
    while any(map(lives, forked)):
        assert monotonic() < end_s, {one for one in forked if lives(one)}
        sleep(0.02)


def _reason(frame: Frame) -> Reason:
    page = decode_state(frame.data)
    assert isinstance(page, StatePage1)
    return page.reason


@mostly_on_softbus
def test_after_a_pause_old_frames_are_not_taken_as_new(ground: Ground) -> None:
    agent = ground.start()
    ground.hear_page_0()
    ground.configure()
    ground.hear(lambda frame: frame.can_id == DEMAND_ID)

    ground.neighbour_beats = False
    agent.send_signal(signal.SIGSTOP)
    os.waitid(os.P_PID, agent.pid, os.WSTOPPED)
    ground.say(neighbour_state(7), command_frame(Alive(1, 1, EVERYBODY)))
    while ground.bus.recv(10 * BEAT_NS / 1e9) is not None:  # twice the lease without a frame
        pass
    agent.send_signal(signal.SIGCONT)
    heard = [frame for _ in range(10) for frame in ground.hear(lambda f: f.can_id == state_id(NODE))]
    assert DEMAND_ID not in [frame.can_id for frame in heard]
    echoes = [frame for frame in heard if frame.can_id == actuator_echo_id(NODE)]
    assert len(echoes) <= 1, "one may tell of a write before the pause"
    page = ground.hear_page_0()
    assert PeFlags.OUTPUT_HELD in page.flags
    assert page.state is PeState.ACTIVE

    ground.neighbour_beats = True
    ground.say(neighbour_state(7), command_frame(Alive(1, 2, EVERYBODY)))
    ground.hear(lambda frame: frame.can_id == DEMAND_ID)


@mostly_on_softbus
def test_a_second_node_with_the_same_id_does_not_start(ground: Ground) -> None:
    ground.start()
    ground.hear_page_0()
    code, said = end(ground.start())
    assert code == 1
    assert said == [f"pe-agent: another node on the bus has node-ID {NODE}; change one of the two in the spec"]
    assert ground.hear_page_0().sequence > 0


@pytest.mark.parametrize(("named", "code"), [(NEIGHBOUR, None), (NODE, 1)], ids=["forged states", "a true twin"])
@mostly_on_softbus
def test_with_a_key_the_manager_decides_whether_a_node_with_the_same_id_is_one(
    ground: Ground, named: int, code: int | None
) -> None:
    file = ground.folder / "fleet.key"
    make_key(file)
    signer = CommandSigner(read_key(file), FIRST_MANAGER, 1)
    state = Frame(state_id(NODE), neighbour_state(7).data)

    agent = ground.start("--key", str(file), "--until-eof")
    for _ in range(200):  # no manager yet: it waits
        ground.say(state)
        sleep(0.005)
    assert agent.poll() is None
    assert f"something sends with node-ID {NODE}" in said_of_a_clash(agent)
    for number in range(600):
        alive = command_frame(Alive(1, number % 256, frozenset({named})))
        tag = signer.tag(alive)
        assert tag is not None
        ground.say(alive, tag, state)
        message = ground.bus.recv(0.005)
        if agent.poll() is not None or (message and message.arbitration_id == heartbeat_id(NODE)):
            break
    assert agent.poll() == code
    told = "another node on the bus has node-ID" if code else "no node that the manager knows: they are forged"
    assert told in said_of_a_clash(agent)


def said_of_a_clash(agent: subprocess.Popen[str]) -> str:
    """The next line that the agent says, but for what it says of echoes."""
    assert agent.stderr is not None
    return next(line for line in agent.stderr if " echo: " not in line)


@mostly_on_softbus
def test_it_ends_with_the_process_that_started_it(ground: Ground) -> None:
    agent = ground.start("--until-eof", "--quiet")
    ground.hear_page_0()
    assert end(agent) == (0, [])  # waiting for its end closes its standard input


@mostly_on_softbus
def test_a_restart_is_a_new_incarnation_and_unconfigured(ground: Ground) -> None:
    keeping = ("--state-dir", str(ground.folder / "state"))
    first = ground.start(*keeping)
    before = ground.hear_page_0()
    first.kill()
    end(first)
    ground.start(*keeping)
    after = ground.hear(lambda frame: frame == Frame(heartbeat_id(NODE), b"\x00"))
    assert after
    page = ground.hear_page_0()
    assert 0 < (page.incarnation - before.incarnation) % 256 <= 17  # behind the 16 that were reserved ahead
    assert page.state is PeState.UNCONFIGURED


@mostly_on_softbus
def test_verbose_says_at_the_end_what_was_not_understood(ground: Ground) -> None:
    agent = ground.start("--verbose")
    ground.hear_page_0()
    ground.say(Frame(204, b"\x01"), command_frame(Ping(1, NODE, 0)))
    ground.hear(lambda frame: frame.can_id == state_id(NODE) and frame.data[0] >= 0x40)
    agent.send_signal(signal.SIGINT)
    code, said = end(agent)
    assert code == 0
    assert any("malformed command (204): 1" in line for line in said)
