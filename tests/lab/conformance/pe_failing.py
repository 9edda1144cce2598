"""How a PE reports faults, when it gives a module up (protocol rule 8), and how a module requests a phase."""

from collections.abc import Mapping
from dataclasses import replace

from heronry_agent.core.vocabulary import (
    DriveFailed,
    Driven,
    ImagesMissing,
    NotReady,
    PartitionEnded,
    StartFailed,
    StepFailed,
    StepMeasured,
    Stepped,
)
from heronry_agent.module import Context, Inputs, Value
from heronry_wire.canaerospace import ErrorReport, decode_data
from heronry_wire.canopen_objects import COUNTERS, ERROR_HISTORY, ERROR_REGISTER, MODULE_STATES
from heronry_wire.configuration_slice import ModuleSlice, Slice
from heronry_wire.frame import Malformed
from heronry_wire.identifiers import emergency_event_id
from heronry_wire.management import (
    FORWARD_ONLY,
    RESTART_HEARD,
    Control,
    ElementKind,
    Emergency,
    FaultCode,
    Lease,
    Operation,
    Step,
)
from heronry_wire.pe_table import PeTable
from heronry_wire.state_frames import PeFlags, PeState
from lab.conformance import puppets
from lab.conformance.pe_under_test import (
    CONTROL,
    DEMAND,
    DEMAND_ID,
    EVERYTHING,
    GAUGE,
    GIVEN_BACK_NS,
    HEIGHT,
    HEIGHT_ID,
    HELP_ID,
    HELPER,
    LAMP,
    NODE,
    PERIOD_NS,
    SERVO,
    SERVO_DEVICE,
    TABLE,
    PeUnderTest,
    gaps,
    immediate,
    moments,
)
from lab.conformance.player import MS, demand, equal

_EPOCH, _DIGEST = 17, 0x111111
_GAUGE, _HELPER = ModuleSlice(GAUGE, 0, ()), ModuleSlice(HELPER, 0, ())
_RUNNING, _FAILED = 1, 3  # object 2013h
_TOGETHER = replace(
    TABLE,
    modules=tuple(replace(one, partition="both", restarts=max(one.restarts, 1)) for one in TABLE.modules),
)


def _flying(part: Slice | None = None, table: PeTable = TABLE) -> PeUnderTest:
    pe = PeUnderTest(table).attended()
    puppets.behave_normally()
    pe.flies(Slice((_GAUGE, _HELPER), publish={HEIGHT: 1, 2: 1}) if part is None else part)
    pe.run(1100)  # for a second after its outputs were held, a report is not accepted
    return pe


def a_report_is_repeated_until_it_is_acknowledged() -> None:
    """EMCY goes out every heartbeat period until it is acknowledged; after a second the PE reports what still lasts."""
    pe = _flying()
    puppets.BEHAVIOUR["helper"] = puppets.reporting("device:gauge_sensor", detail=513)
    began_ns = pe.run(505)
    told = pe.emergencies(began_ns)
    equal({said for _, said in told}, {Emergency(FaultCode.REPORTED, 0x81, ElementKind.DEVICE, 0, 513)}, "EMCYs")
    apart = gaps(moments(told))
    demand(all(abs(gap - PERIOD_NS) < 2 * MS for gap in apart), f"EMCYs are {apart} ns apart")
    demand(len(told) >= 24, f"{len(told)} EMCYs in half a second")
    demand(PeFlags.FAULT_PENDING in pe.pinged().flags, "a fault is pending, and the flag FAULT_PENDING is missing")
    for other in ((ElementKind.DEVICE, 1), (ElementKind.MODULE, 0)):
        pe.main.command(
            Control(5, NODE, Operation.ACKNOWLEDGE, *other), Control(5, NODE + 1, Operation.ACKNOWLEDGE, 1, 0)
        )
    began_ns = pe.run(45)
    demand(bool(pe.emergencies(began_ns)), "an acknowledgement of another element ends it")
    pe.main.command(Control(5, NODE, Operation.ACKNOWLEDGE, ElementKind.DEVICE, 0))
    pe.run(2)
    quiet_ns = pe.now_ns
    demand(PeFlags.FAULT_PENDING not in pe.pinged().flags, "it is acknowledged, and still pending")
    pe.run_until(quiet_ns + 990 * MS)
    equal(pe.emergencies(quiet_ns), [], "EMCYs within a second of the acknowledgement")
    pe.run(50)
    demand(bool(pe.emergencies(quiet_ns)), "a fault that is still found is not reported again after a second")
    equal(pe.object(ERROR_REGISTER), 0x81, "error register")
    equal(pe.object(ERROR_HISTORY), 2, "number of errors")
    equal(pe.object(ERROR_HISTORY, 1), ElementKind.DEVICE << 28 | FaultCode.REPORTED, "the last error")


