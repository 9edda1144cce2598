"""How a PE takes a configuration into use, step by step, and what it may drive meanwhile (protocol rules 4 and 6)."""

from collections.abc import Mapping
from dataclasses import replace
from random import Random

from heronry_agent.module import Context, Inputs, Value
from heronry_wire.canopen_objects import MODULE_STATES
from heronry_wire.configuration_slice import ModuleSlice, Slice
from heronry_wire.frame import Frame
from heronry_wire.identifiers import emcy_id, state_id
from heronry_wire.management import Activate, Alive, ElementKind, Emergency, FaultCode, Lease, Ping, Step
from heronry_wire.state_frames import PeFlags, PeState, Reason, StatePage0, StatePage1
from lab.conformance import puppets
from lab.conformance.pe_under_test import (
    CONTROL,
    DEMAND,
    DEMAND_ID,
    EVERYTHING,
    GAUGE,
    HEIGHT,
    HEIGHT_ID,
    HELP_ID,
    HELPER,
    LAMP,
    NEIGHBOUR,
    NODE,
    OTHER_HEIGHT_ID,
    PERIOD_NS,
    SERVO,
    TABLE,
    PeUnderTest,
    datum,
    gaps,
    immediate,
    moments,
)
from lab.conformance.player import MS, demand, equal

_EPOCH, _DIGEST = 17, 0x111111
_NEXT, _NEXT_DIGEST = 18, 0x222222
_GAUGE, _SERVO = ModuleSlice(GAUGE, 0, ()), ModuleSlice(SERVO, 0, (DEMAND,))
_FINE, _COARSE = ModuleSlice(CONTROL, 0, (HEIGHT,)), ModuleSlice(CONTROL, 1, ())
_LAMP, _HELPER = ModuleSlice(LAMP, 0, (DEMAND,)), ModuleSlice(HELPER, 0, ())


def _attended() -> PeUnderTest:
    pe = PeUnderTest().attended()
    puppets.behave_normally()
    return pe


def _takes(pe: PeUnderTest, epoch: int, step: Step, digest: int, state: PeState) -> None:
    """Demand that the PE takes a step, and reports it immediately."""
    pe.run_into_next_period(5)
    pe.activate(epoch, step, digest)
    began_ns = pe.run(1.5)
    pages = [page for t_ns, page in pe.pages_0(began_ns) if immediate(t_ns, began_ns)]
    equal(
        [(p.state, p.epoch, p.digest) for p in pages],
        [(state, epoch, digest)],
        f"immediately after {step.name} it reports",
    )


def it_takes_one_step_after_the_other() -> None:
    """The PE reports BROKEN, PARTIAL while a new branch is held, ACTIVE; each immediately, and takes each step once."""
    pe = _attended()
    pe.prepare(_EPOCH, EVERYTHING, _DIGEST)
    pe.run(15)
    for step, state in ((Step.BREAK, PeState.BROKEN), (Step.GO, PeState.PARTIAL), (Step.GO_ALL, PeState.ACTIVE)):
        _takes(pe, _EPOCH, step, _DIGEST, state)
        pe.main.command(Activate(5, _EPOCH, step, _DIGEST), Activate(5, _EPOCH, Step.BREAK, _DIGEST))
        began_ns = pe.run(2)
        equal(pe.pages_0(began_ns), [], f"pages 0 after {step.name} again")
        began_ns = pe.run(60)
        drives = bool([t for t in pe.drives if t > began_ns])
        equal(drives, step is Step.GO_ALL, f"at {step.name} its branch is driven")
        speaks = bool(pe.data(HEIGHT_ID, began_ns))
        equal(speaks, step >= Step.GO, f"at {step.name} it publishes")
    equal({page.sequence for _, page in pe.pages_0(-1)} >= {0, 1}, True, "sequences")


