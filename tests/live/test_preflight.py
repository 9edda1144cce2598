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
from contextlib import contextmanager, redirect_stdout, suppress
from dataclasses import dataclass, replace
from functools import partial
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
from heronry_manager.shell.control_protocol import Spoken
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
SPOILT_PITOT = """
from pathlib import Path
from heronry_agent.module import Module


class Pitot(Module):
    def step(self, inputs):
        if Path(__file__).with_name("fails").exists():
            Path(__file__).with_name("fails").unlink()
            raise OSError("no answer from the sensor")
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
        """What the command says of this aircraft: its exit code and its findings; none while no manager answers."""
        radios = [f"--bus={one.port_argument()}" for name, one in self.buses.items() if name != self.spec.manager.bus]
        socket = f"--socket={self.fleet.control_socket(126)}"
        said = StringIO()
        with redirect_stdout(said):
            words = ["preflight", str(self.file), *radios, socket, "--json", "--wait", str(wait_s), *options]
            code = main(words)
        if code == 2:
            return code, []
        told = json.loads(said.getvalue())
        assert told["ok"] == (code == 0)
        return code, told["findings"]

    def wrong(self, *options: str, until: Callable[[dict[str, str]], bool]) -> dict[str, str]:
        """What is wrong, by check, as soon as it is what is awaited; several sentences of a check as one text."""
        end_s = time.monotonic() + PATIENCE_S
        while True:
            code, findings = self.preflight(*options)
            wrong: dict[str, str] = {}
            for one in findings:
                if not one["ok"]:
                    wrong[one["check"]] = "; ".join(filter(None, (wrong.get(one["check"]), one["says"])))
            if until(wrong):
                assert code == 1
                assert all(one["type"] for one in findings if not one["ok"])
                return wrong
            assert time.monotonic() < end_s, "\n".join(map(str, wrong.items()))

    def order(self, order: Spoken) -> None:
        """Give an order to the manager, which may refuse it: not every PE counts as failed when it is cleared."""
        call(self.fleet.control_socket(126), order)

    def go(self) -> None:
        """Wait until the command says GO."""
        code, findings = self.preflight(wait_s=PATIENCE_S)
        assert code == 0, "\n".join(str(one) for one in findings if not one["ok"])


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
        with suppress(ValueError):  # the fleet closes the stream of a manager that it kills
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
    """big_blue with a pitot tube that can be blocked, or fail once, and a bus that a slow computer can fill, too."""
    folder = tmp_path_factory.mktemp("big_blue")
    (folder / "spoilt_pitot.py").write_text(SPOILT_PITOT)
    text = Path("dg_specs/big_blue.dg.yaml").read_text()
    for before, after in (
        ("pitot_driver: {device: pitot,", "pitot_driver: {device: pitot, image: 'spoilt_pitot:Pitot',"),
        ("{bitrate: 1000000, max_load: 0.8,", "{bitrate: 1000000, max_load: 0.3,"),
    ):
        assert text.count(before) == 1
        text = text.replace(before, after)
    file = folder / "big_blue.dg.yaml"
    file.write_text(text)
    os.environ["PYTHONPATH"] = str(folder)
    try:
        with flying(file, contingencies_of(load(file), Ahead.SINGLE_FAULTS)) as aircraft:
            yield aircraft
    finally:
        del os.environ["PYTHONPATH"]


def killed(aircraft: Aircraft, pe: str) -> Iterator[None]:
    """A PE without power."""
    aircraft.fleet.kill_pe(pe)
    yield
    aircraft.fleet.start_pe(pe)
    aircraft.order(ClearElement(f"pe:{pe}"))


def restarted(aircraft: Aircraft, pe: str, prepare: Callable[[], None], repair: Callable[[], None]) -> Iterator[None]:
    """A PE that was started otherwise, and afterwards as before."""
    aircraft.fleet.kill_pe(pe)
    prepare()
    aircraft.fleet.start_pe(pe)
    yield
    aircraft.fleet.kill_pe(pe)
    repair()
    aircraft.fleet.start_pe(pe)
    aircraft.order(ClearElement(f"pe:{pe}"))


def other_table(aircraft: Aircraft, pe: str, change: Callable[[PeTable], PeTable]) -> Iterator[None]:
    """A PE with a table that was changed, and has a valid check sum."""
    file = aircraft.fleet.folder / "tables" / f"{pe}.table"
    kept = file.read_text()
    table = change(PeTable.from_json(kept))
    changed = with_check_sum({name: getattr(table, name) for name in table.__dataclass_fields__})
    yield from restarted(
        aircraft, pe, lambda: file.write_text(changed) and None, lambda: file.write_text(kept) and None
    )


def without_image(aircraft: Aircraft) -> Iterator[None]:
    """A PE on which the code of a module is missing."""
    env = aircraft.fleet._environment
    path = env["PYTHONPATH"]
    yield from restarted(aircraft, "air", lambda: env.update(PYTHONPATH=""), lambda: env.update(PYTHONPATH=path))
    aircraft.wrong(until=lambda found: "PE" not in found)  # a PE hears no order before it has joined again
    aircraft.order(ClearElement("module:pitot_driver"))


def file_there(aircraft: Aircraft, name: str) -> Iterator[None]:
    """A file that the pitot tube looks for."""
    file = aircraft.file.with_name(name)
    file.touch()
    yield
    file.unlink(missing_ok=True)


def of_the_future(aircraft: Aircraft) -> Iterator[None]:
    """A spec that was written later than it is now, as on a computer that has lost its time."""
    os.utime(aircraft.file, (time.time() + 10**6, time.time() + 10**6))
    yield
    os.utime(aircraft.file)


def declared_failed(aircraft: Aircraft) -> Iterator[None]:
    """A module that the operator has declared failed."""
    aircraft.order(FailElement("module:image_archive"))
    yield
    aircraft.order(ClearElement("module:image_archive"))


def full_disk(aircraft: Aircraft) -> Iterator[None]:
    """A manager whose files cannot grow."""
    pid = aircraft.fleet.processes()["manager 126"]
    limits = resource.prlimit(pid, resource.RLIMIT_FSIZE)
    resource.prlimit(pid, resource.RLIMIT_FSIZE, (0, limits[1]))
    aircraft.order(FailElement("device:recorder"))
    aircraft.order(ClearElement("device:recorder"))
    yield
    resource.prlimit(pid, resource.RLIMIT_FSIZE, limits)


def in_thread(repeat: Callable[[threading.Event], None]) -> Iterator[None]:
    """Something that goes on until its event is set."""
    ended = threading.Event()
    thread = threading.Thread(target=repeat, args=(ended,))
    thread.start()
    yield
    ended.set()
    thread.join()


def late_states(aircraft: Aircraft) -> Iterator[None]:
    """A PE that stands still for two and a half heartbeat periods, again and again."""

    def hold_up(ended: threading.Event) -> None:
        while not ended.wait(2.5 * HEARTBEAT_NS / 1e9):
            aircraft.fleet.stop("payload")
            time.sleep(2.5 * HEARTBEAT_NS / 1e9)
            aircraft.fleet.go_on("payload")

    return in_thread(hold_up)


def flooded(aircraft: Aircraft) -> Iterator[None]:
    """A stranger that takes much of the manager's bus, with frames of the lowest priority."""
    place = aircraft.buses[aircraft.spec.manager.bus].channel

    def flood(ended: threading.Event) -> None:
        message = can.Message(arbitration_id=2031, data=bytes(8), is_extended_id=False)
        with can.Bus(interface="softbus", channel=place) as bus:
            while not ended.wait(0.005):
                with suppress(can.CanError):
                    for _ in range(40):
                        bus.send(message)

    return in_thread(flood)


