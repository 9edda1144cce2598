"""A standby manager, and a manager with a key: which manager it follows, what it believes (protocol rules 7 and 11)."""

from collections.abc import Sequence
from dataclasses import replace

from heronry_manager import events
from heronry_manager.core.memory import Memory
from heronry_manager.core.tables import Compiler
from heronry_manager.core.vocabulary import AskStatus, FailElement, UnlockPe
from heronry_wire.authentication import KEY_BYTES, NO_EMERGENCY, Key
from heronry_wire.command_tags import CommandSigner
from heronry_wire.configuration_slice import slice_digest
from heronry_wire.element_places import spec_mark
from heronry_wire.frame import Frame
from heronry_wire.identifiers import Command, emcy_id, management_id, state_id
from heronry_wire.management import (
    TAG,
    WELCOME_KIND,
    Activate,
    Alive,
    Control,
    ElementKind,
    Emergency,
    FaultCode,
    Lease,
    Operation,
    Ping,
    Prepare,
    SliceBody,
    SliceHead,
    Step,
    is_welcome,
)
from heronry_wire.state_frames import (
    PeFlags,
    PeState,
    StatePage0,
    StatePage1,
    StatePage2,
    StatePage3,
    decode_state,
)
from lab.conformance.manager_under_test import LEASE_NS, PERIOD_NS, ManagerUnderTest, PlayedPe, example, remembering
from lab.conformance.player import MS, demand, equal
from lab.peers import ProvenStates

KEY = Key(bytes(range(KEY_BYTES)))
_ALL = frozenset((92, 93, 94))
_UNUSED = "device:elevator_servo_2"  # while the first one serves
_LATE_HEADS = {Prepare: 0, SliceBody: 1, SliceHead: 2}  # the order in which a configuration is overheard, at worst


class _ActiveManager:
    """The other manager, 126, which is active in term 1 while manager 127, which is under test, stands by."""

    def __init__(self, manager: ManagerUnderTest) -> None:
        self.speaks, self.has_available = True, _ALL
        self.refused_by: frozenset[str] = frozenset()  # PEs that know a higher term
        self.lease = Lease(1, 0, Step.PREPARED, 0)
        self._manager, self._beats = manager, 0
        self._beat()

    def _beat(self) -> None:
        manager = self._manager
        self._beats += 1
        if self.speaks:
            alive = Alive(self.lease.term, self._beats % 256, self.has_available)
            manager.main.command(self.lease, alive, manager=126)
        for name, pe in manager.pes.items():
            pe.hears = name not in self.refused_by if self.speaks else pe.hears
        manager.clock.at(manager.now_ns + PERIOD_NS, self._beat)


def _standing_by() -> tuple[ManagerUnderTest, _ActiveManager]:
    manager = ManagerUnderTest(node=127, standby=True)
    active_manager = _ActiveManager(manager)
    manager.run_until(505 * MS)
    equal(manager.heard(-1, *Command), [], "commands of a manager that stands by")
    equal([one.node for one in manager.told(events.StandingBy)], [126], "the manager that it reports to follow")
    return manager, active_manager


def _its_mastership_ends(manager: ManagerUnderTest, active_manager: _ActiveManager, after_ms: int) -> None:
    """Let the other manager fall silent, and the PEs hear the manager that takes over; then let time pass."""
    active_manager.speaks = False
    for pe in manager.pes.values():
        pe.hears = False
    manager.run(150)
    for pe in manager.pes.values():
        pe.hears = True
    manager.run(after_ms)


def a_standby_takes_over_when_the_pes_hear_no_manager() -> None:
    """The lease has expired, and most available PEs report that they hear none; the standby begins its next term."""
    manager, active_manager = _standing_by()
    active_manager.speaks = False
    leased_ns = manager.now_ns // PERIOD_NS * PERIOD_NS
    manager.run_until(leased_ns + 300 * MS)
    equal(manager.heard(-1, *Command), [], "commands while the PEs hear a manager")
    manager.pes["flight"].hears = False
    manager.run(60)
    equal(manager.heard(-1, *Command), [], "commands while one of three hears no manager")
    manager.pes["tail_a"].hears = False
    began_ns = manager.run(60)
    leases = manager.said(Lease, began_ns)
    demand(bool(leases), "most hear no manager, and it does not take over")
    equal(leases[0][1].term, 2, "its term")
    equal(len(manager.told(events.TakenOver)), 1, "how often it takes over")
    equal(manager.told(events.PlanRequested)[0].causes, ("no manager was active",), "why it requests a plan")


def a_standby_waits_for_the_lease_to_expire() -> None:
    """The standby manager waits T_lease after the last LEASE that it has heard, whatever the PEs report."""
    manager, active_manager = _standing_by()
    active_manager.speaks = False
    last_ns = manager.now_ns // PERIOD_NS * PERIOD_NS
    for pe in manager.pes.values():
        pe.hears = False
    manager.run_until(last_ns + 97 * MS)
    equal(manager.heard(-1, *Command), [], "commands within T_lease")
    manager.run_until(last_ns + 107 * MS)
    demand(bool(manager.said(Lease)), "T_lease is over, and it does not take over")
    equal(manager.has_available(), {"flight", "tail_a", "tail_b"}, "available PEs")


def only_reports_of_available_pes_count() -> None:
    """Only reports of the last T_lease count."""
    manager, active_manager = _standing_by()
    active_manager.has_available = frozenset((92,))
    manager.run(50)
    active_manager.speaks = False
    for name in ("tail_a", "tail_b"):
        manager.pes[name].hears = False
    manager.run(300)
    equal(manager.heard(-1, *Command), [], "commands while unavailable PEs hear no manager")
    manager.pes["flight"].hears = False
    manager.run(1)
    manager.pes["flight"].speaks = False
    manager.run(200)
    equal(manager.heard(-1, *Command), [], "commands when an available PE is silent")
    manager.pes["flight"].speaks = True
    manager.run(60)
    demand(bool(manager.said(Lease)), "an available PE hears no manager, and the standby does not take over")