def without_a_branch_go_is_the_last_step() -> None:
    """The PE is ACTIVE at GO where no branch is held; GO_ALL contains all steps."""
    pe = _attended()
    pe.prepare(_EPOCH, Slice((_GAUGE,), publish={HEIGHT: 1}), _DIGEST)
    pe.run(5)
    _takes(pe, _EPOCH, Step.GO, _DIGEST, PeState.ACTIVE)
    pe.prepare(_NEXT, EVERYTHING, _NEXT_DIGEST)
    pe.run(5)
    _takes(pe, _NEXT, Step.GO_ALL, _NEXT_DIGEST, PeState.ACTIVE)
    pe.prepare(_NEXT + 1, EVERYTHING, _DIGEST)
    pe.run(5)
    _takes(pe, _NEXT + 1, Step.GO, _DIGEST, PeState.ACTIVE)  # the branch is not new here


def a_lease_is_as_good_as_an_activate() -> None:
    """A PE that missed ACTIVATE takes the step from the next LEASE; LEASE at PREPARED, or of epoch 0, has no effect."""
    pe = _attended()
    pe.prepare(_EPOCH, EVERYTHING, _DIGEST)
    pe.run(15)
    pe.lease = Lease(5, _EPOCH, Step.PREPARED, _DIGEST)
    pe.run(45)
    equal(pe.page_0().state, PeState.UNCONFIGURED, "after a LEASE at PREPARED it is")
    for step, state in ((Step.BREAK, PeState.BROKEN), (Step.GO_ALL, PeState.ACTIVE)):
        pe.lease = Lease(5, _EPOCH, step, _DIGEST)
        pe.run(45)
        equal((pe.page_0().state, pe.page_0().epoch), (state, _EPOCH), f"after a LEASE at {step.name} it is")
    pe.lease = Lease(5, 0, Step.GO_ALL, 0)
    pe.run(45)
    equal((pe.page_0().state, pe.page_0().epoch), (PeState.ACTIVE, _EPOCH), "after a LEASE of epoch 0 it is")
    demand(PeFlags.OUTPUT_HELD not in pe.page_0().flags, "a LEASE of epoch 0 holds its outputs")


def what_was_not_staged_is_not_run() -> None:
    """ACTIVATE of another epoch or digest changes only the output authorization."""
    pe = _attended().flies()
    demand(PeFlags.OUTPUT_HELD not in pe.pinged().flags, "its outputs are held")
    for order in (Activate(5, _EPOCH - 1, Step.GO_ALL, 1), Activate(5, _NEXT, Step.PREPARED, 1)):
        pe.main.command(order)
        pe.run(1)
        demand(PeFlags.OUTPUT_HELD not in pe.pinged().flags, f"{order} holds its outputs")
    for order in (Activate(5, _EPOCH, Step.GO_ALL, 1), Activate(5, _NEXT, Step.GO_ALL, 1)):
        pe.run_into_next_period(5)
        pe.main.command(order)
        pe.run(1)
        page = pe.pinged()
        equal((page.state, page.epoch, page.digest), (PeState.ACTIVE, _EPOCH, _DIGEST), f"after {order}")
        demand(PeFlags.OUTPUT_HELD in page.flags, f"{order} does not hold its outputs")
        pe.run(22)  # a LEASE names what runs
        demand(PeFlags.OUTPUT_HELD not in pe.pinged().flags, "a LEASE that names what runs does not free its outputs")


def break_takes_away_and_adds_nothing() -> None:
    """At BREAK a module that is not wanted, or in another mode, stops; no new datum is published before GO."""
    pe = _attended()
    both = Slice((_GAUGE, _COARSE, _SERVO), publish={HEIGHT: 1})
    pe.flies(both)
    after = Slice((_GAUGE, _FINE, _LAMP, _HELPER), publish={HEIGHT: 1, DEMAND: 1, 2: 1})
    pe.prepare(_NEXT, after, _NEXT_DIGEST)
    pe.run(10)
    _takes(pe, _NEXT, Step.BREAK, _NEXT_DIGEST, PeState.BROKEN)
    began_ns = pe.run(100)
    demand(bool(pe.data(HEIGHT_ID, began_ns)), "a datum that stays is published no more")
    for identifier in (DEMAND_ID, HELP_ID):
        equal(pe.data(identifier, began_ns), [], f"data under {identifier} at BREAK")
    demand(not [t for t in pe.drives if t > began_ns], "a branch that is not wanted is driven after BREAK")
    _takes(pe, _NEXT, Step.GO, _NEXT_DIGEST, PeState.ACTIVE)
    began_ns = pe.run(100)
    for identifier in (HEIGHT_ID, DEMAND_ID, HELP_ID):
        demand(bool(pe.data(identifier, began_ns)), f"nothing is published under {identifier} after GO")
    equal(pe.data(DEMAND_ID, began_ns)[0][1].value, 100.0, "demand")


