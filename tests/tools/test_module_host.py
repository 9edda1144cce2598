"""The module host of a simulated PE: whatever the code of a module does, the host gives one answer."""

from dataclasses import replace

import pytest

from agent.one_pe import SERVO_1, TABLE
from heronry_agent.core.vocabulary import (
    Drive,
    DriveFailed,
    Driven,
    EndPartition,
    Heard,
    ModuleEvent,
    StartFailed,
    StartModule,
    StepFailed,
    StepModule,
    Stepped,
    StopModule,
)
from heronry_agent.module import Datum
from heronry_agent.shell.devices import Devices
from heronry_tools.aircraft.plant import Plant
from heronry_tools.sim.world.module_host import ModuleHost
from heronry_wire.pe_table import ModuleEntry

MODULE = SERVO_1


def entry(name: str, device: str | None = "left") -> ModuleEntry:
    return replace(TABLE.modules[1], image=f"agent.modules_for_host:{name}", device=device)


class Hosted:
    """A host with one module, started."""

    def __init__(self, name: str, device: str | None = "left") -> None:
        self.entry = entry(name, device)
        self.plant = Plant(0)
        table = replace(TABLE, modules=(self.entry,))
        self.host = ModuleHost(table, Devices(table, {} if device is None else {device: self.plant}))
        self.started = self.host.carry_out(StartModule(MODULE, self.entry, 0), 5)
        self._releases = 0

    def step(self, **inputs: float) -> ModuleEvent | None:
        self._releases += 1
        seen = {str(i): (name, Datum(value, 1, 0)) for i, (name, value) in enumerate(inputs.items())}
        return self.host.carry_out(StepModule(MODULE, self._releases, seen), 7)


def test_what_a_module_gives_writes_and_reports_comes_back_in_order() -> None:
    hosted = Hosted("Gain")
    assert hosted.started is None
    answer = hosted.step(rate=1.5)
    assert answer == Stepped(MODULE, 1, {"demand": 1.5}, (4.0, 8.0), (("device:left", 3),))
    assert hosted.plant.position("left") is None, "that is for the core to say"


def test_nothing_of_one_step_is_left_in_the_next() -> None:
    hosted = Hosted("Gain")
    hosted.step()
    answer = hosted.step()
    assert isinstance(answer, Stepped)
    assert len(answer.writes) == 2
    assert len(answer.reports) == 1


def test_a_device_is_driven_when_the_core_says_so() -> None:
    hosted = Hosted("Gain")
    assert hosted.host.carry_out(Drive(MODULE, 8.0), 7) == Driven(MODULE, 8.0)
    assert hosted.plant.position("left") == 8.0


def test_a_device_that_did_not_move_is_not_echoed() -> None:
    hosted = Hosted("Gain")
    hosted.plant.fail("left", "stuck", 0)
    assert hosted.host.carry_out(Drive(MODULE, 8.0), 7) is None


def test_a_device_that_cannot_execute_its_command_reports_it() -> None:
    servo = Hosted("Gain", device="elevator_servo_1")
    answer = servo.host.carry_out(Drive(MODULE, "up"), 7)
    assert isinstance(answer, DriveFailed)
    assert "needs a number as its command" in answer.reason
    nothing = Hosted("Steady", device=None)
    assert nothing.host.carry_out(Drive(MODULE, 1.0), 7) == DriveFailed(MODULE, "the module has no device to drive")


def test_a_partition_that_ends_takes_its_modules_with_it() -> None:
    hosted = Hosted("Counting")
    hosted.host.carry_out(EndPartition("another"), 6)
    assert isinstance(hosted.step(), Stepped)
    hosted.host.carry_out(EndPartition(hosted.entry.partition), 6)
    assert isinstance(hosted.step(), StepFailed)


def test_a_module_knows_its_name_mode_period_and_the_time() -> None:
    answer = Hosted("Knowing").step()
    assert isinstance(answer, Stepped)
    assert answer.outputs == {"words": "servo_1 only 25000000 7"}


def test_a_module_is_built_anew_when_it_is_started_again() -> None:
    hosted = Hosted("Counting")
    hosted.step()
    hosted.host.carry_out(StartModule(MODULE, hosted.entry, 0), 9)
    answer = hosted.step()
    assert isinstance(answer, Stepped)
    assert answer.outputs == {"steps": 1}


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("Raising", "ZeroDivisionError: of all things (modules_for_host.py:40)"),
        ("Wrong", "the module's step gave int, not a mapping"),
    ],
)
def test_what_a_step_does_wrong_is_one_line(name: str, reason: str) -> None:
    answer = Hosted(name).step()
    assert isinstance(answer, StepFailed)
    assert answer.reason == reason


def test_an_exception_has_a_traceback_that_begins_in_the_module() -> None:
    answer = Hosted("Raising").step()
    assert isinstance(answer, StepFailed)
    first, place, *_ = answer.traceback.splitlines()
    assert first == "Traceback (most recent call last):"
    assert "modules_for_host.py" in place
    assert answer.traceback.endswith("ZeroDivisionError: of all things\nand a second line\n")


def test_the_place_of_an_exception_is_in_the_file_of_the_module_also_if_a_library_raises() -> None:
    answer = Hosted("Reading").step()
    assert isinstance(answer, StepFailed)
    assert answer.reason.startswith("JSONDecodeError: Expecting value")
    assert "(modules_for_host.py:" in answer.reason


def test_an_exception_that_cannot_be_described_is_named() -> None:
    assert Hosted("Unspeakable").step() == StepFailed(MODULE, 1, "Unspeakable_")


def test_a_module_that_cannot_be_built_is_one_line_and_cannot_be_stepped() -> None:
    hosted = Hosted("Unbuildable")
    assert isinstance(hosted.started, StartFailed)
    assert hosted.started.reason == "MemoryError (modules_for_host.py:45)"
    assert isinstance(hosted.step(), StepFailed)


def test_a_module_without_a_device_has_nothing_to_read() -> None:
    answer = Hosted("Deviceless", device=None).step()
    assert isinstance(answer, StepFailed)
    assert "has no device" in answer.reason


def test_a_stopped_module_is_gone() -> None:
    hosted = Hosted("Counting")
    hosted.host.carry_out(StopModule(MODULE), 6)
    assert isinstance(hosted.step(), StepFailed)


def test_an_echo_moves_the_world() -> None:
    hosted = Hosted("Counting")
    hosted.host.carry_out(Heard("right", -2.0), 6)
    assert hosted.plant.position("right") == -2.0


def test_images_that_cannot_be_loaded_are_known_from_the_start() -> None:
    hosted = Hosted("Nonexistent")
    (reason,) = hosted.host.missing_images.values()
    assert "no class Nonexistent" in reason
    assert isinstance(hosted.started, StartFailed)