def half_of_those_available_are_not_most() -> None:
    """Of two PEs one hears no manager, and reports it for long: no take-over."""
    manager, active_manager = _standing_by()
    active_manager.has_available = frozenset((92, 93))
    manager.run(50)
    active_manager.speaks = False
    manager.pes["flight"].hears = False
    manager.run(400)
    equal(manager.heard(-1, *Command), [], "commands while one of two hears a manager")


def _knowing_a_higher_term() -> ManagerUnderTest:
    """Let manager 127 stand by, with term 8 in its journal."""
    return ManagerUnderTest(node=127, standby=True, disk=remembering(example("demux_actuators"), Memory(term=8)))


def a_term_that_is_behind_ends_if_a_pe_refuses_it() -> None:
    """For ten T_lease the active manager may learn of the higher term; then one PE that refuses it is enough."""
    manager = _knowing_a_higher_term()
    manager.run(500)
    active_manager = _ActiveManager(manager)
    began_ns = manager.run(900)
    active_manager.refused_by = frozenset(("tail_b",))
    manager.run_until(began_ns + 10 * LEASE_NS)
    equal(manager.heard(-1, *Command), [], "commands within ten T_lease")
    manager.run(45)
    leases = manager.said(Lease, began_ns)
    own = [lease.term for _, lease in leases if lease.term != 1]
    demand(bool(own), "a PE refuses the term that is behind, and it does not take over")
    equal(own[0], 10, "its term")
    accepted = _knowing_a_higher_term()
    _ActiveManager(accepted)
    accepted.run(1500)
    equal(accepted.heard(-1, *Command), [], "commands while all PEs accept the term that is behind")
    raised = _knowing_a_higher_term()
    active_manager = _ActiveManager(raised)
    raised.run(900)
    active_manager.lease = replace(active_manager.lease, term=9)
    raised.run(100)
    active_manager.refused_by = frozenset(("tail_b",))
    raised.run(1500)
    equal(raised.heard(-1, *Command), [], "commands after the active manager has learnt of the higher term")


def where_nobody_is_active_127_lets_126_go_first() -> None:
    """Manager 127 waits for the start-up window; then it counts the reports of the PEs that are heard."""
    manager = ManagerUnderTest(node=127, standby=True)
    for pe in manager.pes.values():
        pe.hears = False
    manager.run_until(4950 * MS)
    equal(manager.heard(-1, *Command), [], "commands within the start-up window")
    manager.run_until(5150 * MS)
    demand(bool(manager.said(Lease)), "no manager is active, and it does not take over")
    first = ManagerUnderTest(node=126, standby=True)
    first.run_until(130 * MS)
    demand(bool(first.said(Lease)), "126 does not go first")


def a_deposed_manager_is_not_believed() -> None:
    """Its commands do not count while the manager that deposed it sends."""
    manager, active_manager = _standing_by()
    active_manager.lease = replace(active_manager.lease, term=3)
    manager.run(50)
    manager.main.command(Lease(1, 5, Step.GO_ALL, 5), manager=126)
    manager.main.command(Control(1, 0, Operation.HOLDS, ElementKind.DEVICE, 1), manager=126)
    manager.run(30)
    equal(manager.told(events.FaultReported), [], "faults that a deposed term holds")
    manager.main.command(Control(3, 0, Operation.HOLDS, ElementKind.DEVICE, 1), manager=126)
    manager.run(30)
    equal(
        [one.element for one in manager.told(events.FaultReported)],
        ["device:elevator_servo_1"],
        "faults that it holds",
    )
    manager.main.command(Control(3, 0, Operation.CLEAR, ElementKind.DEVICE, 1), manager=126)
    manager.run(30)
    equal([one.element for one in manager.told(events.FaultCleared)], ["device:elevator_servo_1"], "faults cleared")
    for operation in (Operation.HOLDS, Operation.CLEAR):
        manager.main.command(Control(3, 0, operation, ElementKind.MODULE, 0), manager=126)
        manager.run(5)
    equal(len(manager.told(events.FaultCleared)), 2, "faults cleared")
    reply = manager.accept(FailElement("pe:flight"))
    demand(not reply.done and "126" in reply.sentence, "a standby manager executes an order")
    status = manager.accept(AskStatus()).status
    assert status is not None
    equal(status["manager"]["state"], "standby", "its state in the status")


def what_is_held_no_more_is_cleared() -> None:
    """After a missed CLEAR, a fault that is not announced for three turns ends; an announced fault stays."""
    manager, _ = _standing_by()
    manager.main.command(*(Control(1, 0, Operation.HOLDS, ElementKind.DEVICE, index) for index in (1, 2)), manager=126)
    manager.run(20)
    equal(len(manager.told(events.FaultReported)), 2, "faults that it holds")
    began_ns = manager.now_ns
    for _ in range(10):
        manager.run(5 * 20)
        manager.main.command(Control(1, 0, Operation.HOLDS, ElementKind.DEVICE, 2), manager=126)
    cleared = manager.told(events.FaultCleared, began_ns)
    equal([one.element for one in cleared], ["device:elevator_servo_1"], "faults that it holds no more")
    waited = (cleared[0].t_ns - began_ns) / PERIOD_NS
    demand(44 <= waited <= 47, f"a fault that is not announced is given up after {waited} beats")