def what_is_cleared_is_ended_and_reported_anew() -> None:
    """The PE answers CLEAR with RESET once; it reports a fault that still lasts immediately."""
    pe = _flying()
    puppets.BEHAVIOUR["helper"] = puppets.reporting("device:servo_motor", detail=1)
    pe.run(50)
    pe.main.command(Control(5, 0, Operation.ACKNOWLEDGE, ElementKind.DEVICE, SERVO_DEVICE))
    puppets.BEHAVIOUR["helper"] = puppets.giving()
    pe.run(50)
    pe.main.command(Control(5, 0, Operation.CLEAR, ElementKind.DEVICE, 0))
    began_ns = pe.run(5)
    equal(pe.emergencies(began_ns), [], "EMCYs after another element was cleared")
    pe.main.command(Control(5, 0, Operation.CLEAR, ElementKind.DEVICE, SERVO_DEVICE))
    began_ns = pe.run(50)
    reset = Emergency(FaultCode.RESET, 0, ElementKind.DEVICE, SERVO_DEVICE, 0)
    equal([said for _, said in pe.emergencies(began_ns)], [reset], "EMCYs after CLEAR")
    equal(pe.object(ERROR_REGISTER), 0, "error register")
    pe.main.command(Control(5, 0, Operation.CLEAR, ElementKind.DEVICE, SERVO_DEVICE))
    began_ns = pe.run(5)
    equal(pe.emergencies(began_ns), [], "EMCYs after CLEAR again")
    puppets.BEHAVIOUR["helper"] = puppets.reporting("device:servo_motor", detail=2)
    began_ns = pe.run(45)
    found = [said.detail for _, said in pe.emergencies(began_ns)]
    demand(bool(found) and set(found) == {2}, "a fault that is found after CLEAR is not reported immediately")
    puppets.BEHAVIOUR["helper"] = puppets.giving()
    pe.run(25)
    pe.main.command(Control(5, 0, Operation.CLEAR, ElementKind.DEVICE, SERVO_DEVICE))
    began_ns = pe.run(50)
    equal(
        [said for _, said in pe.emergencies(began_ns)],
        [reset],
        "EMCYs after CLEAR without an acknowledgement",
    )


def missing_code_is_reported() -> None:
    """The PE reports each module whose code is missing, again after CLEAR and to each new manager; it runs the rest."""
    pe = _flying(Slice((_HELPER,), publish={2: 1}))
    image = TABLE.modules[GAUGE].image
    pe.tell(ImagesMissing({image: "no such code"}))
    pe.tell(ImagesMissing({image: "no such code"}))
    alike = [one.index for one in TABLE.modules if one.image == image]
    every = {Emergency(FaultCode.MODULE_MISSING, 0x81, ElementKind.MODULE, index, 0) for index in alike}
    missing = Emergency(FaultCode.MODULE_MISSING, 0x81, ElementKind.MODULE, GAUGE, 0)
    began_ns = pe.run(45)
    equal({said for _, said in pe.emergencies(began_ns)}, every, "EMCYs")
    heard = [Control(5, NODE, Operation.ACKNOWLEDGE, ElementKind.MODULE, index) for index in alike]
    pe.main.command(*heard)
    began_ns = pe.run(1500)
    equal(pe.emergencies(began_ns), [], "EMCYs after it was acknowledged")
    pe.main.command(Control(5, 0, Operation.CLEAR, ElementKind.MODULE | NODE + 1 << 8, GAUGE))
    began_ns = pe.run(45)
    equal(pe.emergencies(began_ns), [], "EMCYs after the module was cleared on another PE")
    reset = Emergency(FaultCode.RESET, 0, ElementKind.MODULE, GAUGE, 0)
    for place in (NODE, 0):
        pe.main.command(Control(5, 0, Operation.CLEAR, ElementKind.MODULE | place << 8, GAUGE))
        began_ns = pe.run(5)
        equal([said for _, said in pe.emergencies(began_ns)], [reset, missing], "EMCYs after CLEAR")
        pe.main.command(Control(5, NODE, Operation.ACKNOWLEDGE, ElementKind.MODULE, GAUGE))
    pe.run(50)
    pe.term = 6
    pe.lease = Lease(pe.term, _EPOCH, Step.GO_ALL, _DIGEST)
    began_ns = pe.run(45)
    equal({said for _, said in pe.emergencies(began_ns)}, every, "EMCYs to a new manager")


