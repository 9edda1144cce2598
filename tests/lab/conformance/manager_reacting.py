"""How a manager treats faults, phases, radios, orders, and a planner that fails (protocol rules 7 to 9)."""

from dataclasses import replace
from fractions import Fraction
from itertools import pairwise

from heronry_dg.objective import Placement, placement
from heronry_dg.plan import Plan
from heronry_dg.situation import Situation
from heronry_manager import events
from heronry_manager.core.vocabulary import (
    AskStatus,
    ChannelsLost,
    ClearElement,
    EnterPhase,
    FailElement,
    JournalTold,
    PlanReady,
    RequestPlan,
    UnlockPe,
)
from heronry_tools.sim.world.planning import best_plan
from heronry_wire.frame import Frame
from heronry_wire.gateway_report import LinkReport, LinkState
from heronry_wire.identifiers import GATEWAY_IDS, Command, emcy_id, management_id
from heronry_wire.management import (
    FORWARD_ONLY,
    RESTART_HEARD,
    Alive,
    Control,
    ElementKind,
    FaultCode,
    Lease,
    Operation,
    Prepare,
)
from lab.conformance.manager_under_test import PERIOD_NS, ManagerUnderTest, example
from lab.conformance.player import MS, demand, equal

_DEVICE, _MODULE, _PHASE = ElementKind.DEVICE, ElementKind.MODULE, ElementKind.PHASE


def _told(manager: ManagerUnderTest, since_ns: int, *operations: Operation) -> list[tuple[int, int, int, int]]:
    """Return the manager's CONTROLs of some kinds: node, operation, a and b."""
    return [
        (one.node, one.operation, one.a, one.b) for one in manager.acknowledged(since_ns) if one.operation in operations
    ]


def a_fault_is_latched_and_acknowledged() -> None:
    """The manager acknowledges each report, and plans once without the element, until the operator clears it."""
    manager = ManagerUnderTest().flies()
    node, before = manager.pes["tail_a"].node, len(manager.plan_requests())
    for _ in range(3):
        began_ns = manager.now_ns
        manager.emergency("tail_a", _DEVICE, 1, 7)
        manager.run(3)
        acknowledgement = (node, Operation.ACKNOWLEDGE, _DEVICE, 1)
        equal(_told(manager, began_ns, Operation.ACKNOWLEDGE), [acknowledgement], "acknowledgements")
    equal([one.now.down for one in manager.plan_requests(before)], [{"device:elevator_servo_1"}], "plans requested")
    fault = manager.told(events.FaultReported)
    equal([(f.element, f.by, f.detail) for f in fault], [("device:elevator_servo_1", "tail_a", 7)], "latched")
    manager.run(300)
    began_ns = manager.now_ns
    reply = manager.accept(ClearElement("device:elevator_servo_1"))
    demand(reply.done and "plan" in reply.sentence, reply.sentence)
    manager.run(3)
    equal(_told(manager, began_ns, Operation.CLEAR), [(0, Operation.CLEAR, _DEVICE, 1)], "CLEARs")
    equal(manager.plan_requests()[-1].now.down, frozenset(), "down after it was cleared")
    reply = manager.accept(ClearElement("device:elevator_servo_1"))
    demand(not reply.done, "what is well is cleared")


def _planned(manager: ManagerUnderTest) -> Placement:
    """Return the plan that answers the manager's last request: module -> (mode, PE)."""
    asked = manager.plan_requests()[-1]
    return placement(best_plan(manager.spec, asked.now, asked.running).configuration)