def a_standby_without_the_spec_that_flies_does_not_command() -> None:
    """Another spec is announced: no fact counts, and there is no take-over. With its own it takes over and says so."""
    for is_own in (False, True):
        manager, active_manager = _standing_by()
        own = spec_mark(manager.spec.digest)
        fact = Control(1, 0, Operation.HOLDS, ElementKind.DEVICE, 1)
        for mark in (own ^ 1, *((own,) if is_own else ())):
            manager.main.command(Control(1, 0, Operation.HOLDS, ElementKind.SPEC, mark), fact, manager=126)
            manager.run(20)
            equal(len(manager.told(events.FaultReported)), int(mark == own), f"faults after the spec {mark:04x}")
        _its_mastership_ends(manager, active_manager, 500)
        equal(bool(manager.said(Lease)), is_own, "whether it takes over")
        if is_own:
            held = [one for _, one in manager.said(Control) if one.operation is Operation.HOLDS]
            equal((held[0].a, held[0].b), (ElementKind.SPEC, own), "what it announces first")


def a_place_is_held_and_cleared_by_its_node() -> None:
    """HOLDS and CLEAR of a module name the PE on which alone it is out; a place that does not exist means nothing."""
    manager, active_manager = _standing_by()
    control, driver = (list(manager.spec.modules).index(name) for name in ("elevator_control", "servo_driver_1"))
    flight, tail_a = (manager.pes[name].node for name in ("flight", "tail_a"))
    nowhere = [(ElementKind.MODULE | 99 << 8, control), (ElementKind.MODULE | tail_a << 8, driver), (99, 0)]
    for a, index in [(ElementKind.MODULE | node << 8, control) for node in (flight, tail_a)] + nowhere:
        manager.main.command(Control(1, 0, Operation.HOLDS, a, index), manager=126)
    manager.run(20)
    places = [f"module:elevator_control@{pe}" for pe in ("flight", "tail_a")]
    equal([one.element for one in manager.told(events.FaultReported)], places, "places that it holds")
    manager.main.command(Control(1, 0, Operation.CLEAR, ElementKind.MODULE | tail_a << 8, control), manager=126)
    manager.run(20)
    equal([one.element for one in manager.told(events.FaultCleared)], places[1:], "places that are cleared")
    _its_mastership_ends(manager, active_manager, 500)
    manager.emergency("flight", ElementKind.MODULE, control, 0, FaultCode.MODULE_EXCEPTION)
    manager.emergency("tail_b", ElementKind.MODULE, control, 0, FaultCode.MODULE_EXCEPTION)
    manager.run(20)
    down = manager.plan_requests()[-1].now.down
    equal(down, {places[0], "module:elevator_control"}, "down after the report that was only announced, and a second")


def a_request_that_another_manager_has_executed_is_not_executed_again() -> None:
    """The standby has heard the answer, and the operator may have gone back since. Only a later request counts."""
    manager = ManagerUnderTest(example("phases"), node=127, standby=True)
    active_manager = _ActiveManager(manager)
    active_manager.has_available = frozenset(pe.node for pe in manager.pes.values())
    manager.run(300)
    node, nobody = manager.pes["flight"].node, 120
    for operation, to, value in (
        (Operation.HOLDS, 0, 1),
        (Operation.ACKNOWLEDGE, node, 1),
        (Operation.ACKNOWLEDGE, nobody, 9),
        (Operation.HOLDS, 0, 0),
    ):
        manager.main.command(Control(1, to, operation, ElementKind.PHASE, value), manager=126)
        manager.run(5)
    _its_mastership_ends(manager, active_manager, 400)
    demand(bool(manager.said(Lease)), "it does not take over")
    for number, entered in ((1, 0), (2, 1)):
        began_ns = manager.now_ns
        manager.emergency("flight", ElementKind.PHASE, 1, number, FaultCode.PHASE_REQUEST)
        manager.run(50)
        answers = [one.b for one in manager.acknowledged(began_ns) if one.operation is Operation.ACKNOWLEDGE]
        demand(number in answers, f"request {number} is not answered: {answers}")
        equal(len(manager.told(events.PhaseChanged, began_ns)), entered, f"phases entered by request {number}")


def an_answer_counts_right_behind_the_phase_alone() -> None:
    """The standby missed which phase was entered, but hears that the request was executed: it executes it, too."""
    manager = ManagerUnderTest(example("phases"), node=127, standby=True)
    active_manager = _ActiveManager(manager)
    active_manager.has_available = frozenset(pe.node for pe in manager.pes.values())
    manager.run(300)
    held = Control(1, 0, Operation.HOLDS, ElementKind.PHASE, 0)
    fault = Control(1, 0, Operation.HOLDS, ElementKind.DEVICE, 0)
    accepted = Control(1, manager.pes["flight"].node, Operation.ACKNOWLEDGE, ElementKind.PHASE, 1)
    manager.main.command(accepted, held, fault, accepted, manager=126)
    manager.run(5)
    manager.pes["flight"].reboot()  # an answer right after that may have waited, and be for the incarnation before
    manager.run(25)
    manager.main.command(held, accepted, manager=126)
    manager.run(5)
    _its_mastership_ends(manager, active_manager, 400)
    began_ns = manager.now_ns
    manager.emergency("flight", ElementKind.PHASE, 1, 1, FaultCode.PHASE_REQUEST)
    manager.run(50)
    equal(len(manager.told(events.PhaseChanged, began_ns)), 1, "phases entered by a request")