def a_new_term_is_told_what_was_heard_since_the_last_silence() -> None:
    """The PE may have missed the CLEAR of an older fault; an acknowledged restart does not make a fault younger."""
    for heard_after in (True, False):
        pe = _flying(Slice((_HELPER,), publish={2: 1}))
        puppets.BEHAVIOUR["helper"] = puppets.reporting("device:servo_motor", detail=1)
        pe.run(50)
        puppets.BEHAVIOUR["helper"] = puppets.giving()
        heard = Control(pe.term, NODE, Operation.ACKNOWLEDGE, ElementKind.DEVICE, SERVO_DEVICE)
        if not heard_after:
            pe.main.command(heard)
        others = pe.lease, pe.alive, pe.neighbour
        pe.lease = pe.alive = pe.neighbour = None
        pe.run(300)
        pe.lease, pe.alive, pe.neighbour = others
        pe.run(50)
        pe.main.command(heard)
        pe.run(50)
        pe.term += 2
        pe.lease = Lease(pe.term, _EPOCH, Step.GO_ALL, _DIGEST)
        began_ns = pe.run(50)
        found = {said.kind for _, said in pe.emergencies(began_ns)}
        equal(found, {ElementKind.DEVICE} if heard_after else set(), "what a new term is told of")


def a_critical_fault_is_sent_to_all_nodes() -> None:
    """Each EMCY about an element that serves a function of class A is followed by a CANaerospace emergency event."""
    pe = _flying()
    puppets.BEHAVIOUR["helper"] = puppets.reporting("device:servo_motor", detail=1)
    began_ns = pe.run(200)
    events = pe.main.since(began_ns, [emergency_event_id(NODE)])
    equal(len(events), len(pe.emergencies(began_ns)), "emergency events")
    said = [decode_data(frame) for _, frame in events]
    reports = {one.value for one in said if not isinstance(one, Malformed)}
    equal(reports, {ErrorReport(FaultCode.REPORTED - 0x10000, ElementKind.DEVICE, SERVO_DEVICE)}, "emergency events")
    codes = [one.message_code for one in said if not isinstance(one, Malformed)]
    equal(codes, list(range(len(codes))), "their message codes")
    pe = _flying()
    puppets.BEHAVIOUR["helper"] = puppets.reporting("device:gauge_sensor", detail=1)
    began_ns = pe.run(100)
    equal(pe.main.since(began_ns, [emergency_event_id(NODE)]), [], "emergency events of what is not critical")


def nothing_is_reported_while_outputs_are_held() -> None:
    """Nor is anything reported for a second after that: a surface that no PE drives does not follow its command."""
    pe = PeUnderTest().attended()
    puppets.behave_normally()
    pe.flies(Slice((_GAUGE, _HELPER, ModuleSlice(SERVO, 0, (None,)))))
    pe.run(1200)
    pe.alive = frozenset()
    pe.run(100)
    puppets.BUILT.clear()
    puppets.BEHAVIOUR["helper"] = puppets.reporting("device:servo_motor", detail=1)
    began_ns = pe.run(200)
    equal(pe.emergencies(began_ns), [], "EMCYs while outputs are held")
    demand("helper" in puppets.BUILT, "a module that reported while outputs were held is not built anew")
    pe.alive = frozenset((NODE,))
    pe.run(25)
    free_ns = pe.now_ns
    pe.run(940)
    equal(pe.emergencies(free_ns), [], "EMCYs within a second after outputs were held")
    pe.run(150)
    demand(bool(pe.emergencies(free_ns)), "a report is not accepted a second after outputs were held")
    _reports_while_identifiers_are_doubted()
    puppets.BEHAVIOUR["helper"] = puppets.reporting("device:none", detail=1)
    began_ns = pe.now_ns
    pe.main.command(Control(5, 0, Operation.ACKNOWLEDGE, ElementKind.DEVICE, SERVO_DEVICE))
    pe.run(110)
    told = [(said.code, said.kind) for _, said in pe.emergencies(began_ns) if said.code is not FaultCode.REPORTED]
    equal(told, [(FaultCode.UNKNOWN_ELEMENT, ElementKind.MODULE)], "EMCYs of an unknown element")