def without_plans_made_ahead(aircraft: Aircraft) -> Iterator[None]:
    """A manager that was started without contingencies."""
    fleet = aircraft.fleet
    made = list(fleet._contingency_flags)
    fleet.kill_manager()
    fleet._contingency_flags[:] = ["--contingencies", "none"]
    drain(fleet)
    yield
    fleet.kill_manager()
    fleet._contingency_flags[:] = made
    drain(fleet)


def changed_spec(aircraft: Aircraft) -> Iterator[None]:
    """A file that is no longer what the manager flies."""
    text = aircraft.file.read_text()
    aircraft.file.write_text(text.replace("priority: 50", "priority: 51"))
    yield
    aircraft.file.write_text(text)


@dataclass(frozen=True, slots=True)
class Broken:
    """A thing to break: the check and the words that must name it, how to break and mend it, options.

    broken: breaks it up to its `yield`, and mends it after that.
    """

    check: str
    says: str
    broken: Callable[[Aircraft], Iterator[None]]
    options: Callable[[Aircraft], tuple[str, ...]] = lambda _: ()


def any_key(aircraft: Aircraft) -> tuple[str, ...]:
    """Expect a key that the manager does not have."""
    file = aircraft.fleet.folder / "any.key"
    assert file.exists() or main(["key", str(file)]) == 0
    return "--key", str(file)


