"""A standby manager, and a change of the spec in flight: real cores of two managers and of three PEs on one bus."""

from typing import Any

import pytest

from heronry_dg.model import Spec
from heronry_manager import events
from heronry_manager.core.memory import NOTHING, Memory
from heronry_wire.authentication import Key
from heronry_wire.element_places import spec_mark
from heronry_wire.frame import Frame
from heronry_wire.identifiers import Command, management_id, sdo_request_id
from heronry_wire.management import (
    Control,
    ElementKind,
    Operation,
    Prepare,
    SliceBody,
    SliceHead,
    decode_command,
)
from manager.reload_world import MS, Standby, World
from manager.test_reloading import SAME, Judge, newer, old

KEY = Key(bytes(range(32)))
HEARTBEAT_NS = 20 * MS


def flying(key: Key | None = None, spec: Spec | None = None, memory: Memory = NOTHING) -> tuple[World, Standby]:
    """An aircraft that flies the old spec, and a standby manager of `spec` (None: the old one)."""
    world = World(old(), key=key)
    standby = world.add_standby(spec or old(), memory)
    assert world.run(20_000 * MS, lambda: world.status()["stage"] == "done" and not world.status()["next"])
    assert world.run(8_000 * MS, lambda: state(standby) == "standby")
    world.run(1_000 * MS)
    return world, standby


def state(standby: Standby) -> str:
    return str(standby.core.status()["manager"]["state"])


def reload_state(standby: Standby) -> dict[str, Any]:
    return dict(standby.core.status()["reload"])


def reloaded(world: World, spec: Spec) -> None:
    cores = world.cores
    assert world.run(10_000 * MS, lambda: world.reload(spec).done)
    assert world.run(60_000 * MS, lambda: world.cores > cores)


def takes_over(world: World, standby: Standby) -> bool:
    """Kill the active manager; tell whether the standby manager commands within ten seconds."""
    world.dead.add("manager")
    world.run(10_000 * MS, lambda: standby.core.is_active and standby.core.plan is not None)
    world.run(2_000 * MS)
    return standby.core.is_active


@pytest.mark.parametrize("key", [None, KEY])
def test_a_standby_that_has_the_spec_follows_and_takes_over_what_runs(key: Key | None) -> None:
    world, standby = flying(key)
    judge = Judge(world)
    world.give_standby(newer())
    assert reload_state(standby)["at_hand"] == newer().digest
    reloaded(world, newer())
    world.run(3_000 * MS)
    assert (standby.spec.digest, standby.cores, state(standby)) == (newer().digest, 2, "standby")
    assert reload_state(standby) == {"to": None, "state": None, "given_up": None, "at_hand": None, "flies": None}
    before = {name: len(times) for pe in world.pes.values() for name, times in pe.steps.items()}
    assert takes_over(world, standby)
    assert world.specs_that_fly() == {newer().digest}
    assert [type(told) for told in standby.events if isinstance(told, events.Adopted | events.EpochPrepared)] == [
        events.Adopted
    ]
    after = {name: len(times) for pe in world.pes.values() for name, times in pe.steps.items()}
    assert all(after[name] > before[name] for name in SAME)
    assert not judge.doubled


@pytest.mark.parametrize("key", [None, KEY])
def test_a_standby_that_lacks_the_spec_does_not_command_until_it_is_given_it(key: Key | None) -> None:
    world, standby = flying(key)
    reloaded(world, newer())
    world.run(3_000 * MS)
    mark = f"{spec_mark(newer().digest):04x}"
    assert reload_state(standby)["flies"] == mark
    assert [told.digest for told in standby.events if isinstance(told, events.OtherSpecFlies)] == [mark]
    assert not takes_over(world, standby)
    assert state(standby) == "standby"
    assert world.specs_that_fly() == {newer().digest}
    world.give_standby(newer())
    assert standby.spec.digest == newer().digest
    assert world.run(20_000 * MS, lambda: standby.core.is_active and standby.core.status()["stage"] == "done")
    assert world.specs_that_fly() == {newer().digest}


def test_back_again_and_the_standby_follows_each_time() -> None:
    world, standby = flying()
    for cores, spec in enumerate((newer(), old()), 2):
        world.give_standby(spec)
        reloaded(world, spec)
        world.run(3_000 * MS)
        assert (standby.cores, standby.spec.digest) == (cores, spec.digest)
    assert takes_over(world, standby)
    assert world.specs_that_fly() == {old().digest}


def test_a_manager_that_returns_with_the_old_spec_does_not_command_beside_a_standby_that_flies_the_new_one() -> None:
    world, standby = flying()
    world.give_standby(newer())
    reloaded(world, newer())
    world.run(3_000 * MS)
    assert takes_over(world, standby)
    world.restart(old())
    world.run(5_000 * MS)
    status = world.manager.status()
    assert status["manager"]["state"] == "standby"
    assert status["reload"]["flies"] == f"{spec_mark(newer().digest):04x}"
    assert world.specs_that_fly() == {newer().digest}


def test_a_reload_that_is_given_up_leaves_the_standby_with_the_old_spec() -> None:
    world, standby = flying()
    world.give_standby(newer())
    assert world.reload(newer()).done
    world.run(100 * MS)
    world.dead.add("control_pe")
    assert world.run(5_000 * MS, lambda: world.status()["reload"]["given_up"] is not None)  # type: ignore[index]
    assert standby.cores == 1
    assert takes_over(world, standby)
    assert world.specs_that_fly() == {old().digest}