def _reports_while_identifiers_are_doubted() -> None:
    """After a silence of three periods the branch may be driven, but data of a movable module may not be sent."""
    pe = _flying(EVERYTHING)
    lease, neighbour = pe.lease, pe.neighbour
    pe.lease = pe.alive = pe.neighbour = None
    pe.run(65)
    pe.neighbour = neighbour
    pe.run(45)
    before = len(pe.drives)
    puppets.BEHAVIOUR["helper"] = puppets.reporting("device:servo_motor", detail=1)
    pe.run(45)
    demand(len(pe.drives) >= before + 2, "a branch is not driven after a silence within T_lease")
    began_ns = pe.now_ns
    pe.lease, pe.alive = lease, frozenset((NODE,))
    pe.run(900)
    equal(pe.emergencies(-1), [], "EMCYs within a second after frames were held")
    pe.run(200)
    demand(bool(pe.emergencies(began_ns)), "a report is not accepted a second after frames were held")


def a_module_that_fails_is_built_anew_and_then_given_up() -> None:
    """It is built anew immediately, then after 100 ms; at the third failure its restarts are used up: given up."""
    pe = _flying()
    puppets.BUILT.clear()
    puppets.BEHAVIOUR["helper"] = puppets.raising
    began_ns = pe.run(400)
    told = pe.emergencies(began_ns)
    firsts = {said: t_ns for t_ns, said in reversed(told)}
    again = [Emergency(FaultCode.MODULE_RESTARTED, 0x81, ElementKind.MODULE, HELPER, times) for times in (1, 2)]
    given_up = Emergency(FaultCode.MODULE_EXCEPTION, 0x81, ElementKind.MODULE, HELPER, 0)
    demand(again[0] in firsts, f"a restart is not told: {list(firsts)}")
    demand(given_up in firsts, f"a module that was given up is not told: {list(firsts)}")
    equal(puppets.BUILT, ["helper", "helper"], "modules built")
    took_ns = firsts[given_up] - firsts[again[0]]
    demand(95 * MS < took_ns < 130 * MS, f"it is given up {took_ns / MS} ms after it has failed first")
    equal(pe.object(MODULE_STATES, HELPER + 1), _FAILED, "state of what was given up")
    equal(pe.object(MODULE_STATES, GAUGE + 1), _RUNNING, "state of what runs")
    equal(pe.data(HELP_ID, began_ns + 200 * MS), [], "data of what was given up")
    equal(pe.page_0().state, PeState.ACTIVE, "state of the PE")


def a_module_that_was_given_up_runs_again_with_the_next_epoch() -> None:
    """It does not run again in the same epoch, for any number of LEASEs; in the next one it has all its restarts."""
    pe = _flying()
    puppets.BEHAVIOUR["helper"] = puppets.raising
    pe.run(400)
    puppets.behave_normally()
    pe.main.command(Control(5, 0, Operation.CLEAR, ElementKind.MODULE, HELPER))
    pe.main.command(Lease(5, _EPOCH, Step.GO_ALL, _DIGEST))
    began_ns = pe.run(100)
    equal(pe.data(HELP_ID, began_ns), [], "data of what was given up")
    pe.flies(Slice((_GAUGE, _HELPER), publish={HEIGHT: 1, 2: 1}), _EPOCH + 1, _DIGEST + 1)
    began_ns = pe.run(100)
    demand(bool(pe.data(HELP_ID, began_ns)), "a module that was given up does not run with the next epoch")
    puppets.BEHAVIOUR["helper"] = puppets.raising
    pe.run(30)
    puppets.behave_normally()
    began_ns = pe.run(150)
    demand(bool(pe.data(HELP_ID, began_ns)), "it has no restarts any more")


def a_failure_is_forgiven_after_a_minute() -> None:
    """A failure more than a minute after the last one counts as the first again; an earlier one does not."""
    pe = _flying()
    for wait_s, times in ((0, 1), (59, 2), (61, 1)):
        pe.run(1000 * wait_s)
        puppets.BEHAVIOUR["helper"] = puppets.once(puppets.raising)
        began_ns = pe.run(300)
        told = {said.detail for _, said in pe.emergencies(began_ns)}
        equal(told, {times}, f"restarts that are counted {wait_s} s later")
        pe.main.command(Control(5, 0, Operation.ACKNOWLEDGE, ElementKind.MODULE | RESTART_HEARD, HELPER))
        pe.run(5)