def a_standby_that_came_late_to_a_keyed_mastership_knows_which_requests_were_executed() -> None:
    """No PE has proven its incarnation to the standby manager: here an unproven incarnation suffices."""
    manager = ManagerUnderTest(example("phases"), node=127, standby=True, key=KEY)
    manager.main.sign = CommandSigner(KEY, 126, 1).tag
    provers = _provers(manager)
    active_manager = _ActiveManager(manager)
    active_manager.has_available = frozenset(pe.node for pe in manager.pes.values())
    for prover in provers.values():
        prover.asks = False
    manager.run(300)
    node = manager.pes["flight"].node
    for to, operation, value in ((0, Operation.HOLDS, 1), (node, Operation.ACKNOWLEDGE, 1), (0, Operation.HOLDS, 0)):
        manager.main.command(Control(1, to, operation, ElementKind.PHASE, value), manager=126)
        manager.run(5)
    equal(len(manager.told(events.PhaseChanged)), 2, "phases that it has heard of")
    for prover in provers.values():
        prover.asks = True
    _its_mastership_ends(manager, active_manager, 800)
    demand("flight" in manager.has_available(), "it does not take over, or no PE is available")
    began_ns = manager.now_ns
    request = Emergency(FaultCode.PHASE_REQUEST, 0x81, ElementKind.PHASE, 1, 1).encode()
    provers["flight"].emergency = request
    manager.main.say(Frame(emcy_id(node), request))
    manager.run(100)
    answers = [one.b for one in manager.acknowledged(began_ns) if one.operation is Operation.ACKNOWLEDGE]
    demand(1 in answers, "the request is not answered")
    equal(manager.told(events.PhaseChanged, began_ns), [], "phases entered by a request that was executed before")


def with_a_key_only_a_manager_with_the_key_says_what_runs() -> None:
    """Any node can compute a digest, so the manager remembers as running only what a manager with the key has sent."""
    first = ManagerUnderTest(key=KEY)
    _provers(first)
    first.flies()
    said = [one for _, one in first.hears if isinstance(one, Prepare | SliceHead | SliceBody | Activate)]
    for is_signed in (False, True):
        manager = ManagerUnderTest(node=127, standby=True, key=KEY)
        sign = manager.main.sign = CommandSigner(KEY, 126, 1).tag
        _ActiveManager(manager)
        manager.run(300)
        manager.main.sign = sign if is_signed else None
        manager.main.command(*said, manager=126)
        manager.main.sign = sign
        manager.run(50)
        runs = manager.disk.opened().runs
        wanted = first.lease().epoch if is_signed else None
        equal(runs and runs.epoch, wanted, "the epoch that is remembered to run")


def a_pe_that_comes_late_to_what_runs_does_not_hide_what_comes() -> None:
    """PREPARE of the running epoch is sent again for that PE while the next epoch is being prepared."""
    first = ManagerUnderTest().flies()
    began = first.said(Prepare)[0][1]
    since_ns = first.now_ns
    first.accept(FailElement("device:elevator_servo_1"))
    first.run(300)
    manager = ManagerUnderTest(node=127, standby=True)
    active_manager = _ActiveManager(manager)
    manager.run(200)
    for t_ns, one in first.hears:
        if not isinstance(one, Lease | Alive | Ping):
            late = (began,) if t_ns > since_ns and isinstance(one, Activate) else ()
            manager.main.command(*late, one, manager=126)
            manager.run(1)
    _adopts(manager, active_manager, first)


def what_was_overheard_is_adopted() -> None:
    """The standby has overheard the slices and the phase: after a take-over no PREPARE is needed."""
    first = ManagerUnderTest(example("phases")).flies()
    manager = ManagerUnderTest(example("phases"), node=127, standby=True)
    active_manager = _ActiveManager(manager)
    active_manager.has_available = frozenset(pe.node for pe in manager.pes.values())
    manager.run(200)
    said = [one for _, one in first.hears if not isinstance(one, Lease | Alive | Ping)]
    said.sort(key=lambda one: _LATE_HEADS.get(type(one), len(_LATE_HEADS)))
    manager.main.command(*said, manager=126)
    for phase, entered in ((0, 0), (99, 0), (1, 1), (1, 0), (0, 1)):
        before = len(manager.told(events.PhaseChanged))
        manager.main.command(Control(1, 0, Operation.HOLDS, ElementKind.PHASE, phase), manager=126)
        manager.run(5)
        equal(len(manager.told(events.PhaseChanged)) - before, entered, f"phases entered when {phase} is held")
    _adopts(manager, active_manager, first)


def what_was_called_by_its_number_is_adopted() -> None:
    """Where the number means the configuration of that digest, the standby needs to overhear no slice."""
    first = ManagerUnderTest(contingencies=1).flies()
    first.pes["tail_a"].speaks = False
    called_ns = first.run(300)
    said = [one for t_ns, one in first.hears if t_ns > called_ns and isinstance(one, Prepare | Activate)]
    demand(isinstance(said[0], Prepare) and said[0].contingency > 0, "a lost PE is not called by its number")
    manager = ManagerUnderTest(node=127, standby=True, contingencies=1)
    active_manager = _ActiveManager(manager)
    active_manager.has_available = _ALL - {manager.pes["tail_a"].node}
    manager.pes["tail_a"].speaks = False
    manager.run(200)
    manager.main.command(*said, manager=126)
    _adopts(manager, active_manager, first)