def a_module_is_out_on_one_pe_first() -> None:
    """A module that fails on one PE is planned elsewhere; when it fails on a second PE, it is out everywhere."""
    manager = ManagerUnderTest().flies()
    control = list(manager.spec.modules).index("elevator_control")
    flight, tail_a = (manager.pes[name].node for name in ("flight", "tail_a"))
    places = {pe: f"module:elevator_control@{pe}" for pe in ("flight", "tail_a")}

    def down_after(pe: str, code: FaultCode) -> frozenset[str]:
        for _ in range(2):  # a repeated report changes nothing
            manager.emergency(pe, _MODULE, control, 0, code)
            manager.run(3)
        return manager.plan_requests()[-1].now.down

    equal(down_after("flight", FaultCode.MODULE_EXCEPTION), {places["flight"]}, "down after it failed on one PE")
    began_ns = manager.run(100)
    held = {(one.a, one.b) for one in manager.acknowledged(began_ns) if one.operation is Operation.HOLDS}
    equal(held, {(_MODULE | flight << 8, control)}, "what the manager holds")
    both = {places["flight"], "module:elevator_control"}
    equal(down_after("tail_a", FaultCode.MODULE_OVERRUN), both, "down after it failed on a second PE")
    equal(down_after("tail_b", FaultCode.PARTITION_ENDED), both, "down after it failed on a third PE")
    began_ns = manager.now_ns
    demand(manager.accept(ClearElement("module:elevator_control")).done, "it cannot be cleared")
    manager.run(3)
    equal(_told(manager, began_ns, Operation.CLEAR), [(0, Operation.CLEAR, _MODULE, control)], "CLEARs")
    equal(manager.plan_requests()[-1].now.down, frozenset(), "down after it was cleared with its places")
    down_after("flight", FaultCode.MODULE_MISSING)
    down = down_after("tail_a", FaultCode.MODULE_MISSING)
    equal(down, set(places.values()), "down after two PEs reported that its code is missing")
    equal(down_after("flight", FaultCode.MODULE_EXCEPTION), set(places.values()), "down after it failed there as well")
    began_ns = manager.now_ns
    manager.accept(ClearElement(places["tail_a"]))
    manager.run(3)
    equal(_told(manager, began_ns, Operation.CLEAR), [(0, Operation.CLEAR, _MODULE | tail_a << 8, control)], "CLEARs")
    equal(manager.plan_requests()[-1].now.down, {places["flight"]}, "down after one place was cleared")
    down = down_after("tail_b", FaultCode.REPORTED)
    equal(down, {places["flight"], "module:elevator_control"}, "down after a module that watches it reported it")


def a_module_without_a_choice_of_pes_is_out_at_once() -> None:
    """It has no places, so that a failure and a missing image concern the module as a whole."""
    for code in (FaultCode.MODULE_EXCEPTION, FaultCode.MODULE_MISSING):
        manager = ManagerUnderTest().flies()
        driver = list(manager.spec.modules).index("servo_driver_1")
        manager.emergency("tail_a", _MODULE, driver, 0, code)
        manager.run(3)
        equal(manager.plan_requests()[-1].now.down, {"module:servo_driver_1"}, f"down after {code.name}")


def a_module_cleared_where_it_does_not_run_disturbs_no_pe() -> None:
    """Only where the cleared module still runs by the plan, and its PE has stopped it, is a new epoch needed."""
    manager = ManagerUnderTest(example("fail_over")).flies()
    name, (_, pe) = next((m, at) for m, at in _planned(manager).items() if manager.spec.modules[m].device is None)
    module, place = list(manager.spec.modules).index(name), f"module:{name}@{pe}"
    manager.emergency(pe, _MODULE, module, 0, FaultCode.MODULE_EXCEPTION)
    manager.run(500)
    moved_to = _planned(manager)[name][1]
    demand(moved_to != pe, f"{name} still runs on {pe}")
    epoch = manager.lease().epoch
    demand(manager.accept(ClearElement(place)).done, "its place cannot be cleared")
    manager.run(500)
    equal((manager.lease().epoch, _planned(manager)[name][1]), (epoch, moved_to), "epoch and PE after that")


def no_plan_is_made_without_the_managers_own_bus() -> None:
    """A PE reports on the manager's bus that this bus has failed; a plan without the bus would stop everything."""
    manager = ManagerUnderTest().flies()
    lease = manager.lease()
    own = f"bus:{manager.spec.manager.bus}"
    demand(not manager.accept(FailElement(own)).done, "the operator can switch the aircraft off")
    began_ns = manager.now_ns
    manager.emergency("tail_a", ElementKind.BUS, list(manager.spec.buses).index(manager.spec.manager.bus))
    manager.run(300)
    told = _told(manager, began_ns, Operation.ACKNOWLEDGE)
    equal(len(told), 1, "acknowledgements of a bus that is reported failed")
    demand(all(own not in one.now.down for one in manager.plan_requests()), "it plans without its own bus")
    equal(manager.lease(), lease, "what runs, after a report that the bus has failed")