def that_a_restart_was_heard_silences_no_failure() -> None:
    """Each of restart and failure is reported until it is acknowledged itself."""
    restart, failure = FaultCode.MODULE_RESTARTED, FaultCode.MODULE_EXCEPTION
    for order in ((RESTART_HEARD, 0), (0, RESTART_HEARD)):
        pe, left = _flying(), {restart, failure}
        puppets.BEHAVIOUR["helper"] = puppets.raising
        pe.run(400)
        puppets.behave_normally()
        for more in order:
            pe.main.command(Control(5, 0, Operation.ACKNOWLEDGE, ElementKind.MODULE | more, HELPER))
            pe.run(5)
            left -= {restart if more else failure}
            began_ns = pe.run(100)
            equal({said.code for _, said in pe.emergencies(began_ns)}, left, f"what is told after {order}")


def a_module_without_restarts_is_given_up_at_once() -> None:
    """The module raises, gives a value that its type cannot carry, or cannot drive its device: it is given up."""
    unfit = (
        ("gauge", GAUGE, puppets.giving(height="high")),
        ("gauge", GAUGE, puppets.raising),
        ("servo", SERVO, puppets.writing("far")),
    )
    for name, index, behaviour in unfit:
        pe = _flying(Slice((_GAUGE, ModuleSlice(SERVO, 0, (None,)), _HELPER), publish={HEIGHT: 1}))
        pe.world.takes = False
        puppets.BEHAVIOUR[name] = behaviour
        began_ns = pe.run(100)
        wanted = Emergency(FaultCode.MODULE_EXCEPTION, 0x81, ElementKind.MODULE, index, 0)
        equal({said for _, said in pe.emergencies(began_ns)}, {wanted}, f"EMCYs when {name} fails")
        equal(pe.object(MODULE_STATES, index + 1), _FAILED, f"state of {name}")


def what_its_mode_does_not_give_is_not_published() -> None:
    """Such an output is counted, and the others are published."""
    pe = _flying()
    counted = pe.object(COUNTERS, 1)
    puppets.BEHAVIOUR["helper"] = puppets.giving(height=1.0, help=3)
    began_ns = pe.run(200)
    equal({d.value for _, d in pe.data(HELP_ID, began_ns)[2:]}, {3}, "what it gives")
    demand(pe.object(COUNTERS, 1) >= counted + 8, "what its mode does not give is not counted")
    equal(pe.emergencies(began_ns), [], "EMCYs")


def a_module_that_takes_too_long_is_given_up() -> None:
    """It is given up after ten steps in a row that have each taken more than a period, and not after nine."""
    pe = _flying()
    pe.broken["helper"] = "overrun"
    began_ns = pe.run(270)
    equal(pe.emergencies(began_ns), [], "EMCYs after nine late steps")
    pe.broken.clear()
    pe.run(100)
    pe.broken["helper"] = "overrun"
    began_ns = pe.run(600)
    told = pe.emergencies(began_ns)
    equal({said.code for _, said in told}, {FaultCode.MODULE_OVERRUN}, "codes of EMCYs")
    took_ns = told[0][0] - began_ns  # a missed release is made up immediately: ten steps take 300 ms
    demand(295 * MS < took_ns < 325 * MS, f"it is given up after {took_ns / MS} ms")
    pe.broken.clear()


def a_module_that_hangs_is_ended() -> None:
    """A step ends after 100 ms, or three of its periods: built anew, then given up; other partitions go on."""
    pe = _flying()
    pe.pe.steps.stuck = True
    began_ns = pe.run(95)
    equal(pe.emergencies(began_ns), [], "EMCYs before 100 ms are spent")
    pe.run(60)
    codes = {(said.code, said.index) for _, said in pe.emergencies(began_ns)}
    demand((FaultCode.MODULE_RESTARTED, HELPER) in codes, f"a module that hangs is not built anew: {codes}")
    demand((FaultCode.MODULE_OVERRUN, GAUGE) in codes, f"a module that hangs is not given up: {codes}")
    pe.pe.steps.stuck = False


def a_new_term_is_told_what_has_stopped() -> None:
    """The PE reports its stopped modules to the new term, and sends its last phase request again, forward only."""
    pe = _flying()
    puppets.BEHAVIOUR["helper"] = puppets.asking("land")
    pe.run(50)
    puppets.BEHAVIOUR["gauge"] = puppets.raising
    pe.run(50)
    requests = [said for _, said in pe.emergencies(-1) if said.code is FaultCode.PHASE_REQUEST]
    equal({(one.index, one.detail, one.error_register) for one in requests}, {(2, 1, 0)}, "requests")
    pe.main.command(Control(5, 0, Operation.ACKNOWLEDGE, ElementKind.PHASE, 1))
    pe.main.command(Control(5, 0, Operation.ACKNOWLEDGE, ElementKind.MODULE, GAUGE))
    pe.run(2)
    began_ns = pe.run(50)
    equal(pe.emergencies(began_ns), [], "EMCYs after all was acknowledged")
    pe.term = 7
    pe.lease = Lease(7, _EPOCH, Step.GO_ALL, _DIGEST)
    began_ns = pe.run(25)
    told = {(said.code, said.index, said.detail) for _, said in pe.emergencies(began_ns)}
    wanted = {(FaultCode.MODULE_EXCEPTION, GAUGE, 0), (FaultCode.PHASE_REQUEST, 2, FORWARD_ONLY | 1)}
    equal(told, wanted, "EMCYs in a new term")


