"""The aircraft of four_heights.dg.yaml on a vcan0, with the drivers that its spec names and what they really speak to.

    receiver       Debian's gpsd
    altimeter      ADC081C, by the kernel's driver and Industrial I/O
    barometer      BMP280, by raw I2C
    foreign_unit   a CANaerospace node of its own on the bus
    elevator       AD5241, by the kernel's driver

Its sources are killed one after the other. The scenario `a_silent_source_is_told_in_time` flies the same spec.
A user-mode Linux is slow: heartbeats are slower here, and the times are told, not judged.
"""

import json
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import can
import pytest

from heronry_agent.device_driver import NotConnectedError, Setup, checked_options
from heronry_agent.drivers.canaerospace import ForeignNode as UnitDriver
from heronry_agent.drivers.iio import IioOutput, device_folder
from heronry_agent.drivers.iio_buffer import Element, IioBuffer
from heronry_agent.drivers.ms5611 import Ms5611, pressure_hpa
from heronry_dg.loader import load
from heronry_dg.situation import situation
from heronry_manager.events import FaultReported, PlanReady, Reconfigured
from heronry_manager.events.line import to_object
from heronry_manager.planner.exact import plan
from heronry_tools.runtime.demo.awaited_events import AwaitedEvents
from heronry_tools.runtime.demo.buses import choose
from heronry_tools.runtime.demo.fleet import Fleet, run_folder
from heronry_wire.canaerospace import DataType, Datum, ErrorReport, encode_data, encode_emergency_event
from heronry_wire.frame import Frame
from lab import real_gpsd
from lab.slow_spec import slow_spec
from live.kernel_chips import MS5611, Chips

pytestmark = pytest.mark.vcan

TESTS = Path(__file__).resolve().parents[1]
PATIENCE_S = 60.0
NODE, IDENTIFIER = 17, 326
CONVERTED = 8_500_000  # what the MS5611 has converted, of pressure and temperature alike: its registers are memory
GPS, CONVERTER, AIR, FOREIGN, SAFE = 100, 110, 56, 120, 7  # what the elevator's register holds on each source


class ForeignNode:
    """A CANaerospace node that is no PE: sends its datum ten times a second."""

    def __init__(self, value: float) -> None:
        frame = encode_data(IDENTIFIER, Datum(NODE, DataType.FLOAT, 0, 0, value))
        self._message = can.Message(arbitration_id=frame.can_id, data=frame.data, is_extended_id=False)
        self._ends = threading.Event()
        self._thread = threading.Thread(target=self._send)
        self._thread.start()

    def _send(self) -> None:
        with can.Bus("vcan0", interface="socketcan") as bus:
            while not self._ends.wait(0.1):
                bus.send(self._message)

    def kill(self) -> None:
        self._ends.set()
        self._thread.join()


class Aircraft:
    """Its chips, and what its manager tells."""

    def __init__(self, chips: Chips, fleet: Fleet, events: AwaitedEvents) -> None:
        self.chips, self.fleet, self.folder, self.events = chips, fleet, fleet.folder, events

    def until_register(self, number: int) -> None:
        end_s = time.monotonic() + PATIENCE_S
        while self.chips.register() != number:
            assert time.monotonic() < end_s, f"the register holds {self.chips.register()}, not {number}: {self.logs()}"
            time.sleep(0.02)

    def logs(self) -> str:
        """What the agents and the drivers said."""
        return "".join(file.read_text() for file in self.folder.glob("*.log"))

    def until_told(self, element: str) -> None:
        while to_object(self.events.wait(FaultReported))["element"] != element:
            pass

    def until_runs(self, modules: set[str]) -> None:
        while set(self.events.wait(PlanReady).plan.modules) != modules:
            pass
        self.events.wait(Reconfigured)


def plans(sources: tuple[str, ...]) -> list[set[str]]:
    """What `heronry plan` says that runs, with the first source down, with two, and so on."""
    spec = load(TESTS / "scenarios/four_heights.dg.yaml")
    return [
        set(plan(spec, situation(spec, sources[: number + 1]), None).configuration.modules)
        for number in range(len(sources))
    ]