def a_branch_that_ran_is_not_held() -> None:
    """A branch that ran here in the epoch before is not held, since no other PE has it. A new one waits for GO_ALL."""
    pe = _attended()
    pe.flies(Slice((_GAUGE, _COARSE, _SERVO), publish={HEIGHT: 1}))
    pe.prepare(_NEXT, EVERYTHING, _NEXT_DIGEST)
    pe.run(10)
    _takes(pe, _NEXT, Step.BREAK, _NEXT_DIGEST, PeState.BROKEN)
    began_ns = pe.run(60)
    demand(bool([t for t in pe.drives if t > began_ns]), "a branch that stays is stopped by BREAK")
    _takes(pe, _NEXT, Step.GO, _NEXT_DIGEST, PeState.ACTIVE)


def a_module_that_can_goes_on_in_another_mode() -> None:
    """A module that can change its mode goes on over BREAK, others are built anew; a newer epoch may drop it."""
    for keeps in (False, True):
        pe = _attended()
        if keeps:
            puppets.CHANGES_MODE.add("control")
        pe.flies(Slice((_GAUGE, _FINE), publish={DEMAND: 1}))
        puppets.BUILT.clear()
        pe.prepare(_NEXT, Slice((_GAUGE, _COARSE), publish={DEMAND: 1}), _NEXT_DIGEST)
        pe.run(10)
        _takes(pe, _NEXT, Step.BREAK, _NEXT_DIGEST, PeState.BROKEN)
        _takes(pe, _NEXT, Step.GO, _NEXT_DIGEST, PeState.ACTIVE)
        began_ns = pe.run(100)
        equal(puppets.BUILT, [] if keeps else ["control"], "modules built when a mode changes")
        equal({d.value for _, d in pe.data(DEMAND_ID, began_ns)}, {0.5}, "what it gives in the other mode")
        equal({d.service_code & 15 for _, d in pe.data(DEMAND_ID, began_ns)}, {2}, "the version that it gives there")
        pe.prepare(_NEXT + 1, Slice((_GAUGE, _FINE)), _DIGEST)
        pe.run(10)
        _takes(pe, _NEXT + 1, Step.BREAK, _DIGEST, PeState.BROKEN)
        pe.prepare(_NEXT + 2, Slice((_GAUGE,)), _NEXT_DIGEST)
        pe.run(10)
        _takes(pe, _NEXT + 2, Step.GO_ALL, _NEXT_DIGEST, PeState.ACTIVE)
        puppets.BUILT.clear()
        pe.prepare(_NEXT + 3, Slice((_GAUGE, _FINE), publish={DEMAND: 1}), _DIGEST)
        pe.run(10)
        _takes(pe, _NEXT + 3, Step.GO_ALL, _DIGEST, PeState.ACTIVE)
        pe.run(10)
        equal(puppets.BUILT, ["control"], "modules built when one was given up in between")


def a_module_that_waits_to_be_built_anew_is_not_carried_over() -> None:
    """It has failed: also for the other mode the module is built anew."""
    again = tuple(replace(one, restarts=2) if one.index == CONTROL else one for one in TABLE.modules)
    pe = PeUnderTest(replace(TABLE, modules=again)).attended()
    puppets.behave_normally()
    puppets.CHANGES_MODE.add("control")
    pe.flies(Slice((_GAUGE, _FINE), publish={DEMAND: 1}))
    working = puppets.BEHAVIOUR["control"]
    puppets.BEHAVIOUR["control"] = puppets.raising
    pe.run(50)  # it has failed twice, and waits
    puppets.BEHAVIOUR["control"] = working
    pe.prepare(_NEXT, Slice((_GAUGE, _COARSE), publish={DEMAND: 1}), _NEXT_DIGEST)
    pe.run(10)
    puppets.BUILT.clear()
    _takes(pe, _NEXT, Step.BREAK, _NEXT_DIGEST, PeState.BROKEN)
    _takes(pe, _NEXT, Step.GO, _NEXT_DIGEST, PeState.ACTIVE)
    pe.run(20)
    equal(puppets.BUILT, ["control"], "modules built for the other mode")