def what_is_no_fault_is_not_latched() -> None:
    """RESET, a restart of a module, an unknown element, and bytes without a meaning are not latched."""
    manager = ManagerUnderTest().flies()
    before = len(manager.plan_requests())
    for code, kind, index, acknowledged in (
        (FaultCode.RESET, _DEVICE, 1, 0),
        (FaultCode.MODULE_RESTARTED, _MODULE, 1, 1),
        (FaultCode.REPORTED, _DEVICE, 99, 0),
        (FaultCode.REPORTED, _DEVICE, len(manager.spec.devices), 0),
        (FaultCode.MODULE_EXCEPTION, ElementKind.CHANNEL, 0, 0),
    ):
        began_ns = manager.now_ns
        manager.emergency("tail_a", kind, index, 1, code)
        manager.run(5)
        answer = (93, Operation.ACKNOWLEDGE, kind | RESTART_HEARD, index)
        found = _told(manager, began_ns, Operation.ACKNOWLEDGE)
        equal(found, [answer] * acknowledged, f"acknowledgements of {code.name} {kind.name} {index}")
    manager.main.say(Frame(emcy_id(93), b"\x03\xff\x81\x01"), Frame(emcy_id(93), b"\x77\x77\x81\x01\0\1\0\0"))
    manager.run(5)
    equal(manager.told(events.FaultReported), [], "latched")
    equal(len(manager.plan_requests()), before, "plans requested")
    equal(len(manager.told(events.ModuleRestarted)), 1, "restarts told")
    for gap_ms, told in ((30, 1), (90, 1), (150, 2)):  # within T_lease: the same EMCY
        manager.run(gap_ms - 5)
        manager.emergency("tail_a", _MODULE, 1, 1, FaultCode.MODULE_RESTARTED)
        manager.run(5)
        equal(len(manager.told(events.ModuleRestarted)), told, f"restarts told, {gap_ms} ms after the one before")


def a_pe_that_was_failed_stays_out() -> None:
    """The PE stays out whatever it sends; once it is cleared, it joins after the shortest hold-down."""
    manager = ManagerUnderTest().flies()
    demand(manager.accept(FailElement("pe:tail_b")).done, "a PE cannot be failed")
    again = manager.accept(FailElement("pe:tail_b"))
    demand(again.done and "already" in again.sentence, "a PE can be failed twice")
    manager.run(1000)
    demand("tail_b" not in manager.has_available(), "a failed PE is available")
    began_ns = manager.now_ns
    reply = manager.accept(ClearElement("pe:tail_b"))
    demand(reply.done and "hold-down" in reply.sentence, f"a PE cannot be cleared: {reply.sentence}")
    manager.run(150)
    demand("tail_b" not in manager.has_available(), "a cleared PE is back immediately")
    manager.run(120)
    demand("tail_b" in manager.has_available(), "a cleared PE is not back")
    equal(_told(manager, began_ns, Operation.CLEAR), [(0, Operation.CLEAR, ElementKind.PE, 2)], "CLEARs")


def orders_that_name_nothing_are_refused() -> None:
    """The manager refuses such orders with a sentence, and makes no plan for them."""
    manager = ManagerUnderTest().flies()
    before = len(manager.plan_requests())
    for order in (
        FailElement("pe:unknown"),
        FailElement("nonsense"),
        ClearElement("device:nothing"),
        ClearElement("pe:flight"),
        EnterPhase("glide"),
        UnlockPe("pe:flight"),
        UnlockPe("device:elevator_servo_1"),
    ):
        reply = manager.accept(order)
        demand(not reply.done and len(reply.sentence) > 10, f"{order} is executed: {reply.sentence}")
    equal(len(manager.plan_requests()), before, "plans requested")
    status = manager.accept(AskStatus()).status
    demand(status is not None and status["manager"]["term"] == 1, "the status does not name the term")
    early = ManagerUnderTest()
    early.run(20)
    demand(not early.accept(FailElement("pe:tail_b")).done, "an order is executed while it still listens")


def what_stopped_by_itself_is_started_by_another_epoch() -> None:
    """A PE stopped a module, and it is cleared before a plan without it was made: the manager opens another epoch."""
    manager = ManagerUnderTest(example("n_version")).flies()
    names = list(manager.spec.modules)
    index = names.index("gyro_attitude")
    host = best_plan(manager.spec, Situation(), None).configuration.modules.get("gyro_attitude")
    epoch = manager.lease().epoch
    pe = host.pe if host is not None else next(iter(manager.pes))
    manager.emergency(pe, _MODULE, index, 0, FaultCode.MODULE_EXCEPTION)
    manager.run(0.8)
    manager.accept(ClearElement("module:gyro_attitude"))
    manager.run(400)
    demand(manager.lease().epoch != epoch, "a module that its PE has stopped is left so")