def _adopts(manager: ManagerUnderTest, active_manager: _ActiveManager, first: ManagerUnderTest) -> None:
    """Demand that what another manager has deployed goes on when its mastership ends."""
    manager.manager.planning = lambda _: None  # what the manager knows is enough
    active_manager.lease = first.lease()
    for name, ran in first.pes.items():
        manager.pes[name].goes_on_as(ran)
    manager.run(200)
    _its_mastership_ends(manager, active_manager, 150)
    equal([one.epoch for one in manager.told(events.Adopted)], [first.lease().epoch], "adopted")
    own = manager.main.since(-1, [management_id(127, Command.PREPARE)])
    equal(own, [], "PREPAREs after a take-over")
    equal(manager.lease().epoch, first.lease().epoch, "the epoch that LEASE repeats")


def an_inherited_pe_may_drive_anything() -> None:
    """The previous manager had the PE available to the end; this manager does not know what the PE took up then."""
    manager, active_manager = _standing_by()
    driver = manager.pes["tail_a"]
    for pe in manager.pes.values():
        pe.epoch, pe.digest, pe.state = 7, 0x99, PeState.ACTIVE
    active_manager.lease = Lease(1, 7, Step.GO_ALL, 0x99)
    manager.run_into_next_period(15)
    driver.reboot()  # to be held down, and available all the same
    manager.run(25)
    driver.epoch, driver.digest, driver.state = 7, 0x99, PeState.ACTIVE
    manager.run(20)
    manager.manager.planning = lambda _: None
    active_manager.speaks = False
    for pe in manager.pes.values():
        pe.hears = False
    manager.run(80)
    driver.speaks = False
    manager.until(lambda: bool(manager.told(events.TakenOver)), 100, "it does not take over")
    manager.run(1)
    demand("tail_a" in manager.has_available(), "a PE that was available to the previous manager is not inherited")
    manager.manager.planning = manager.plans
    for pe in manager.pes.values():
        pe.hears = True
    manager.until(lambda: bool(manager.told(events.PeLost, manager.now_ns - 5 * MS)), 100, "no PE is lost")
    lost_ns = manager.now_ns
    manager.run(400)
    goes = [t_ns for t_ns, one in manager.said(Activate, lost_ns) if one.step is Step.GO_ALL]
    demand(bool(goes) and goes[0] - lost_ns > LEASE_NS - MS, "nothing waits for the inherited PE")


def what_is_no_configuration_is_not_remembered() -> None:
    """Slices with the announced digest that name nothing of this spec are not remembered."""
    manager, active_manager = _standing_by()
    body = b"\x01\x7f\x00"
    identities = Compiler(manager.spec).identities
    for number in range(2):
        epoch = 40 + number
        heads = [
            SliceHead(node, epoch, len(body), slice_digest(identities[node], body) + number) for node in sorted(_ALL)
        ]
        bodies = [SliceBody(node, epoch, 1, body) for node in sorted(_ALL)]
        manager.main.command(Prepare(1, epoch, 0x77), *heads, *bodies, manager=126)
        manager.run(10)
        manager.main.command(Activate(1, epoch, Step.GO_ALL, 0x77), manager=126)
        manager.run(30)
    _its_mastership_ends(manager, active_manager, 250)
    equal(manager.told(events.Adopted), [], "adopted")
    demand(bool(manager.said(Prepare)), "it does not plan anew")


def the_active_manager_stands_by_before_a_higher_term() -> None:
    """The manager drops its plans, reports that it stands by, and takes over when the other manager is gone."""
    manager = ManagerUnderTest(standby=True).flies()
    manager.main.command(Lease(2, 0, Step.PREPARED, 0), manager=127)
    manager.run(5)
    began_ns = manager.now_ns
    manager.run(80)
    equal(manager.heard(began_ns, *Command), [], "commands after a higher term was heard")
    equal([one.term for one in manager.told(events.SteppedDown)], [2], "steps down before")
    for pe in manager.pes.values():
        pe.hears = False
    began_ns = manager.run(200)
    leases = manager.said(Lease, began_ns)
    demand(bool(leases) and leases[0][1].term == 3, "it does not take over with its next term")


# With a key


class _KeyedPe:
    """Lets a played PE prove its states, from its welcome on."""

    def __init__(self, manager: ManagerUnderTest, pe: PlayedPe) -> None:
        self.states = ProvenStates(pe.node, KEY)
        self.asks, self.proves, self.emergency = True, True, NO_EMERGENCY
        self.stride = 1  # from the number of one page 0 to the next: more is as if some were lost
        self._manager, self._pe, self._nonce = manager, pe, 0x1234 + pe.node  # as drawn
        pe.say = self._say
        manager.clock.at(manager.now_ns + PERIOD_NS, self._ask)

    def _ask(self) -> None:
        if self.states.session is None and self.asks and self._pe.speaks:
            page = StatePage2(self._pe.state, PeFlags(0), KEY.nonce(self._pe.node, self._nonce))
            self._manager.main.say(Frame(state_id(self._pe.node), page.encode()))
        self._manager.clock.at(self._manager.now_ns + PERIOD_NS, self._ask)

    def take(self, control: Control) -> None:
        self.states.take(control, self._manager.node)
        if control.node == self._pe.node and control.operation is Operation.WELCOME:
            page = StatePage3(self._pe.state, PeFlags(0), self._pe.digest, 0, 0)
            self._manager.main.say(Frame(state_id(self._pe.node), page.encode()))
        if control.node == self._pe.node and control.operation is Operation.RENEW:
            self._nonce += 1

    def _say(self, frame: Frame) -> None:
        page = decode_state(frame.data)
        assert isinstance(page, StatePage0 | StatePage1)
        if isinstance(page, StatePage0) and self.emergency:
            page = replace(page, flags=page.flags | PeFlags.FAULT_PENDING)
        self._manager.main.say(self.states.prove(page, self.emergency, stride=self.stride, is_true=self.proves))