def a_request_is_made_once() -> None:
    """A module may repeat its request; a request for another phase replaces it; it is withdrawn with its module."""
    pe = _flying()
    asked: list[int] = []

    def asks(ctx: Context, _inputs: Inputs) -> Mapping[str, Value]:
        asked.append(pe.now_ns)
        ctx.request_phase("cruise")
        return {}

    puppets.BEHAVIOUR["helper"] = asks
    began_ns = pe.run(100)
    told = pe.emergencies(began_ns)
    equal({(s.index, s.detail) for _, s in told}, {(1, 1)}, "requests")
    demand(immediate(told[0][0], asked[0]), "a request is not made immediately")
    pe.main.command(Control(5, NODE, Operation.ACKNOWLEDGE, ElementKind.PHASE, 2))
    began_ns = pe.run(50)
    demand(bool(pe.emergencies(began_ns)), "an answer to another request ends it")
    puppets.BEHAVIOUR["helper"] = puppets.asking("nowhere", "climb")
    pe.run(25)
    began_ns = pe.run(50)
    equal({(s.index, s.detail) for _, s in pe.emergencies(began_ns)}, {(0, 2)}, "requests after another one")
    pe.flies(Slice((_GAUGE,), publish={HEIGHT: 1}), _EPOCH + 1, _DIGEST + 1)
    began_ns = pe.run(100)
    equal(pe.emergencies(began_ns), [], "requests when the module that made one has stopped")
    pe.term = 7
    pe.lease = Lease(7, _EPOCH + 1, Step.GO_ALL, _DIGEST + 1)
    began_ns = pe.run(100)
    equal(pe.emergencies(began_ns), [], "requests in a new term, of a module that has stopped")


def a_request_without_an_acknowledgement_goes_on() -> None:
    """Unacknowledged, it is repeated to new terms unchanged; acknowledged, with its number, but forward only."""
    pe = _flying()
    puppets.BEHAVIOUR["helper"] = puppets.asking("climb")
    for term, is_heard, wanted in ((7, False, {(0, 1)}), (9, True, set()), (11, False, {(0, FORWARD_ONLY | 1)})):
        pe.run(50)
        pe.term, pe.lease = term, Lease(term, _EPOCH, Step.GO_ALL, _DIGEST)
        pe.run(21)
        if is_heard:
            pe.main.command(Control(term, NODE, Operation.ACKNOWLEDGE, ElementKind.PHASE, 1))
        began_ns = pe.run_into_next_period(2)
        pe.run(50)
        equal(_requests(pe, began_ns), wanted, f"requests in term {term}")


def a_phase_s_rule_holds_for_its_time() -> None:
    """A value beyond the threshold for `hold_ms` requests the phase once, forward only; once back, it can again."""
    heights = {"now": 50.0}
    pe = _flying()
    puppets.BEHAVIOUR["gauge"] = lambda _ctx, _inputs: {"height": heights["now"]}
    for height, ms, asked in (
        (100.0, 400, []),  # just not beyond
        (150.0, 180, []),
        (50.0, 30, []),
        (150.0, 180, []),
        (150.0, 60, [1]),
        (150.0, 500, []),
        (50.0, 180, []),
        (150.0, 400, []),  # it was not back for long enough
        (50.0, 240, []),
        (150.0, 240, [1]),
        (5.0, 90, []),
        (5.0, 60, [2]),
        (10.0, 400, []),
        (50.0, 400, []),
        (10.0, 400, []),  # just not beyond
    ):
        heights["now"] = height
        began_ns = pe.run(ms)
        requests = [said for _, said in pe.emergencies(began_ns)]
        equal(sorted({one.index for one in requests}), asked, f"phases requested at {height} for {ms} ms")
        demand(all(one.detail & FORWARD_ONLY for one in requests), "a rule may lead back")
        for one in requests[:1]:
            pe.main.command(Control(5, 0, Operation.ACKNOWLEDGE, ElementKind.PHASE, one.detail))
        pe.run(1)