def pes_and_the_operator_change_the_phase() -> None:
    """A request is acknowledged each time and executed once, in order; a forward-only one leads to no earlier phase."""
    manager = ManagerUnderTest(example("phases")).flies()
    phases = list(manager.spec.phases)
    pe = next(iter(manager.pes))
    other = list(manager.pes)[1] if len(manager.pes) > 1 else pe
    node = manager.pes[pe].node

    def ask(by: str, index: int, detail: int) -> list[str]:
        began_ns = manager.now_ns
        manager.emergency(by, _PHASE, index, detail, FaultCode.PHASE_REQUEST)
        manager.run(5)
        said = _told(manager, began_ns, Operation.ACKNOWLEDGE)
        known = index < len(phases)
        wanted = [(manager.pes[by].node, Operation.ACKNOWLEDGE, _PHASE, detail)] if known else []
        equal(said, wanted, f"acknowledgements of phase {index}, {detail:#x}")
        changes = [one.phase for one in manager.told(events.PhaseChanged, began_ns)]
        manager.run(300)
        return changes

    equal(ask(pe, 1, 1), [phases[1]], "after a request for phase 1")
    equal(ask(pe, 0, 1), [], "after the same number again")
    equal(ask(pe, 1, 2), [], "after a request for the present phase")
    equal(ask(pe, 0, FORWARD_ONLY | 3), [], "after a request that leads back, and may not")
    equal(ask(other, 0, 4), [phases[0]], "after the first request of another PE")
    equal(ask(pe, 1, FORWARD_ONLY | 5), [phases[1]], "after one that leads on")
    equal(ask(pe, 0, 2), [], "after one that was made before that")
    equal(ask(pe, 1, 5), [], "after the same one, requested in another way")
    equal(ask(pe, len(phases), 6), [], "after a request for a phase that there is not")
    equal(manager.plan_requests()[-1].now.phase, phases[1], "phase that is planned for")
    reply = manager.accept(EnterPhase(phases[1]))
    demand(reply.done and "already" in reply.sentence, "the present phase is entered")
    demand(manager.accept(EnterPhase(phases[0])).done, "the operator cannot enter a phase")
    equal(manager.plan_requests()[-1].now.phase, phases[0], "phase that is planned for")
    manager.run(400)
    manager.pes[pe].reboot()
    manager.pes[pe].beat()
    manager.run(5)
    began_ns = manager.now_ns
    manager.emergency(pe, _PHASE, 1, 1, FaultCode.PHASE_REQUEST)
    manager.run(5)
    equal(_told(manager, began_ns, Operation.ACKNOWLEDGE), [], "acknowledgements to an unavailable PE")
    manager.run(400)
    equal(ask(pe, 1, FORWARD_ONLY | 1), [phases[1]], "after a restarted PE begins to count anew")
    equal(node, manager.pes[pe].node, "node")


def a_pe_of_unknown_incarnation_is_not_answered() -> None:
    """A request belongs to an incarnation: between a first page 1 and page 0 it is unknown, and the PE must repeat."""
    manager = ManagerUnderTest(example("phases"))
    pe = manager.pes["flight"]
    pe.speaks = False
    began_ns = manager.run(300)
    pe.answer()
    for answered in (False, True):
        manager.emergency("flight", _PHASE, 1, 1, FaultCode.PHASE_REQUEST)
        manager.run(5)
        said = _told(manager, began_ns, Operation.ACKNOWLEDGE)
        equal(bool(said), answered, "whether a request is answered")
        pe.speaks = True
        manager.run(50)
    equal([one.phase for one in manager.told(events.PhaseChanged)], [list(manager.spec.phases)[1]], "phases entered")


