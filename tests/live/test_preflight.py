"""`heronry preflight` beside real processes: GO when all is well, and what is broken is named.

In every run a small aircraft with a ground station; in long runs big_blue, of which fifteen things are broken, one at
a time.
"""

import json
import os
import resource
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass, replace
from io import StringIO
from pathlib import Path
from typing import Any

import can
import pytest

from heronry_dg.loader import load
from heronry_dg.model import Spec
from heronry_manager.contingency.contingencies import Contingencies
from heronry_manager.core.vocabulary import ClearElement, FailElement
from heronry_manager.shell.control_client import call
from heronry_tools.analysis.made_ahead import contingencies_of
from heronry_tools.cli import main
from heronry_tools.console.contingencies_argument import Ahead
from heronry_tools.runtime.demo.buses import BusChoice, choose
from heronry_tools.runtime.demo.event_stream import EventStream
from heronry_tools.runtime.demo.fleet import Fleet, run_folder
from heronry_tools.runtime.wake_ups import with_heartbeat
from heronry_wire.pe_table import PeTable, with_check_sum

pytestmark = pytest.mark.live
RADIO_LINK = Path("dg_specs/examples/radio_link.dg.yaml")
PATIENCE_S = 150
HEARTBEAT_NS = 320_000_000  # so long that a busy computer keeps up
SILENT_PITOT = """
from pathlib import Path
from heronry_agent.module import Module


class Pitot(Module):
    def step(self, inputs):
        return {} if Path(__file__).with_name("blocked").exists() else {"differential_pressure": 2.5}
"""


@dataclass
class Aircraft:
    """The processes of an aircraft."""

    spec: Spec
    file: Path
    fleet: Fleet
    buses: dict[str, BusChoice]

    def preflight(self, *options: str, wait_s: float = 0.0) -> tuple[int, list[dict[str, Any]]]:
        """What the command says of this aircraft: its exit code and its findings."""
        radios = [f"--bus={one.port_argument()}" for name, one in self.buses.items() if name != self.spec.manager.bus]
        socket = f"--socket={self.fleet.control_socket(126)}"
        said = StringIO()
        with redirect_stdout(said):
            words = ["preflight", str(self.file), *radios, socket, "--json", "--wait", str(wait_s), *options]
            code = main(words)
        told = json.loads(said.getvalue())
        assert told["ok"] == (code == 0)
        return code, told["findings"]

    def wrong(self, *options: str, until: Callable[[dict[str, str]], bool]) -> dict[str, str]:
        """What is wrong, by check, as soon as it is what is awaited."""
        end_s = time.monotonic() + PATIENCE_S
        while True:
            code, findings = self.preflight(*options)
            wrong = {one["check"]: one["says"] for one in findings if not one["ok"]}
            if until(wrong):
                assert code == 1
                assert all(one["type"] for one in findings if not one["ok"])
                return wrong
            assert time.monotonic() < end_s, findings

    def go(self) -> None:
        """Wait until the command says GO."""
        code, findings = self.preflight(wait_s=PATIENCE_S)
        assert code == 0, [one for one in findings if not one["ok"]]


@contextmanager
def flying(file: Path, made: Contingencies | None) -> Iterator[Aircraft]:
    """All processes of a spec, without a terminal."""
    spec, folder = with_heartbeat(load(file), HEARTBEAT_NS), run_folder()
    with Fleet(spec, file, folder, made, heartbeat_ns=HEARTBEAT_NS) as fleet:
        buses = choose(spec, folder, {}, None, prefer_vcan=False)
        fleet.start_buses(buses)
        drained = drain(fleet)
        for pe in spec.pes:
            fleet.start_pe(pe)
        yield Aircraft(spec, file, fleet, buses)
    drained.join(10)


def drain(fleet: Fleet) -> threading.Thread:
    """Start the manager, and read its events, so that it never waits for a reader."""
    stream = EventStream(fleet.start_manager())

    def read() -> None:
        while not stream.has_ended:
            stream.take(0.5)

    thread = threading.Thread(target=read, daemon=True)
    thread.start()
    return thread