@pytest.fixture
def aircraft(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[tuple[Aircraft, dict[str, Callable[[], None]]]]:
    if not real_gpsd.is_there():
        pytest.skip("Debian's gpsd has not been fetched: python -m lab.real_gpsd")
    monkeypatch.setenv("PYTHONPATH", str(TESTS))
    chips = Chips()
    chips.measure(CONVERTER)
    file = slow_spec(str(TESTS / "scenarios/four_heights.dg.yaml"), tmp_path, heartbeat_ms=500, rates_divided_by=4)
    spec = load(file)
    drivers = {name: {"driver": one.driver, "options": one.options} for name, one in spec.devices.items()}
    (tmp_path / "devices.json").write_text(json.dumps(drivers, default=str))
    with ExitStack() as stack:
        receiver = stack.enter_context(real_gpsd.fed(tmp_path, 29471, GPS))
        foreign = ForeignNode(FOREIGN)
        stack.callback(foreign.kill)
        fleet = stack.enter_context(Fleet(spec, file, run_folder(), devices=tmp_path / "devices.json"))
        fleet.start_buses(choose(spec, tmp_path, {}, None))
        events = AwaitedEvents(fleet, fleet.start_manager())
        for pe in spec.pes:
            fleet.start_pe(pe)
        yield (
            Aircraft(chips, fleet, events),
            {
                "device:receiver": receiver.kill,
                "device:altimeter": chips.take_converter_away,
                "device:barometer": chips.let_barometer_hang,
                "device:foreign_unit": foreign.kill,
            },
        )


def test_each_killed_source_is_told_and_the_next_one_flown_and_a_paused_agent_leaves_the_chip_safe(
    aircraft: tuple[Aircraft, dict[str, Callable[[], None]]],
) -> None:
    flown, kill = aircraft
    flown.until_register(GPS)
    flown.fleet.stop("tail")  # nobody renews the validity: the driver acts by itself
    flown.until_register(SAFE)
    flown.fleet.go_on("tail")
    flown.until_register(GPS)
    for source, planned, then in zip(kill, plans(tuple(kill)), (CONVERTER, AIR, FOREIGN, SAFE), strict=True):
        began_s = time.monotonic()
        kill[source]()
        flown.until_told(source)
        told_s = time.monotonic() - began_s
        flown.until_runs(planned)
        runs_s = time.monotonic() - began_s
        flown.until_register(then)
        moved_s = time.monotonic() - began_s
        print(f"{source}: told after {told_s:.2f} s, plan reached after {runs_s:.2f} s, moved after {moved_s:.2f} s")


def test_another_barometer_is_read_by_raw_i2c() -> None:
    chips = Chips()
    prom = chips.fill_ms5611(CONVERTED)
    driver = Ms5611(Setup("barometer", checked_options(Ms5611.OPTIONS, {"bus": 0, "address": MS5611}), 1))
    assert driver.read() == pressure_hpa(prom, CONVERTED, CONVERTED)
    driver.close()


def test_outputs_that_the_kernel_makes_are_found_and_a_transfer_that_fails_is_an_error() -> None:
    chips = Chips()
    named, nameless = ("ad5625", "out_voltage3"), (chips.nameless_output(), "out_voltage0")
    for (device, channel), raw in ((named, True), (nameless, True), (nameless, False)):
        options = checked_options(IioOutput.OPTIONS, {"device": device, "channel": channel, "raw": raw})
        with pytest.raises(OSError, match="Errno"):
            IioOutput(Setup("valve", options, 1)).command(1_000.0)
    options = checked_options(IioOutput.OPTIONS, {"device": named[0], "channel": named[1]})
    with pytest.raises(NotConnectedError, match="cannot tell the number in it; with the option 'raw'"):
        IioOutput(Setup("valve", options, 1))


def test_an_emergency_event_of_a_foreign_node_silences_its_datum_for_a_while() -> None:
    options = checked_options(UnitDriver.OPTIONS, {"node": NODE, "identifier": IDENTIFIER, "quiet_ms": 300})
    driver = UnitDriver(Setup("unit", options, 1, {"can0": {"interface": "socketcan", "channel": "vcan0"}}, "can0"))
    datum = encode_data(IDENTIFIER, Datum(NODE, DataType.FLOAT, 0, 0, 2.5))
    error = ErrorReport(1, 2, 3)
    with can.Bus("vcan0", interface="socketcan") as bus:

        def hears(*frames: Frame) -> list[object]:
            """Send some frames, and read as often."""
            for frame in frames:
                bus.send(can.Message(arbitration_id=frame.can_id, data=frame.data, is_extended_id=False))
            return [reading and reading.value for reading in (driver.read() for _ in frames)]

        assert hears(datum) == [2.5]
        assert hears(encode_emergency_event(NODE, error), datum) == [None, None]
        began_s = time.monotonic()
        while hears(datum) == [None]:
            assert time.monotonic() < began_s + PATIENCE_S
        assert hears(encode_emergency_event(NODE + 1, error), datum) == [2.5, None], "that of another one is not heard"
        assert hears(datum) == [2.5]
    driver.close()


def test_the_kernel_describes_the_buffer_of_its_converter_and_wants_a_trigger() -> None:
    chips = Chips()
    folder = device_folder(Path("/sys/bus/iio/devices"), chips.converter())
    kind = Element.of((folder / "scan_elements/in_voltage_type").read_text())
    assert (kind.bits, kind.size, kind.shift) == (8, 2, 4)
    options = checked_options(IioBuffer.OPTIONS, {"device": folder.name, "channel": "in_voltage", "raw": True})
    with pytest.raises(NotConnectedError, match="it needs a trigger"):
        IioBuffer(Setup("altimeter", options, 1))
    assert (folder / "scan_elements/in_voltage_en").read_text() == "1\n"
    assert (folder / "current_timestamp_clock").read_text().startswith("monotonic")