def what_is_cleared_and_fails_again_within_a_beat_is_announced_with_the_next() -> None:
    """A standby manager has heard CLEAR; the other facts to announce wait for their turns."""
    manager = ManagerUnderTest().flies()
    servo = "device:elevator_servo_1"
    for element in (servo, "device:elevator_servo_2", "device:horizon_sensor", "module:servo_driver_2"):
        manager.accept(FailElement(element))
    manager.run(1000)

    def held(since_ns: int) -> list[int]:
        said = ((t_ns, one) for t_ns, one in manager.said(Control, since_ns) if one.operation is Operation.HOLDS)
        return [t_ns for t_ns, one in said if (one.a, one.b) == (_DEVICE, 1)]

    told_ns = manager.now_ns
    manager.until(lambda: bool(held(told_ns)), 3000, "it is not announced in turn")
    manager.run_into_next_period(12)
    began_ns = manager.now_ns
    manager.accept(ClearElement(servo))
    manager.accept(FailElement(servo))
    manager.run(25)
    equal(len(held(began_ns)), 1, "how often it is announced within a beat")


def a_requested_phase_is_announced_before_the_answer() -> None:
    """Each request is announced first, also when the phase is the same, or comes back within one beat."""
    manager = ManagerUnderTest(example("phases")).flies()
    manager.run_into_next_period(15)
    began_ns, pe = manager.now_ns, next(iter(manager.pes))
    requests = ((1, 1), (0, 2), (1, 3), (1, 4))
    for index, number in requests:
        manager.emergency(pe, _PHASE, index, number, FaultCode.PHASE_REQUEST)
    manager.run(4)
    said = [(one.operation, one.b) for _, one in manager.said(Control, began_ns) if one.a == _PHASE]
    pairs = (((Operation.HOLDS, phase), (Operation.ACKNOWLEDGE, number)) for phase, number in requests)
    wanted = [one for pair in pairs for one in pair]
    equal(said, wanted, "what is announced of phases within a beat")


def executed_requests_are_announced_again_with_the_phase() -> None:
    """A standby manager may have missed the answer; a request of an earlier incarnation is not announced."""
    manager = ManagerUnderTest(example("phases")).flies()
    pe = manager.pes["flight"]
    manager.emergency(pe.name, _PHASE, 1, 5, FaultCode.PHASE_REQUEST)
    manager.run(100)
    for is_told in (True, False):
        began_ns = manager.run(500)
        said = [(one.node, one.operation, one.b) for one in manager.acknowledged(began_ns) if one.a == _PHASE]
        held, accepted = (0, Operation.HOLDS, 1), (pe.node, Operation.ACKNOWLEDGE, 5)
        equal(said[:4], [held, accepted] * 2 if is_told else [held] * 4, "what is announced in turn")
        pe.reboot()
        manager.run(500)


def a_critical_function_that_adoption_leaves_unserved_is_planned_immediately() -> None:
    """The adopted plan is older than the operator's CLEAR of an element; the mastership that knew of it has ended."""
    before = ManagerUnderTest().flies()
    servos = [f"device:elevator_servo_{number}" for number in (1, 2)]
    for is_cleared in (False, True):
        for servo in servos:
            before.accept((ClearElement if is_cleared else FailElement)(servo))
        before.run(0 if is_cleared else 300)
    manager = ManagerUnderTest(before.spec, disk=before.disk)
    for name, ran in before.pes.items():
        manager.pes[name].goes_on_as(ran)
    manager.run(500)
    equal(len(manager.told(events.Adopted)), 1, "epochs that are adopted")
    demand(not manager.plan_requests()[0].in_background, "what is critical, and wanted, is planned in the background")
    equal(len(manager.told(events.Reconfigured)), 1, "reconfigurations")


def a_manager_announces_what_it_holds() -> None:
    """A new fact goes out with the next beat, then one fact with every fifth: phase and latched faults, in turn."""
    manager = ManagerUnderTest(example("phases")).flies()
    phases = list(manager.spec.phases)
    began_ns = manager.now_ns
    manager.run(1000)
    held = [(t_ns, one) for t_ns, one in manager.said(Control, began_ns) if one.operation is Operation.HOLDS]
    equal({(one.a, one.b, one.node) for _, one in held}, {(_PHASE, 0, 0)}, "what it holds")
    demand(9 <= len(held) <= 11, f"{len(held)} facts in fifty beats")
    manager.accept(EnterPhase(phases[1]))
    began_ns = manager.run(25)
    held = [(t_ns, one) for t_ns, one in manager.said(Control, began_ns) if one.operation is Operation.HOLDS]
    equal([(one.a, one.b) for _, one in held], [(_PHASE, 1)], "what is announced anew")
    manager.emergency(next(iter(manager.pes)), _DEVICE, 0, 1)
    manager.run(25)
    began_ns = manager.run(1000)
    held = [(t_ns, one) for t_ns, one in manager.said(Control, began_ns) if one.operation is Operation.HOLDS]
    facts = [(one.a, one.b) for _, one in held]
    equal(set(facts), {(_PHASE, 1), (_DEVICE, 0)}, "what it holds")
    demand(all(a != b for a, b in pairwise(facts)), f"facts are not announced in turn: {facts}")