def a_rule_does_not_bridge_a_gap() -> None:
    """When the value is missing for three periods, the time of the rule begins anew."""
    pe = _flying()
    puppets.BEHAVIOUR["gauge"] = puppets.giving(height=150.0)
    pe.run(150)
    puppets.BEHAVIOUR["gauge"] = puppets.giving()
    pe.run(85)
    puppets.BEHAVIOUR["gauge"] = puppets.giving(height=150.0)
    began_ns = pe.run(190)
    equal(pe.emergencies(began_ns), [], "a rule fires over a gap")
    pe.run(40)
    demand(bool(pe.emergencies(began_ns)), "a rule does not fire after a gap")


def a_partition_that_ends_is_charged_to_the_computing_module() -> None:
    """Where no module was computing, all modules of the partition are charged; others begin again without a failure."""
    charged: tuple[tuple[int | None, set[tuple[FaultCode, int]]], ...] = (
        (GAUGE, {(FaultCode.MODULE_RESTARTED, GAUGE)}),
        (HELPER, {(FaultCode.MODULE_RESTARTED, HELPER)}),
        (None, {(FaultCode.MODULE_RESTARTED, GAUGE), (FaultCode.MODULE_RESTARTED, HELPER)}),
        (SERVO, set()),  # one that has been stopped: no other module has failed
    )
    for computing, told in charged:
        pe = PeUnderTest(_TOGETHER).attended()
        puppets.behave_normally()
        pe.flies(Slice((_GAUGE, _HELPER), publish={HEIGHT: 1, 2: 1}))
        pe.run(8)
        puppets.BUILT.clear()
        began_ns = pe.now_ns
        pe.tell(PartitionEnded("other", "killed", None))
        pe.tell(PartitionEnded("both", "killed", computing))
        pe.run(10)
        equal({(said.code, said.index) for _, said in pe.emergencies(began_ns)}, told, f"EMCYs, computing {computing}")
        equal(sorted(puppets.BUILT), ["gauge", "helper"], "modules that begin again immediately")
        began_ns = pe.run(60)
        demand(
            bool(pe.data(HEIGHT_ID, began_ns)) and bool(pe.data(HELP_ID, began_ns)),
            "a restarted module gives nothing",
        )
        pe.tell(PartitionEnded("both", "killed", GAUGE))
        pe.tell(PartitionEnded("both", "killed", GAUGE))
        began_ns = pe.run(30)
        codes = {(said.code, said.index) for _, said in pe.emergencies(began_ns)}
        demand((FaultCode.PARTITION_ENDED, GAUGE) in codes, f"a module without restarts left is reported as {codes}")


def a_request_ends_with_its_partition() -> None:
    """The request ends also where another module is charged: a restarted module can make a new request."""
    pe = _flying(table=_TOGETHER)
    puppets.BEHAVIOUR["helper"] = puppets.once(puppets.asking("land"))
    pe.run(50)
    pe.tell(PartitionEnded("both", "killed", GAUGE))
    began_ns = pe.run(50)
    equal(_requests(pe, began_ns), set(), "requests of a module that began again")
    puppets.BEHAVIOUR["helper"] = puppets.asking("land")
    began_ns = pe.run(50)
    equal(_requests(pe, began_ns), {(2, 2)}, "requests of a module that began again, and makes a new one")


def _requests(pe: PeUnderTest, since_ns: int) -> set[tuple[int, int]]:
    """Return phase and number of each request of the PE."""
    told = (said for _, said in pe.emergencies(since_ns) if said.code is FaultCode.PHASE_REQUEST)
    return {(said.index, said.detail) for said in told}


def a_module_that_cannot_be_built_is_given_up() -> None:
    """It is given up immediately, however many restarts it has."""
    pe = _flying()
    began_ns = pe.now_ns
    pe.tell(StartFailed(HELPER, "it cannot"))
    pe.run(50)
    codes = {(said.code, said.index, said.detail) for _, said in pe.emergencies(began_ns)}
    equal(codes, {(FaultCode.MODULE_EXCEPTION, HELPER, 0)}, "EMCYs")
    equal(pe.data(HELP_ID, began_ns + 3 * MS), [], "data of what cannot be built")