def _keyed() -> tuple[ManagerUnderTest, dict[str, _KeyedPe]]:
    manager = ManagerUnderTest(key=KEY)
    return manager, _provers(manager)


def _provers(manager: ManagerUnderTest) -> dict[str, _KeyedPe]:
    """Return the PEs of the manager the key."""
    provers = {name: _KeyedPe(manager, pe) for name, pe in manager.pes.items()}
    plain = manager.main.hears

    def hears(frame: Frame) -> None:
        assert plain is not None
        plain(frame)
        if frame.can_id == management_id(manager.node, Command.CONTROL):
            message = manager.hears[-1][1]
            assert isinstance(message, Control)
            for prover in provers.values():
                prover.take(message)

    manager.main.hears = hears
    return provers


def every_command_is_tagged() -> None:
    """A command has a tag by the key, with its number in this term, from 0 on; WELCOME has the nonce it answers."""
    manager, _ = _keyed()
    manager.run(800)
    demand(bool(manager.told(events.Reconfigured)), "with a key nothing is deployed")
    checker = CommandSigner(KEY, 126, 1)
    frames = [one.frame for one in manager.main.heard if 200 <= one.frame.can_id < 208]
    tags = [frame for frame in frames if frame.can_id == 207]
    commands = [frame for frame in frames if frame.can_id != 207]
    equal(len(tags), len(commands), "tags")
    fields = [TAG.unpack(tag.data) for tag in tags]
    equal([one[1] for one in fields if one is not None][:50], list(range(50)), "numbers")
    true = [checker.tag(frame) for frame in commands if not is_welcome(frame.data) or frame.can_id != 206]
    demand(all(tag is not None for tag in true), "tags")
    welcomes = [frame for frame in commands if frame.can_id == 206 and is_welcome(frame.data)]
    equal(len(welcomes), 3, "welcomes")
    equal([one[0] for one in fields if one is not None].count(WELCOME_KIND), 3, "tags of welcomes")


def a_state_counts_when_it_is_proven() -> None:
    """An unproven state counts as silence; after T_lease without a proven state the PE is told to begin anew."""
    manager, provers = _keyed()
    manager.run(800)
    equal(manager.has_available(), {"flight", "tail_a", "tail_b"}, "available PEs")
    provers["tail_b"].proves = False
    began_ns = manager.run(100)
    equal([one.pe for one in manager.told(events.PeLost, began_ns)], ["tail_b"], "PEs lost when they prove nothing")
    manager.run(100)
    renewed = [one.node for one in manager.acknowledged(began_ns) if one.operation is Operation.RENEW]
    demand(renewed[:1] == [94], f"PEs that are told to begin anew: {renewed}")
    equal(manager.told(events.StatesUnproven, began_ns), [], "unproven after one renewal")
    manager.run(500)
    equal([one.pe for one in manager.told(events.StatesUnproven, began_ns)], ["tail_b"], "unproven after some")
    provers["tail_b"].proves = True
    manager.run(800)
    demand("tail_b" in manager.has_available(), "a PE that proves itself again is not available again")


def a_nonce_is_answered_once_in_a_period() -> None:
    """A nonce is answered once in a period, however often it is sent; 0, or one without its own tag, never is."""
    manager, provers = _keyed()
    provers["tail_b"].asks = False
    manager.run(300)
    for nonce, most in ((0, 0), (77, 0), (KEY.nonce(93, 77), 0), (KEY.nonce(94, 77), 1)):
        began_ns = manager.now_ns
        for _ in range(4):
            page = StatePage2(PeState.UNCONFIGURED, PeFlags(0), nonce)
            manager.main.say(Frame(state_id(94), page.encode()))
            manager.run(2)
        welcomes = [one for one in manager.acknowledged(began_ns) if one.operation is Operation.WELCOME]
        equal(len(welcomes), most, f"answers to the nonce {nonce}")


def an_emergency_counts_when_it_is_proven() -> None:
    """An EMCY is proven by the next page 0 with FAULT_PENDING, and has no effect without it."""
    manager, provers = _keyed()
    manager.run(800)
    said = Emergency(FaultCode.REPORTED, 0x81, ElementKind.DEVICE, 1, 3).encode()
    began_ns = manager.now_ns
    manager.main.say(Frame(emcy_id(93), said))
    manager.run(100)
    equal(manager.told(events.FaultReported, began_ns), [], "faults that no page 0 has proven")
    provers["tail_a"].emergency = said
    manager.main.say(Frame(emcy_id(93), said))
    manager.run(200)
    equal(manager.told(events.PeLost, began_ns), [], "lost while a fault is pending, which every page 0 proves again")
    provers["tail_a"].emergency = NO_EMERGENCY
    equal([one.element for one in manager.told(events.FaultReported)], ["device:elevator_servo_1"], "proven faults")
    demand(
        any(one.operation is Operation.ACKNOWLEDGE for one in manager.acknowledged(began_ns)), "it is not acknowledged"
    )


def a_page_1_counts_when_it_is_proven() -> None:
    """A forged page 1 cannot make the manager fail a PE."""
    manager, _ = _keyed()
    manager.run(800)
    lease = manager.lease()
    page = StatePage1(PeState.ACTIVE, PeFlags.HEARS_LEASE, lease.epoch, lease.digest, 4, 0)  # type: ignore[arg-type]
    began_ns = manager.now_ns
    manager.main.say(Frame(state_id(94), page.encode()))
    manager.run(10)
    equal(manager.told(events.PeLost, began_ns), [], "PEs that are failed for a page 1 that is not proven")
    status = manager.accept(AskStatus()).status
    assert status is not None
    equal(status["pes"]["tail_b"]["authentic"]["refused_states"], 1, "states that it has refused")
    demand(status["pes"]["tail_b"]["authentic"]["is_believed"], "a PE that proves what it says is not believed")