def a_request_that_fails_is_made_again() -> None:
    """The request is made again after a second, or when the situation changes; a second or late answer is dropped."""
    manager = ManagerUnderTest()
    manager.manager.planning = manager.fails
    manager.run_until(1000 * MS)
    equal(len(manager.plan_requests()), 1, "requests within a second")
    manager.run_until(1200 * MS)
    equal(len(manager.plan_requests()), 2, "requests after a second")
    equal(len(manager.told(events.PlanFailed)), 2, "failures reported")
    manager.accept(FailElement("device:elevator_servo_2"))
    manager.run(5)
    equal(len(manager.plan_requests()), 3, "requests after a change")
    equal(manager.plan_requests()[-1].now.down, {"device:elevator_servo_2"}, "down")
    manager.manager.planning = lambda _: None  # the planner does not answer at all
    manager.run(1000)
    equal(len(manager.plan_requests()), 4, "requests after another second")
    old, new = manager.plan_requests()[-2], manager.plan_requests()[-1]
    right = manager.plans(new)
    assert isinstance(right, PlanReady)
    manager.manager.tell(PlanReady(old.request, right.plan))
    manager.run(5)
    equal(manager.said(Prepare), [], "PREPAREs after an answer to an older request")
    manager.manager.tell(right)
    manager.manager.tell(right)
    manager.run(200)
    equal(len({one.epoch for _, one in manager.said(Prepare)}), 1, "epochs after one answer that came twice")
    demand(bool(manager.told(events.Reconfigured)), "the answer is not carried out")


def an_immediate_plan_is_improved_in_the_background() -> None:
    """When the immediate plan runs, one better plan is requested; it is taken only if it is better at levels 1 to 3."""
    manager = ManagerUnderTest(example("n_version"))
    best = manager.plans

    def immediate(request: RequestPlan) -> PlanReady:
        if request.in_background:
            answer = best(request)
        else:
            poor = replace(request.now, down=request.now.down | {"module:gyro_attitude"})
            answer = PlanReady(request.request, _unproven(best_plan(manager.spec, poor, request.running)))
        assert isinstance(answer, PlanReady)
        return answer

    manager.manager.planning = immediate
    manager.run(900)
    equal([one.in_background for one in manager.plan_requests()], [False, True], "requests")
    equal(len(manager.told(events.Reconfigured)), 2, "reconfigurations")
    keeping = ManagerUnderTest()

    def the_same(request: RequestPlan) -> PlanReady:
        answer = ManagerUnderTest.plans(keeping, request)
        assert isinstance(answer, PlanReady)
        return answer if request.in_background else PlanReady(request.request, _unproven(answer.plan))

    keeping.manager.planning = the_same
    keeping.run(900)
    equal(len(keeping.told(events.PlanKept)), 1, "plans that are no better")
    equal([one.in_background for one in keeping.plan_requests()], [False, True], "requests")
    equal(len(keeping.told(events.PlanKept)), 1, "plans that are no better")
    equal(len(keeping.told(events.Reconfigured)), 1, "reconfigurations")
    equal(manager.told(events.Reconfigured)[1].causes, ("a better plan",), "causes of the second one")
    moving = ManagerUnderTest()

    def elsewhere(request: RequestPlan) -> PlanReady:
        """In the background, give a plan as good at levels 1 to 3 that moves the branch."""
        if not request.in_background:
            return the_same(request)
        other = Situation(frozenset(("device:elevator_servo_1",)))
        return PlanReady(request.request, best_plan(moving.spec, other, None))

    moving.manager.planning = elsewhere
    moving.run(900)
    equal(len(moving.told(events.PlanKept)), 1, "plans that are no better, and move a branch")
    equal(len(moving.told(events.Reconfigured)), 1, "reconfigurations for a plan that is no better")
    failing = ManagerUnderTest()
    failing.manager.planning = lambda request: failing.fails(request) if request.in_background else the_same(request)
    failing.run(2900)
    equal(
        [one.in_background for one in failing.plan_requests()],
        [False, True],
        "requests when one fails",
    )