def data_come_and_go_as_wired() -> None:
    """A module reads data of the named node, type and version, for three periods; before that the initial value."""
    pe = _attended()
    puppets.BEHAVIOUR["lamp"] = _watch
    lamp = Slice((_LAMP,), remote={DEMAND: NEIGHBOUR})
    pe.flies(lamp)
    _SEEN.clear()
    pe.run(110)
    equal(_SEEN, [(0.25, 1)], "before the first datum it sees the initial value")
    for frame in (
        datum(DEMAND_ID, 1.0, node=NEIGHBOUR + 1),
        datum(DEMAND_ID, 1.0, version=3),
        datum(DEMAND_ID, 1.0)._replace(data=datum(DEMAND_ID, 1.0).data[:-1]),
        datum(DEMAND_ID, 1.0)._replace(data=bytes((NEIGHBOUR, 3, 0x11, 0, 0, 0, 0, 1))),
        datum(DEMAND_ID, 1.0)._replace(data=bytes((NEIGHBOUR, 2, 0x10, 0, 0, 0, 0, 1))),
    ):
        pe.main.say(frame)
        _SEEN.clear()
        pe.run(110)
        if frame == datum(DEMAND_ID, 1.0, version=3):
            equal(_SEEN, [], "what it sees of a version that it does not accept")
            continue
        equal([one for one in _SEEN if one[0] not in (0.25, None)], [], f"what it sees of {frame}")
    pe.main.say(datum(DEMAND_ID, 3.0, version=2))
    came_ns = pe.now_ns
    _SEEN.clear()
    pe.run_until(came_ns + 230 * MS)
    equal(set(_SEEN), {(3.0, 2)}, "what it sees of a datum that it accepts")
    demand(1 <= len(_SEEN) <= 2, f"an old datum was seen {len(_SEEN)} times within 230 ms, at 10 Hz")
    demand(max(_AGES) <= 120 * MS, f"a datum was seen when it was {max(_AGES)} ns old")


_SEEN: list[tuple[object, int]] = []
_AGES: list[int] = []


def _watch(_ctx: Context, inputs: Inputs) -> Mapping[str, Value]:
    found = inputs.get("demand")
    if found is not None:
        _SEEN.append((found.value, found.version))
        _AGES.append(found.age_ns)
    return {}


def a_datum_that_its_producer_does_not_trust_says_so() -> None:
    """Data with validity not stated, valid or degraded are usable; a module sees invalid and not computed as such."""
    pe = _attended()
    trusted: list[bool] = []

    def look(_ctx: Context, inputs: Inputs) -> Mapping[str, Value]:
        trusted.extend(datum.valid for datum in inputs.values())
        return {}

    puppets.BEHAVIOUR["lamp"] = look
    pe.flies(Slice((_LAMP,), remote={DEMAND: NEIGHBOUR}))
    for validity, is_trusted in enumerate((True, True, True, False, False)):
        frame = datum(DEMAND_ID, 1.0)
        pe.main.say(frame._replace(data=frame.data[:2] + bytes((validity << 4 | 1,)) + frame.data[3:]))
        trusted.clear()
        pe.run(100)
        equal(set(trusted), {is_trusted}, f"trusted with validity {validity}")


def a_step_may_wait_for_the_processor() -> None:
    """A step waits for T_lease at most: a processor that is busy for some ms with each module computes all of them."""
    pe = _attended().flies()
    pe.pe.steps.slow = Random(0)
    began_ns = pe.run(400)
    for identifier in (HEIGHT_ID, DEMAND_ID, HELP_ID):
        count = len(pe.data(identifier, began_ns))
        demand(count >= 8, f"{count} data under {identifier} of a slow processor in 400 ms")