def answers_to_old_questions_are_dropped() -> None:
    """Answers to a step that was not ordered, or of a module that has stopped, are counted, and change nothing."""
    pe = _flying()
    counted = pe.counted
    for stale in (
        Stepped(HELPER, 1, {"help": 77}),
        StepFailed(HELPER, 1, "long ago"),
        NotReady(HELPER, 1),
        Stepped(SERVO, 1, {}),
    ):
        pe.tell(stale)
    pe.tell(StepMeasured(HELPER, 1, 10**12))
    pe.tell(Driven(SERVO, 1.0))
    pe.tell(DriveFailed(SERVO, "it does not run"))
    began_ns = pe.run(3)
    equal(pe.emergencies(began_ns), [], "EMCYs after answers to old questions")
    equal(pe.echoes(began_ns), [], "echoes of what does not run")
    equal(pe.counted - counted, 4, "answers that were dropped")


def a_step_that_is_given_back_is_asked_for_anew() -> None:
    """The step is ordered again immediately, and once; later releases keep their times, and none is missed."""
    pe = _flying()
    pe.run_until(moments(pe.data(HELP_ID, -1))[-1] + 10 * MS)
    pe.pe.gives_back.append(HELPER)
    began_ns = pe.run(100)
    apart = gaps(moments(pe.data(HELP_ID, began_ns)))
    demand(abs(apart[0] - PERIOD_NS + GIVEN_BACK_NS) < MS, f"the release after it is {apart[0] / MS} ms later")
    demand(all(abs(gap - PERIOD_NS) < MS for gap in apart[1:]), f"data are {apart} ns apart")
    equal(len(apart), 4, "releases after it")
    equal(pe.object(COUNTERS, 2), 0, "releases that were missed")


def what_is_as_old_as_it_may_be_is_fresh() -> None:
    """A datum is fresh for three periods of its source, and not for a fourth."""
    pe = PeUnderTest().attended()
    puppets.behave_normally()
    pe.flies(Slice((_GAUGE, ModuleSlice(CONTROL, 0, (HEIGHT,))), publish={HEIGHT: 1, DEMAND: 1}))
    puppets.BEHAVIOUR["gauge"] = puppets.giving()
    pe.run(100)
    puppets.BEHAVIOUR["gauge"] = puppets.once(puppets.giving(height=50.0))
    began_ns = pe.run(200)
    equal(len(pe.data(HEIGHT_ID, began_ns)), 1, "heights")
    equal(len(pe.data(DEMAND_ID, began_ns)), 1 + 3, "demands that are made of it")


def a_reader_waits_for_what_it_reads() -> None:
    """A module waits at most a quarter of its period for a producer due just before; then it uses the last datum."""
    pe = PeUnderTest().attended()
    puppets.behave_normally()
    pe.flies(Slice((_GAUGE, ModuleSlice(CONTROL, 0, (HEIGHT,))), publish={HEIGHT: 1, DEMAND: 1}))
    began_ns = pe.run(200)
    heights, demands = moments(pe.data(HEIGHT_ID, began_ns)), moments(pe.data(DEMAND_ID, began_ns))
    demand(len(demands) >= 9, "the reader does not run")
    demand(all(0 < later - earlier < MS for earlier, later in zip(heights, demands, strict=False)), "it is a step late")
    pe.broken["gauge"] = "overrun"
    pe.run(41)
    began_ns = pe.run(100)
    demands = moments(pe.data(DEMAND_ID, began_ns))
    demand(bool(demands), "the reader waits without end")


def a_value_goes_down_a_chain_at_once() -> None:
    """The module at the end of a chain waits for both producers: it reads the result for the value of this instant."""
    pe = PeUnderTest().attended()
    puppets.behave_normally()
    heights: list[float] = []
    seen: list[tuple[float, float]] = []  # what was read, and what should have been

    def climb(_ctx: Context, _inputs: Inputs) -> Mapping[str, Value]:
        heights.append(float(len(heights)))
        return {"height": heights[-1]}

    def look(_ctx: Context, inputs: Inputs) -> Mapping[str, Value]:
        read = inputs.get("demand")
        seen.append((-1.0 if read is None else read.number(), 2 * heights[-1]))
        return {}

    puppets.BEHAVIOUR["gauge"], puppets.BEHAVIOUR["lamp"] = climb, look
    chain = _GAUGE, ModuleSlice(CONTROL, 0, (HEIGHT,)), ModuleSlice(LAMP, 0, (DEMAND,))
    pe.flies(Slice(chain, publish={HEIGHT: 1, DEMAND: 1}))
    pe.run(500)
    demand(len(seen) >= 4, "the last of the chain does not run")
    equal([read for read, _ in seen], [wanted for _, wanted in seen], "what the last of a chain reads")