def _unproven(plan: Plan) -> Plan:
    return replace(plan, optimal=False)


_LINK = GATEWAY_IDS[0]


def _flying_with_a_radio() -> ManagerUnderTest:
    manager = ManagerUnderTest(example("radio_link"))
    manager.run(1500)
    demand(bool(manager.told(events.Reconfigured)), "no configuration is deployed")
    return manager


def _report(manager: ManagerUnderTest, sequence: int, usable: int, *, gone: bool = False, node: int = 0) -> None:
    gateway = manager.pes["comms"].node
    state = LinkState.GONE if gone else LinkState.UP
    said = LinkReport(node or gateway, state, sequence % 64, usable, 100, 0, 0)
    manager.main.say(Frame(_LINK, said.encode()))
    manager.run(100)


def a_radio_is_planned_with_in_steps() -> None:
    """The limit falls to a lower step when two reports in a row are a tenth below; it rises after a hold-down."""
    manager = _flying_with_a_radio()
    for number in range(3):
        _report(manager, number, 1000)
    sequence = 3
    for usable, times, limits in (
        (910, 3, []),
        (890, 1, []),
        (1000, 1, []),
        (500, 1, []),
        (500, 1, [400]),
        (355, 1, []),  # after a fall it takes two again
        (430, 3, []),
        (365, 3, []),
        (355, 1, []),
        (355, 1, [250]),
        (1, 2, [0]),
    ):
        began_ns = manager.now_ns
        for _ in range(times):
            _report(manager, sequence, usable)
            sequence += 1
        shares = [one.share for one in manager.told(events.LinkLimited, began_ns)]
        equal(shares, [f"{limit / 10:g}%" for limit in limits], f"limits after {times} reports of {usable}")
    equal(manager.plan_requests()[-1].now.limits, {"bus:radio": Fraction(0)}, "limits that are planned with")


def a_radio_that_gets_better_is_used_after_a_hold_down() -> None:
    """After ten periods of the radio (up to forty after falls) the limit is the least share reported meanwhile."""
    manager = _flying_with_a_radio()
    sequence = 0
    period_ms = manager.spec.buses["radio"].heartbeat_ns // MS
    for hold_periods in (10, 20, 40, 40):
        for _ in range(2):
            _report(manager, sequence, 300)
            sequence += 1
        manager.run(200)
        began_ns = manager.now_ns
        while not manager.told(events.LinkLimited, began_ns):
            _report(manager, sequence, 1000 if sequence % 3 else 900)
            sequence += 1
            demand(manager.now_ns - began_ns < 60_000 * MS, "a radio that is well again is not used")
        took_ms = (manager.told(events.LinkLimited, began_ns)[0].t_ns - began_ns) / MS
        wanted_ms = hold_periods * period_ms
        demand(wanted_ms - 10 < took_ms < wanted_ms + 210, f"used after {took_ms} ms, and not after {wanted_ms}")
        equal(manager.told(events.LinkLimited, began_ns)[0].share, "80%", "the step it rises to")


def a_radio_that_is_gone_takes_the_pes_beyond() -> None:
    """The PEs beyond are lost immediately; once the radio is back, each report sets the step until one is available."""
    manager = _flying_with_a_radio()
    for number in range(3):
        _report(manager, number, 1000)
    ground = manager.pes["ground"]
    ground.speaks = False
    manager.run(40)
    began_ns = manager.now_ns
    _report(manager, 3, 0, gone=True)
    _report(manager, 4, 0, gone=True)
    equal(len(manager.told(events.LinkGone, began_ns)), 1, "how often it is gone")
    lost = manager.told(events.PeLost, began_ns)
    equal([one.pe for one in lost], ["ground"], "PEs that are lost with it")
    demand(lost[0].t_ns - began_ns < 5 * MS, "a PE beyond is not lost immediately")
    began_ns = manager.now_ns
    for sequence, usable, share in ((5, 420, "40%"), (6, 260, "25%"), (7, 1000, "100%")):
        _report(manager, sequence, usable)
        equal(manager.told(events.LinkLimited, began_ns)[-1].share, share, f"limit after {usable}, no PE beyond")
    equal(len(manager.told(events.LinkBack, began_ns)), 1, "how often it is back")
    _report(manager, 8, 0, gone=True)
    equal(len(manager.told(events.LinkGone, began_ns)), 1, "how often it is gone again, before a PE is back")