def data_that_another_node_may_send_are_withdrawn() -> None:
    """Frames of a source that moves away, and that still wait while the bus is full, are not sent after BREAK."""
    pe = _attended().flies()
    pe.prepare(_NEXT, Slice((_GAUGE,), publish={HEIGHT: 1}), _NEXT_DIGEST)
    _fill_the_bus(pe)
    pe.run(25)
    pe.activate(_NEXT, Step.BREAK, _NEXT_DIGEST)
    began_ns = pe.run(100)
    broken_ns = next(t_ns for t_ns, page in pe.pages_0(began_ns) if page.state is PeState.BROKEN)
    late = [t_ns for identifier in (DEMAND_ID, HELP_ID) for t_ns, _ in pe.data(identifier, broken_ns)]
    equal(late, [], "data after it has said that it is broken")
    demand(bool(pe.data(HEIGHT_ID, broken_ns)), "data that stay are withdrawn, too")
    codes = [d.message_code for _, d in pe.data(HEIGHT_ID, -1)]
    equal(codes, list(range(len(codes))), "message codes of what stays")


def data_that_the_manager_may_give_away_are_withdrawn() -> None:
    """Waiting frames of a movable module are withdrawn when ALIVE names other PEs, or another node has this node-ID."""
    for clashes in (False, True):
        pe = _attended().flies()
        _fill_the_bus(pe)
        pe.run(17)
        if clashes:
            pe.main.say(Frame(state_id(NODE), StatePage0(PeState.UNCONFIGURED, PeFlags(0), 99, 0, 0, 0).encode()))
        else:
            pe.alive = frozenset((NEIGHBOUR,))
        pe.run(3)
        began_ns = pe.run(50)
        what = "another node has its number" if clashes else "ALIVE names others"
        equal(pe.data(DEMAND_ID, began_ns), [], f"data of what may run elsewhere, when {what}")


def _fill_the_bus(pe: PeUnderTest) -> None:
    """Fill the bus for more than a heartbeat period with frames that are more urgent than all data."""
    pe.run_into_next_period(2)
    pe.main.say(*[Frame(HEIGHT_ID - 1, bytes(8))] * 240)


def a_branch_needs_its_name_in_alive() -> None:
    """A branch is driven from the first ALIVE that names its PE to the first ALIVE that does not."""
    pe = PeUnderTest()
    puppets.behave_normally()
    pe.lease = Lease(5, 0, Step.PREPARED, 0)
    pe.neighbour = StatePage0(PeState.UNCONFIGURED, PeFlags.HEARS_LEASE, 1, 0, 0, 0)
    pe.run(150)
    pe.flies()
    demand(PeFlags.OUTPUT_HELD in pe.pinged().flags, "it drives before any ALIVE")
    equal(pe.drives, [], "when its branch was driven before any ALIVE")
    pe.alive = frozenset((NODE,))
    pe.run(45)
    demand(PeFlags.OUTPUT_HELD not in pe.pinged().flags, "ALIVE names it, and it holds back")
    demand(bool(pe.drives), "ALIVE names it, and its branch is not driven")
    pe.alive = frozenset((NODE - 1, NODE + 1, NEIGHBOUR))
    pe.run(21)
    began_ns = pe.run(60)
    demand(PeFlags.OUTPUT_HELD in pe.pinged().flags, "ALIVE names others, and it does not hold back")
    demand(not [t for t in pe.drives if t > began_ns], "its branch is driven, and ALIVE names others")