def a_pe_whose_tags_are_guessed_at_needs_two_states_in_a_row() -> None:
    """After eight wrong tags a true state counts only right after another true state."""
    manager, _ = _keyed()
    manager.run(800)
    page = manager.pes["tail_b"].page_0()
    for number in range(12):
        manager.main.say(Frame(state_id(94), replace(page, digest=number + 1, sequence=number).encode()))
        manager.run(1)
    began_ns = manager.now_ns
    equal(len(manager.told(events.StatesDoubted)), 1, "how often an event reports that states are doubted")
    status = manager.accept(AskStatus()).status
    assert status is not None
    demand(status["pes"]["tail_b"]["authentic"]["refused_states"] >= 12, "states that were refused are not counted")
    manager.run(300)
    equal(manager.told(events.PeLost, began_ns), [], "PEs that are lost while tags are guessed")
    demand("tail_b" in manager.has_available(), "a PE whose tags are guessed at is not available")


def guesses_are_counted_and_forgiven() -> None:
    """Seven wrong tags change nothing; after eight, a true state counts only near another one, for 256 periods."""
    for guesses, periods, stride, lost in (
        (7, 0, 3, []),
        (8, 0, 2, []),
        (8, 0, 3, ["tail_b"]),
        (8, 250, 3, ["tail_b"]),
        (8, 258, 3, []),
    ):
        manager, provers = _keyed()
        manager.run(800)
        page = manager.pes["tail_b"].page_0()
        for number in range(guesses):
            manager.main.say(Frame(state_id(94), replace(page, digest=number + 1, sequence=number).encode()))
            manager.run(1)
        manager.run(periods * PERIOD_NS / MS)
        provers["tail_b"].stride = stride
        began_ns = manager.run(150)
        found = [one.pe for one in manager.told(events.PeLost, began_ns)]
        equal(found, lost, f"lost {periods} periods after {guesses}, when states are {stride} apart")


def a_pe_that_was_available_and_dies_unproven_is_not_waited_for() -> None:
    """ALIVE names a PE that was available to the previous manager until the PE has proven itself or falls silent."""
    manager, provers, _ = _takes_over_from_a_keyed_mastership(silent=())
    manager.run(25)
    equal(manager.has_available(), {"flight", "tail_a", "tail_b"}, "named at first")
    for name in ("flight", "tail_a"):
        provers[name].asks = True
    for pe in manager.pes.values():
        pe.hears = True
    spoke: list[int] = []
    manager.main.bus.taps.append(lambda sent: spoke.append(sent.end_ns) if sent.frame.can_id == state_id(94) else None)
    manager.run_into_next_period(8)
    manager.pes["tail_b"].speaks = False
    manager.run(200)
    _is_absent(manager, spoke[-1])
    equal(manager.has_available(), {"flight", "tail_a"}, "named at last")
    demand(bool(manager.plan_requests()), "it waits for an absent PE")
    equal(manager.plan_requests()[0].now.down, {"pe:tail_b"}, "down")
    manager, _, took_over_ns = _takes_over_from_a_keyed_mastership(silent=("tail_b",))
    manager.run(200)
    _is_absent(manager, took_over_ns)


def _is_absent(manager: ManagerUnderTest, since_ns: int) -> None:
    """Demand that tail_b was given up when it had been silent since a moment for as long as allowed."""
    (absent,) = manager.told(events.PeAbsent)
    told = absent.pe, absent.cause
    equal(told, ("tail_b", "not heard any more, before it could be believed"), "PEs that are absent")
    silent_ns = absent.t_ns - since_ns
    demand(65 * MS <= silent_ns < 66 * MS, f"it is given up after {silent_ns} ns")


def _takes_over_from_a_keyed_mastership(
    silent: Sequence[str],
) -> tuple[ManagerUnderTest, dict[str, _KeyedPe], int]:
    """Let 127 take over when no PE has proven a state to it, and some PEs are silent; gives the moment."""
    manager = ManagerUnderTest(node=127, standby=True, key=KEY)
    signer = CommandSigner(KEY, 126, 1)
    manager.main.sign = signer.tag
    provers = _provers(manager)
    active_manager = _ActiveManager(manager)
    manager.run(505)
    active_manager.speaks = False
    for prover in provers.values():
        prover.asks = False
    for name, pe in manager.pes.items():
        pe.hears, pe.speaks = False, name not in silent
    manager.until(lambda: bool(manager.told(events.TakenOver)), 300, "it does not take over")
    return manager, provers, manager.told(events.TakenOver)[0].t_ns


def the_lock_is_opened_by_order() -> None:
    """UNLOCK names one PE, and opens its lock for half a minute."""
    manager, _ = _keyed()
    manager.run(800)
    began_ns = manager.now_ns
    demand(manager.accept(UnlockPe("pe:tail_b")).done, "the lock cannot be opened")
    demand(not manager.accept(UnlockPe("module:servo_driver_1")).done, "a module has a lock")
    manager.run(5)
    said = [(one.node, one.a) for one in manager.acknowledged(began_ns) if one.operation is Operation.UNLOCK]
    equal(said, [(94, 30)], "UNLOCKs")