def test_a_small_aircraft_goes_and_does_not_without_its_ground_station() -> None:
    with flying(RADIO_LINK, contingencies_of(load(RADIO_LINK), Ahead.SINGLE_FAULTS)) as aircraft:
        aircraft.go()
        aircraft.fleet.kill_pe("ground")
        wrong = aircraft.wrong(until=lambda found: "PE" in found)
        assert wrong["PE"].startswith("ground is not heard")
        assert wrong.keys() <= {"PE", "functions", "radio", "epoch"}, wrong


@pytest.fixture(scope="module")
def big_blue(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Aircraft]:
    """big_blue with a pitot tube that can be blocked, on its balloon."""
    folder = tmp_path_factory.mktemp("big_blue")
    (folder / "silent_pitot.py").write_text(SILENT_PITOT)
    text = Path("dg_specs/big_blue.dg.yaml").read_text()
    spoilt = text.replace("pitot_driver: {device: pitot,", "pitot_driver: {device: pitot, image: 'silent_pitot:Pitot',")
    assert spoilt != text
    file = folder / "big_blue.dg.yaml"
    file.write_text(spoilt)
    os.environ["PYTHONPATH"] = str(folder)
    try:
        with flying(file, contingencies_of(load(file), Ahead.SINGLE_FAULTS)) as aircraft:
            yield aircraft
    finally:
        del os.environ["PYTHONPATH"]


Break = Callable[[Aircraft], None]


def restarted(aircraft: Aircraft, pe: str, *, prepare: Break, repair: Break) -> tuple[Break, Break]:
    """Break a PE by starting it otherwise, and mend it by starting it as before."""

    def spoil(one: Aircraft) -> None:
        one.fleet.kill_pe(pe)
        prepare(one)
        one.fleet.start_pe(pe)

    def mend(one: Aircraft) -> None:
        one.fleet.kill_pe(pe)
        repair(one)
        one.fleet.start_pe(pe)
        call(one.fleet.control_socket(126), ClearElement(f"pe:{pe}"))

    del aircraft
    return spoil, mend


class Tables:
    """The table files of the PEs, of which one can be exchanged for another."""

    def __init__(self, aircraft: Aircraft) -> None:
        self.folder = aircraft.fleet.folder / "tables"
        self.kept = {file: file.read_text() for file in self.folder.glob("*.table")}

    def write(self, pe: str, change: Callable[[PeTable], PeTable]) -> None:
        file = self.folder / f"{pe}.table"
        table = change(PeTable.from_json(self.kept[file]))
        file.write_text(with_check_sum({name: getattr(table, name) for name in table.__dataclass_fields__}))

    def restore(self) -> None:
        for file, text in self.kept.items():
            file.write_text(text)