def a_branch_needs_another_node_to_be_heard() -> None:
    """It is driven for T_lease after the last page 0, LEASE or ALIVE; data, pages 1 and EMCYs do not count."""
    for heard in ("neighbour", "manager"):
        pe = _attended().flies()
        pe.run_until(pe.now_ns // PERIOD_NS * PERIOD_NS + 5 * MS)
        last_ns = pe.now_ns // PERIOD_NS * PERIOD_NS
        if heard == "neighbour":
            pe.lease = pe.alive = None
            pe.run(300)
            last_ns = pe.now_ns // PERIOD_NS * PERIOD_NS
        pe.neighbour = pe.lease = pe.alive = None
        pe.said = lambda pe=pe: pe.main.say(*_NO_EVIDENCE)
        pe.run_until(last_ns + 300 * MS)
        last_drive_ns = max(pe.drives)
        demand(
            last_ns + 75 * MS < last_drive_ns <= last_ns + 102 * MS,
            f"after the last frame of another node it drives for {(last_drive_ns - last_ns) / MS} ms",
        )
        demand(PeFlags.OUTPUT_HELD in pe.page_0().flags, "it hears no other node, and does not report OUTPUT_HELD")


_NO_EVIDENCE = (
    Frame(emcy_id(NEIGHBOUR), Emergency(FaultCode.REPORTED, 0x81, ElementKind.DEVICE, 2, 0).encode()),
    Frame(state_id(NEIGHBOUR), StatePage1(PeState.ACTIVE, PeFlags.HEARS_LEASE, 0, 0, Reason.NONE, 0).encode()),
    datum(OTHER_HEIGHT_ID, 1.0),
)


def after_a_silence_an_alive_must_name_it() -> None:
    """Until ALIVE names it, or it hears other nodes for T_lease, the PE is in doubt."""
    pe = _attended().flies()
    kept = pe.neighbour
    pe.lease = pe.alive = pe.neighbour = None
    pe.run(200)
    pe.neighbour = kept
    pe.run_until(pe.now_ns // PERIOD_NS * PERIOD_NS + PERIOD_NS)
    again_ns = pe.now_ns
    pe.run_until(again_ns + 300 * MS)
    first_ns = min(t for t in pe.drives if t > again_ns)
    demand(
        95 * MS < first_ns - again_ns < 125 * MS,
        f"after a silence it drives again {(first_ns - again_ns) / MS} ms after another node is heard",
    )
    pe.neighbour = None
    pe.run(200)
    pe.main.command(Lease(5, _EPOCH, Step.GO_ALL, _DIGEST), Alive(5, 0, frozenset((NODE,))))
    began_ns = pe.run(25)
    demand(bool([t for t in pe.drives if t > began_ns]), "after a silence ALIVE names it, and it does not drive")


def a_manager_that_has_just_become_active_ends_no_doubt() -> None:
    """Such a manager has every PE that it hears available, even a replaced one; naming what runs ends the doubt."""
    pe = _back_under_another(after_ms=200)
    began_ns = pe.run(90)
    equal([t for t in pe.drives if t > began_ns], [], "its branch is driven, and no manager has named what runs")
    pe.lease = Lease(6, _EPOCH, Step.GO_ALL, _DIGEST)
    began_ns = pe.run(45)
    demand(bool([t for t in pe.drives if t > began_ns]), "a manager names what runs, and its branch stands still")
    pe = _back_under_another(after_ms=70)
    began_ns = pe.run(90)
    demand(bool([t for t in pe.drives if t > began_ns]), "its branch stands still after a silence within T_lease")
    equal(pe.data(DEMAND_ID, began_ns), [], "data of a movable module, while no manager has named what runs")
    began_ns = pe.run(60)
    demand(bool(pe.data(DEMAND_ID, began_ns)), "what could run elsewhere is sent no more")


def a_step_before_the_last_ends_no_doubt() -> None:
    """The PE that took its place may not have released its outputs yet."""
    pe = _back_under_another(after_ms=200)
    pe.lease = Lease(6, _EPOCH, Step.GO, _DIGEST)
    began_ns = pe.run(75)
    equal([t for t in pe.drives if t > began_ns], [], "its branch is driven before the last step")
    pe.lease = Lease(6, _EPOCH, Step.GO_ALL, _DIGEST)
    began_ns = pe.run(45)
    demand(bool([t for t in pe.drives if t > began_ns]), "at the last step its branch stands still")


def _back_under_another(after_ms: float) -> PeUnderTest:
    """Return a PE that has heard no node for so long, and then a new active manager that has the PE available."""
    pe = _attended().flies()
    pe.run_into_next_period(5)
    pe.lease = pe.alive = pe.neighbour = None
    pe.run(after_ms)
    pe.term, pe.lease, pe.alive = 6, Lease(6, 0, Step.PREPARED, 0), frozenset((NODE,))
    return pe


def a_silence_within_t_lease_raises_no_doubt() -> None:
    """The branch is driven on. Data of a movable module are sent again when the doubt about them has ended."""
    pe = _attended().flies()
    kept = pe.neighbour
    pe.run_until(pe.now_ns // PERIOD_NS * PERIOD_NS + 5 * MS)
    pe.lease = pe.alive = pe.neighbour = None
    pe.run(70)
    pe.neighbour = kept
    began_ns = pe.run(90)
    gap_ns = max(gaps([*(t for t in pe.drives if t > began_ns - 30 * MS), pe.now_ns]))
    demand(gap_ns < 30 * MS, f"after a silence of 80 ms its branch stands still for {gap_ns / MS} ms")
    equal(pe.data(DEMAND_ID, began_ns), [], "what could run elsewhere, within T_lease of a silence of 80 ms")
    began_ns = pe.run(60)
    demand(bool(pe.data(DEMAND_ID, began_ns)), "what could run elsewhere is sent no more")


def a_newer_epoch_elsewhere_stops_it() -> None:
    """A newer epoch that a neighbour runs, and the PE does not follow, stops it; an older one, or none, does not."""
    pe = _attended().flies()
    assert pe.neighbour is not None
    pe.lease = None
    for epoch, held in ((0, False), (_EPOCH - 1, False), (_EPOCH, False), (_EPOCH + 1, True)):
        pe.neighbour = replace(pe.neighbour, epoch=epoch)
        pe.run(45)
        equal(PeFlags.OUTPUT_HELD in pe.pinged().flags, held, f"held, while a neighbour runs epoch {epoch}")
    pe.neighbour = replace(pe.neighbour, epoch=_EPOCH)
    pe.run(45)
    demand(PeFlags.OUTPUT_HELD in pe.pinged().flags, "what was newer once is forgotten")
    pe.lease = Lease(5, _EPOCH, Step.GO_ALL, _DIGEST)
    pe.run(45)
    demand(PeFlags.OUTPUT_HELD not in pe.pinged().flags, "the manager names what runs here, and it holds back")


def what_could_run_elsewhere_is_sent_for_two_periods() -> None:
    """After another node's last frame, data of movable modules go on for two periods, those of fixed ones longer."""
    pe = _attended().flies()
    pe.run_until(pe.now_ns // PERIOD_NS * PERIOD_NS + 5 * MS)
    pe.neighbour = pe.lease = pe.alive = None
    last_ns = pe.now_ns // PERIOD_NS * PERIOD_NS
    pe.run_until(last_ns + 300 * MS)
    sent = moments(pe.data(DEMAND_ID, last_ns))
    demand(last_ns + 20 * MS < max(sent) < last_ns + 43 * MS, f"demand is sent until {(max(sent) - last_ns) / MS} ms")
    demand(bool(pe.data(HEIGHT_ID, last_ns + 250 * MS)), "what cannot be elsewhere is sent no more")
    codes = [d.message_code for _, d in pe.data(DEMAND_ID, -1)]
    equal(codes, [(codes[0] + number) % 256 for number in range(len(codes))], "message codes")


def a_pe_that_is_not_heard_sends_nothing_that_could_run_elsewhere() -> None:
    """The manager sends PING every period: data are held from two periods after the first PING, until PING stops."""
    pe = _attended().flies()
    for beats in (1, 6):
        pe.run_into_next_period(2)
        asked_ns = pe.now_ns
        for number in range(beats):
            pe.main.command(Ping(pe.term, NODE, number))
            pe.run(PERIOD_NS / MS)
        last_ns = pe.now_ns - PERIOD_NS
        pe.run(150)
        sent = moments(pe.data(DEMAND_ID, asked_ns - PERIOD_NS))
        held = [t_ns for t_ns in sent if asked_ns + 41 * MS < t_ns < last_ns + 20 * MS]
        equal(held, [], f"data of a movable module, while it is sent {beats} PINGs")
        longest_ms = max(gaps([*sent, pe.now_ns])) / MS
        wanted = longest_ms < 30 if beats == 1 else 60 < longest_ms < 125
        demand(wanted, f"after {beats} PINGs it sends nothing for {longest_ms} ms")


def an_output_is_echoed() -> None:
    """The echo has the value of an actuator, or that an output without one ran; each echo has the next code."""
    pe = _attended().flies()
    began_ns = pe.run(1000)
    told = [d for _, d in pe.echoes(began_ns)]
    equal({d.value for d in told if d.service_code == 1}, {100.0}, "what the servo was told")
    ran = [d for d in told if d.service_code == 0]
    equal({d.value for d in ran}, {LAMP}, "which output ran")
    demand(49 <= len(told) - len(ran) <= 51, f"a servo of 50 Hz is echoed {len(told) - len(ran)} times in a second")
    demand(9 <= len(ran) <= 11, f"an output of 10 Hz is echoed {len(ran)} times in a second")
    codes = [d.message_code for d in told]
    equal(codes, [(codes[0] + number) % 256 for number in range(len(codes))], "message codes of echoes")
    equal({d.node_id for d in told}, {NODE}, "nodes that echo")
    equal(set(pe.world.written[-50:]), {100.0}, "what moves")
    puppets.BEHAVIOUR["servo"] = puppets.writing("far")
    pe.run(30)
    began_ns = pe.run(200)
    equal({d.service_code for _, d in pe.echoes(began_ns)}, {0}, "devices echoed that were told what is no number")
    equal(pe.emergencies(began_ns), [], "EMCYs of a servo that takes it")


def what_could_run_elsewhere_needs_its_name_in_alive() -> None:
    """Frames of a movable module stop when ALIVE does not name the PE, and while a newer epoch is known."""
    pe = _attended().flies()
    pe.alive = frozenset((NEIGHBOUR,))
    pe.run(45)
    began_ns = pe.run(200)
    equal(pe.data(DEMAND_ID, began_ns), [], "data of what may run elsewhere, while ALIVE names others")
    demand(bool(pe.data(HEIGHT_ID, began_ns)), "what cannot be elsewhere is sent no more")
    pe.alive = frozenset((NODE,))
    pe.run(45)
    began_ns = pe.run(100)
    demand(bool(pe.data(DEMAND_ID, began_ns)), "ALIVE names it, and it sends nothing")
    assert pe.neighbour is not None
    pe.lease, pe.neighbour = None, replace(pe.neighbour, epoch=_NEXT)
    pe.run(45)
    began_ns = pe.run(40)
    equal(pe.data(DEMAND_ID, began_ns), [], "data of what may run elsewhere, while a newer epoch is known")


def it_says_that_it_holds_back_what_could_run_elsewhere() -> None:
    """The PE reports OUTPUT_HELD for a movable module that is published; not for others."""
    for part, holds in (
        (Slice((_GAUGE, _FINE), publish={HEIGHT: 1, DEMAND: 1}), True),
        (Slice((_GAUGE, _FINE), publish={HEIGHT: 1}), False),
        (Slice((_GAUGE, _HELPER), publish={HEIGHT: 1, 2: 1}), False),
    ):
        pe = _attended().flies(part)
        demand(PeFlags.OUTPUT_HELD not in pe.pinged().flags, "ALIVE names it, and it holds back")
        pe.alive = frozenset((NEIGHBOUR,))
        pe.run(45)
        equal(PeFlags.OUTPUT_HELD in pe.pinged().flags, holds, f"it holds back, with {part}")


def its_objects_tell_what_each_module_does() -> None:
    """The object dictionary has the states of modules: not wanted, not started yet, held, running."""
    pe = _attended()
    pe.prepare(_EPOCH, replace(EVERYTHING, modules=EVERYTHING.modules[:4], publish={}), _DIGEST)
    pe.run(15)
    for step, states in (
        (Step.BREAK, [4, 2, 4, 4, 0]),
        (Step.GO, [1, 2, 1, 1, 0]),
        (Step.GO_ALL, [1, 1, 1, 1, 0]),
    ):
        pe.activate(_EPOCH, step, _DIGEST)
        pe.run(5)
        equal([pe.object(MODULE_STATES, module + 1) for module in range(5)], states, f"states at {step.name}")