def what_a_pe_refuses_is_reported() -> None:
    """An event comes once a second while the count rises; the status has the count. A lower count means a restart."""
    manager, _ = _keyed()
    manager.run(800)

    def says(unproven: int, other: int) -> int:
        began_ns = manager.now_ns
        page = StatePage3(PeState.ACTIVE, PeFlags.HEARS_LEASE, manager.lease().digest, unproven, other)
        manager.main.say(Frame(state_id(94), page.encode()))
        manager.run(5)
        return len(manager.told(events.CommandsRefused, began_ns))

    equal([says(5, 0), says(5, 2), says(6, 2)], [1, 0, 0], "events within a second")
    manager.run(1000)
    equal([says(6, 2), says(7, 2), says(0, 0)], [1, 0, 0], "events after a second")
    manager.run(1000)
    equal(says(0, 3), 1, "events after a restart")
    status = manager.accept(AskStatus()).status
    assert status is not None
    equal(status["pes"]["tail_b"]["authentic"]["refused_commands"], 3, "commands that it has refused")


def lost_states_cost_nothing() -> None:
    """While no tags are guessed, the next state counts, however many states were lost before it."""
    manager, provers = _keyed()
    manager.run(800)
    provers["tail_b"].stride = 7
    began_ns = manager.run(2000)
    equal(manager.told(events.PeLost, began_ns), [], "PEs that are lost because states were lost")


def a_replay_of_its_own_frames_is_no_other_manager() -> None:
    """A replay of the manager's LEASE does not end its mastership; a LEASE of a double with a higher number does."""
    manager, _ = _keyed()
    manager.run(800)
    leases = [one.frame for one in manager.main.heard if one.frame.can_id == 200]
    tags = [one.frame for one in manager.main.heard if one.frame.can_id == 207 and one.frame.data[0] >> 5 == 0]

    def says(*frames: Frame) -> None:
        """Send in the quiet part of a period: two nodes that send one identifier together destroy both frames."""
        manager.run_into_next_period(8)
        manager.main.say(*frames)
        manager.run(5)

    for number in (0, 5, -1, -1):
        says(leases[number], tags[number])
        demand(manager.manager.stopped is None, "its own frames, replayed, end its mastership")
    double = CommandSigner(KEY, 126, manager.lease().term)
    double.number = 2_000
    lease = Frame(200, manager.lease().encode())
    tag = double.tag(lease)
    assert tag is not None
    says(lease)
    demand(manager.manager.stopped is None, "a LEASE without a tag ends a mastership")
    says(lease, tag)
    demand(manager.manager.stopped is not None, "a double with a higher number does not end its mastership")


def an_advising_manager_follows_no_more_than_is_known() -> None:
    """When an unknown epoch replaces an advised one, the advised one does not count as running."""
    active_manager = ManagerUnderTest().flies()
    manager = ManagerUnderTest(advise=True)
    for name, ran in active_manager.pes.items():
        manager.pes[name].goes_on_as(ran)
    manager.run(300)
    status = manager.accept(AskStatus()).status
    assert status is not None
    equal(status["epoch"], active_manager.lease().epoch, "the epoch that it sees")
    for pe in manager.pes.values():
        pe.epoch, pe.digest = pe.epoch + 1, 0x99
    manager.run(100)
    status = manager.accept(AskStatus()).status
    assert status is not None
    equal(status["epoch"], None, "the epoch that it sees when another one runs")


def an_advising_manager_that_was_started_late_reports_what_it_does_not_know() -> None:
    """The manager hears what is held before it advises; it does not know what runs, until the next epoch."""
    first = ManagerUnderTest().flies()
    manager = ManagerUnderTest(node=127, advise=True)
    active_manager = _ActiveManager(manager)
    active_manager.lease = Lease(1, 7, Step.GO_ALL, 0x99)
    for pe in manager.pes.values():
        pe.epoch, pe.digest, pe.state = 7, 0x99, PeState.ACTIVE
    held = Control(1, 0, Operation.HOLDS, ElementKind.DEVICE, 2)  # the servo that is not used

    def fly(turns: int) -> None:
        for _ in range(turns):
            manager.main.command(held, manager=126)
            manager.run(5 * 20)

    fly(15)
    equal(
        [(sorted(one.now.down), one.running) for one in manager.plan_requests()], [([_UNUSED], None)], "plans requested"
    )
    equal(manager.told(events.Advice), [], "advice while what runs is not known")
    equal([one.epoch for one in manager.told(events.UnknownEpoch)], [7], "epochs that it reports as unknown")
    status = manager.accept(AskStatus()).status
    assert status is not None
    equal((status["epoch"], status["unknown_epoch"]), (None, 7), "the epoch in the status")
    equal({one["served"] for one in status["functions"].values()}, {None}, "what is served, as far as it knows")
    equal([one["element"] for one in status["latched"]], [_UNUSED], "latched")
    manager.main.command(*(one for _, one in first.hears if not isinstance(one, Lease | Alive | Ping)), manager=126)
    active_manager.lease = first.lease()
    for name, ran in first.pes.items():
        manager.pes[name].goes_on_as(ran)
    fly(5)
    status = manager.accept(AskStatus()).status
    assert status is not None
    equal((status["epoch"], status["unknown_epoch"]), (first.lease().epoch, None), "the epoch in the status, later")
    demand(status["functions"]["elevator"]["served"], "the elevator is served, and it does not know")
    equal(manager.told(events.Advice), [], "advice where nothing is to be done")
    reply = manager.accept(FailElement("device:elevator_servo_1"))
    demand(reply.done and "only advises" in reply.sentence, f"an order is answered with '{reply.sentence}'")
    fly(5)
    equal(len(manager.told(events.FaultReported)), 2, "faults, with the one that the operator supposes")
    equal(manager.told(events.FaultCleared), [], "faults that it gives up")
    demand("servo_driver_1" in manager.told(events.Advice)[-1].stopped, "it does not advise upon what is supposed")
    equal(manager.heard(-1, *Command), [], "commands of a manager that advises")