def test_a_restart_remembers_that_another_spec_flies_and_the_right_spec_forgets_it() -> None:
    world, standby = flying()
    reloaded(world, newer())
    world.run(3_000 * MS)
    assert standby.memory.flies == spec_mark(newer().digest)
    world.dead.add("manager")
    world.run(200 * MS)
    again = world.add_standby(old(), standby.memory)
    world.run(10_000 * MS)
    assert (state(again), reload_state(again)["flies"]) == ("standby", f"{spec_mark(newer().digest):04x}")
    right = world.add_standby(newer(), standby.memory.numbers())
    assert world.run(20_000 * MS, lambda: right.core.is_active and right.core.status()["stage"] == "done")
    assert world.specs_that_fly() == {newer().digest}


def control(world: World, operation: Operation, a: int, b: int) -> Frame:
    """A CONTROL of the active manager in its term, as a forger makes it."""
    message = Control(world.manager.term, 0, operation, a, b)
    return Frame(management_id(126, Command.CONTROL), message.encode())


def forged(world: World, spec: Spec) -> Frame:
    return control(world, Operation.HOLDS, ElementKind.SPEC, spec_mark(spec.digest))


@pytest.mark.parametrize("key", [None, KEY])
@pytest.mark.parametrize("has_spec", [False, True])
def test_a_forged_announcement_keeps_no_standby_from_taking_over(key: Key | None, *, has_spec: bool) -> None:
    world, standby = flying(key)
    if has_spec:
        world.give_standby(newer())
    for _ in range(3):
        world.deliver(forged(world, newer()), "forger")
        world.run(HEARTBEAT_NS)
    assert standby.cores == 1
    assert reload_state(standby)["flies"] is None
    assert takes_over(world, standby)
    assert world.specs_that_fly() == {old().digest}


def test_after_a_forged_announcement_facts_count_again_when_it_is_not_repeated() -> None:
    world, standby = flying()
    world.deliver(forged(world, newer()), "forger")
    fault = control(world, Operation.HOLDS, ElementKind.DEVICE, 0)
    world.deliver(fault, "forger")
    assert not standby.memory.latched
    world.run(100 * HEARTBEAT_NS)
    world.deliver(fault, "forger")
    assert standby.memory.latched
    assert standby.memory.flies == spec_mark(old().digest)


@pytest.mark.parametrize("key", [None, KEY])
def test_frames_of_an_earlier_switch_change_nothing(key: Key | None) -> None:
    """All that the manager has sent for a switch to the new spec is sent again, when the old spec flies again."""
    world, standby = flying(key)
    recorded: list[Frame] = []
    world.watches = lambda _ns, frame, sender: recorded.append(frame) if sender == "manager" else None
    for spec in (newer(), old()):
        world.give_standby(spec)
        reloaded(world, spec)
        world.watches = lambda _ns, _frame, _sender: None
        world.run(3_000 * MS)
    commands = {frame.can_id for frame in recorded}
    assert {management_id(126, one) for one in (Command.PREPARE, Command.SLICE, Command.ACTIVATE)} <= commands
    assert {sdo_request_id(pe.node_id) for pe in old().pes.values()} <= commands
    cores, epoch = (world.cores, standby.cores), world.status()["epoch"]
    running = {name: set(pe.running) for name, pe in world.pes.items()}
    for frame in recorded:
        world.deliver(frame, "forger")
        world.run(MS // 2)
    world.run(3_000 * MS)
    assert (world.cores, standby.cores) == cores
    assert world.status()["epoch"] == epoch
    assert {name: set(pe.running) for name, pe in world.pes.items()} == running
    assert world.specs_that_fly() == {old().digest}
    assert state(standby) == "standby"
    assert takes_over(world, standby)
    assert world.specs_that_fly() == {old().digest}


def test_facts_in_the_indices_of_the_next_spec_are_not_taken_for_those_of_the_old_one() -> None:
    """The first announcements of the new term are lost: until one comes, the standby takes in nothing else."""
    world, standby = flying()
    announcement = (Operation.HOLDS, ElementKind.SPEC, spec_mark(old().digest))

    def lost(_number: int, frame: Frame) -> bool:
        message = decode_command(Command.CONTROL, frame.data)
        is_control = frame.can_id == management_id(126, Command.CONTROL) and isinstance(message, Control)
        return is_control and (message.operation, message.a, message.b) == announcement

    world.give_standby(newer())
    reloaded(world, newer())
    world.run(1_000 * MS)
    world.give_standby(old())
    world.lost = lost
    reloaded(world, old())
    world.run(40 * MS)
    assert standby.spec.digest == newer().digest
    world.deliver(control(world, Operation.HOLDS, ElementKind.DEVICE, 0), "manager")
    assert not standby.memory.latched
    world.lost = lambda _number, _frame: False
    assert world.run(5_000 * MS, lambda: standby.spec.digest == old().digest)


def test_a_slice_for_a_node_that_the_spec_lacks_ends_no_standby() -> None:
    world, standby = flying()
    stranger, epoch = 120, 900
    for command, message in (
        (Command.PREPARE, Prepare(world.manager.term, epoch, 1)),
        (Command.SLICE, SliceHead(stranger, epoch & 0xFF, 3, 0x123456)),
        (Command.SLICE, SliceBody(stranger, epoch & 0xFF, 1, bytes(3))),
    ):
        world.deliver(Frame(management_id(126, command), message.encode()), "forger")
    assert state(standby) == "standby"