THINGS = {
    "a PE": Broken("PE", "air is not heard", partial(killed, pe="air")),
    "a PE beyond the gateway": Broken("PE", "ground is not heard", partial(killed, pe="ground")),
    "a table compiled otherwise": Broken(
        "tables",
        "wing stages nothing: its table was compiled otherwise",
        partial(other_table, pe="wing", change=lambda table: replace(table, cpu_millis=table.cpu_millis + 1)),
    ),
    "the table of another spec": Broken(
        "tables",
        "wing (97) has a table of another spec",
        partial(other_table, pe="wing", change=lambda table: replace(table, spec_digest="cd" * 32)),
    ),
    "an image": Broken("images", "module:pitot_driver", without_image),
    "a module that fails once": Broken(
        "module", "module:pitot_driver failed on air", partial(file_there, name="fails")
    ),
    "a sensor": Broken(
        "inputs", "pitot_driver on air gives no differential_pressure", partial(file_there, name="blocked")
    ),
    "the clock": Broken("clock", "was written at", of_the_future),
    "the key": Broken("key", "the manager has no key", lambda _: iter((None,)), any_key),
    "a fault that was not cleared": Broken("fault", "module:image_archive counts as failed", declared_failed),
    "the journal": Broken("journal", "cannot be written", full_disk),
    "late states": Broken("late", "payload", late_states),
    "the load": Broken("load", "of the bit rate are used", flooded),
    "plans made ahead": Broken("contingencies", "has no plans made ahead", without_plans_made_ahead),
    "the spec": Broken("spec", "big_blue", changed_spec),
}
FOLLOWS = {"functions", "epoch", "radio"}  # checks that may be wrong because of what is broken


@pytest.mark.soak
@pytest.mark.timing
@pytest.mark.parametrize("thing", [None, *THINGS])
def test_big_blue_goes_with_its_ground_station_and_each_broken_thing_is_named_alone(
    big_blue: Aircraft, thing: str | None
) -> None:
    big_blue.go()
    if thing is None:
        return
    one = THINGS[thing]

    def is_named_alone(found: dict[str, str]) -> bool:
        """A PE that was restarted for it has joined again, too."""
        return one.says in found.get(one.check, "") and not found.keys() - {one.check} - FOLLOWS

    options = one.options(big_blue)
    broken = one.broken(big_blue)
    next(broken)
    try:
        print(f"{thing}: {big_blue.wrong(*options, until=is_named_alone)}")
    finally:
        next(broken, None)
    big_blue.go()