def reports_that_are_old_or_of_others_do_not_count() -> None:
    """A report up to eight numbers behind is late; a node that is not the radio's gateway does not count."""
    manager = _flying_with_a_radio()
    for number in range(20, 23):
        _report(manager, number, 1000)
    began_ns = manager.now_ns
    for sequence in (22, 21, 20, 15):
        _report(manager, sequence, 100)
    for sequence in (23, 24):
        _report(manager, sequence, 100, node=manager.pes["nav"].node)
    manager.main.say(Frame(_LINK, b"\1\2\3"))
    manager.run(10)
    equal(manager.told(events.LinkLimited, began_ns), [], "limits")
    for sequence in (14, 15):
        _report(manager, sequence, 100)
    equal(len(manager.told(events.LinkLimited, began_ns)), 1, "limits after a gateway that has begun anew")


def what_the_journal_reports_is_passed_on() -> None:
    """The driver's reports about the journal become an event and appear in the status."""
    manager = ManagerUnderTest().flies()
    for problem in ("the disk is full", None):
        manager.manager.tell(JournalTold(problem))
        manager.run(1)
        status = manager.accept(AskStatus()).status
        assert status is not None
        equal(status["manager"]["journal"], problem, "the journal in the status")
    equal(len(manager.told(events.JournalFailed)), 1, "failures reported")
    equal(len(manager.told(events.JournalKept)), 1, "recoveries reported")
    manager.manager.tell(ChannelsLost(frozenset((1,))))
    manager.manager.tell(ChannelsLost(frozenset((1, 2))))
    manager.manager.tell(ChannelsLost(frozenset()))
    manager.run(1)
    equal([one.channel for one in manager.told(events.ChannelLost)], ["can0.1", "can0.2"], "channels lost")
    equal([one.channel for one in manager.told(events.ChannelBack)], ["can0.1", "can0.2"], "channels back")


def an_advising_manager_sends_nothing() -> None:
    """The advising manager never sends on the bus; it reports what it would do, and follows what is done."""
    manager = ManagerUnderTest(advise=True)
    manager.run(1000)
    equal(manager.main.heard, [], "frames of a manager that advises")
    equal(len(manager.told(events.Advice)), 1, "advice")
    active_manager = ManagerUnderTest().flies()
    for name, ran in active_manager.pes.items():
        manager.pes[name].goes_on_as(ran)
    manager.run(100)
    equal([one.epoch for one in manager.told(events.Adopted)], [active_manager.lease().epoch], "epochs that it follows")
    manager.pes["tail_a"].speaks = False
    began_ns = manager.now_ns
    manager.main.command(Lease(5, 1, active_manager.lease().step, 1), manager=127)
    manager.run(300)
    advice = manager.told(events.Advice, began_ns)
    demand(bool(advice) and "servo_driver_2" in advice[-1].started, f"advice when a driver is lost: {advice}")
    equal(manager.main.heard, [], "frames of a manager that advises")
    demand(bool(manager.accept(AskStatus()).status), "it has no status")


def an_advising_manager_waits_for_no_answer() -> None:
    """Without an active manager, a restarted PE is not requested to do anything, and is not given up for that."""
    active_manager = ManagerUnderTest().flies()
    manager = ManagerUnderTest(advise=True)
    for name, ran in active_manager.pes.items():
        manager.pes[name].goes_on_as(ran)
    manager.run(300)
    manager.pes["tail_b"].reboot()
    manager.run(3000)
    equal([one.cause for one in manager.told(events.PeLost)], ["it rebooted (incarnation 2)"], "why a PE is lost")


def commands_keep_their_order() -> None:
    """A beat's frames go out in order, LEASE before ALIVE; and every frame has an identifier of the manager."""
    manager = ManagerUnderTest().flies()
    own = {management_id(126, command) for command in Command} | {1792 + 126}
    equal({one.frame.can_id for one in manager.main.heard} - own, set(), "identifiers that are not its own")
    demand(bool(manager.said(Alive)) and PERIOD_NS > 0, "no ALIVE")