@pytest.mark.soak
@pytest.mark.timing
def test_big_blue_goes_with_its_ground_station_and_each_broken_thing_is_named(big_blue: Aircraft) -> None:
    aircraft, fleet = big_blue, big_blue.fleet
    manager = fleet.control_socket(126)
    aircraft.go()

    def broken(name: str, check: str, says: str, spoil: Break, mend: Break, *options: str) -> None:
        def is_named_alone(found: dict[str, str]) -> bool:
            """A PE that was restarted for it has joined again, too."""
            beside = found.keys() - {check, "functions", "epoch", "radio"}
            return says in found.get(check, "") and not beside

        spoil(aircraft)
        try:
            print(f"{name}: {aircraft.wrong(*options, until=is_named_alone)}")
        finally:
            mend(aircraft)
        aircraft.go()

    def kill(pe: str) -> Break:
        return lambda one: one.fleet.kill_pe(pe) and None

    def start(pe: str) -> Break:
        def do(one: Aircraft) -> None:
            one.fleet.start_pe(pe)
            call(manager, ClearElement(f"pe:{pe}"))

        return do

    broken("PE", "PE", "air is not heard", kill("air"), start("air"))
    broken("PE beyond the gateway", "PE", "ground is not heard", kill("ground"), start("ground"))

    tables = Tables(aircraft)
    for name, check, says, change in (
        (
            "a table compiled otherwise",
            "tables",
            "wing stages nothing: its table was compiled otherwise",
            lambda table: replace(table, cpu_millis=table.cpu_millis + 1),
        ),
        (
            "the table of another spec",
            "tables",
            "wing (97) has a table of another spec",
            lambda table: replace(table, spec_digest="cd" * 32, cpu_millis=table.cpu_millis + 1),
        ),
    ):
        spoil, mend = restarted(
            aircraft,
            "wing",
            prepare=lambda _, change=change: tables.write("wing", change),
            repair=lambda _: tables.restore(),
        )
        broken(name, check, says, spoil, mend)

    env = fleet._environment
    path = env["PYTHONPATH"]
    spoil, mend = restarted(
        aircraft,
        "air",
        prepare=lambda _: env.update(PYTHONPATH=""),
        repair=lambda _: env.update(PYTHONPATH=path),
    )

    def mend_image(one: Aircraft) -> None:
        mend(one)
        one.wrong(until=lambda found: "PE" not in found)  # a PE hears no order before it has joined again
        call(manager, ClearElement("module:pitot_driver"))

    broken("image", "images", "module:pitot_driver", spoil, mend_image)

    blocked = aircraft.file.with_name("blocked")
    broken(
        "sensor",
        "inputs",
        "pitot_driver on air gives no differential_pressure",
        lambda _: blocked.touch(),
        lambda _: blocked.unlink(),
    )

    os.utime(aircraft.file, (time.time() + 10**6, time.time() + 10**6))
    broken("clock", "clock", "was written at", lambda _: None, lambda _: os.utime(aircraft.file))

    key = fleet.folder / "any.key"
    assert main(["key", str(key)]) == 0
    broken("key", "key", "the manager has no key", lambda _: None, lambda _: None, "--key", str(key))

    broken(
        "fault",
        "fault",
        "module:image_archive counts as failed",
        lambda _: call(manager, FailElement("module:image_archive")) and None,
        lambda _: call(manager, ClearElement("module:image_archive")) and None,
    )

    pid = fleet.processes()["manager 126"]
    limits = resource.prlimit(pid, resource.RLIMIT_FSIZE)

    def full(_: Aircraft) -> None:
        resource.prlimit(pid, resource.RLIMIT_FSIZE, (0, limits[1]))
        call(manager, FailElement("device:recorder"))
        call(manager, ClearElement("device:recorder"))

    broken(
        "journal",
        "journal",
        "cannot be written",
        full,
        lambda _: resource.prlimit(pid, resource.RLIMIT_FSIZE, limits) and None,
    )

    with late_states(aircraft, "payload"):
        aircraft.wrong(until=lambda found: found.keys() - {"epoch"} == {"late"} and "payload" in found["late"])
    aircraft.go()

    with flooded(aircraft):
        wrong = aircraft.wrong(until=lambda found: "load" in found)
        assert "of the bit rate are used" in wrong["load"]
    aircraft.go()

    made = list(fleet._contingency_flags)
    fleet.kill_manager()
    fleet._contingency_flags[:] = ["--contingencies", "none"]
    drain(fleet)
    aircraft.wrong(until=lambda found: found.keys() == {"contingencies"})
    fleet.kill_manager()
    fleet._contingency_flags[:] = made
    drain(fleet)
    aircraft.go()

    aircraft.file.write_text(aircraft.file.read_text().replace("priority: 50", "priority: 51"))
    aircraft.wrong(until=lambda found: found.keys() == {"spec"})


@contextmanager
def late_states(aircraft: Aircraft, pe: str) -> Iterator[None]:
    """A PE that stands still for two and a half heartbeat periods in every second."""
    ended = threading.Event()

    def hold_up() -> None:
        while not ended.wait(0.8):
            aircraft.fleet.stop(pe)
            time.sleep(2.5 * HEARTBEAT_NS / 1e9)
            aircraft.fleet.go_on(pe)

    thread = threading.Thread(target=hold_up)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


@contextmanager
def flooded(aircraft: Aircraft) -> Iterator[None]:
    """A stranger that fills the manager's bus with frames of the lowest priority."""
    ended = threading.Event()
    place = aircraft.buses[aircraft.spec.manager.bus].channel

    def flood() -> None:
        message = can.Message(arbitration_id=2031, data=bytes(8), is_extended_id=False)
        with can.Bus(interface="softbus", channel=place) as bus:
            while not ended.is_set():
                try:
                    bus.send(message)
                except can.CanError:
                    time.sleep(0.001)

    thread = threading.Thread(target=flood)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
