"""Which PEs are available to a manager: start, suspicion, loss, return (protocol rules 2, 3 and 7)."""

from itertools import pairwise

from heronry_manager import events
from heronry_manager.core.memory import Memory
from heronry_manager.core.vocabulary import ClearElement
from heronry_wire.frame import Frame
from heronry_wire.identification import IDENTIFICATION
from heronry_wire.identifiers import LAST_MANAGER, Command, heartbeat_id, management_id
from heronry_wire.management import Alive, Lease, Ping, Prepare, Step
from heronry_wire.node_services import (
    BROADCAST,
    Service,
    ServiceMessage,
    decode_service,
    encode_service,
    read_identification,
    request,
    service_id,
)
from heronry_wire.state_frames import PeState
from lab.conformance.manager_under_test import (
    LEASE_NS,
    PERIOD_NS,
    ManagerUnderTest,
    example,
    remembering,
)
from lab.conformance.player import MS, demand, equal
from lab.peers import command_frame

_S = 1000
_ALL = {"flight", "tail_a", "tail_b"}


def _silence(manager: ManagerUnderTest, *pes: str) -> int:
    """Stop the states of some PEs just after a state of the last one; gives that moment."""
    last = manager.pes[pes[-1]]
    place_ns = (last.node - 92) * PERIOD_NS // 34
    manager.run_until(manager.now_ns // PERIOD_NS * PERIOD_NS + PERIOD_NS + place_ns + MS)
    for pe in pes:
        manager.pes[pe].speaks = False
    return manager.now_ns - MS


def _gone_ns(manager: ManagerUnderTest, pe: str, since_ns: int) -> int:
    """Return the time of the first ALIVE that leaves the PE out."""
    node = manager.pes[pe].node
    return next((t_ns for t_ns, alive in manager.said(Alive, since_ns) if node not in alive.nodes), -1)


def _back_ns(manager: ManagerUnderTest, pe: str, since_ns: int) -> int:
    node = manager.pes[pe].node
    return next((t_ns for t_ns, alive in manager.said(Alive, since_ns) if node in alive.nodes), -1)


def a_manager_listens_before_it_sends() -> None:
    """It listens for T_lease; then LEASE and ALIVE go out every period, in this order, in a term of its parity."""
    for node, memory, term in ((126, Memory(), 1), (127, Memory(), 2), (126, Memory(term=4), 5), (126, Memory(5), 7)):
        spec = example("demux_actuators")
        manager = ManagerUnderTest(spec, node=node, disk=remembering(spec, memory))
        manager.run_until(LEASE_NS)
        equal(manager.main.heard, [], "frames within T_lease of its start")
        manager.run_until(LEASE_NS + 500 * MS)
        leases = manager.said(Lease)
        alives = manager.said(Alive)
        demand(25 <= len(leases) <= 26, f"{len(leases)} LEASEs in half a second")
        for number, (t_ns, lease) in enumerate(leases):
            late_ns = t_ns - LEASE_NS - number * PERIOD_NS
            demand(0 < late_ns < MS, f"LEASE number {number} comes {late_ns} ns late")
            equal(lease.term, term, "term")
            demand(0 < alives[number][0] - t_ns < MS, f"ALIVE does not follow LEASE number {number}")
        equal([alive.sequence for _, alive in alives], list(range(len(alives))), "sequences of ALIVE")
        equal(leases[0][1], Lease(term, 0, Step.PREPARED, 0), "the first LEASE")
        demand(manager.lease().epoch > (term - 1) * 16, "its epochs do not begin with the block of its term")


def a_manager_is_a_node_of_canopen_and_canaerospace_too() -> None:
    """It sends a heartbeat every second; it answers an IDS to it immediately, one to all nodes after (n - 92) ms."""
    manager = ManagerUnderTest().flies()
    manager.run(3 * _S)
    beats = manager.main.since(-1, [heartbeat_id(126)])
    equal([frame.data for _, frame in beats], 4 * [b"\x05"], "CANopen heartbeats")
    times = [t_ns for t_ns, _ in beats]
    demand(all(abs(b - a - 1000 * MS) < 2 * MS for a, b in pairwise(times)), f"they come at {times}")
    for question, after_ms in ((request(Service.IDS, 126, message_code=3), 0), (request(Service.IDS, BROADCAST), 34)):
        began_ns = manager.now_ns
        manager.main.say(encode_service(question))
        manager.run(45)
        answers = manager.main.since(began_ns, [service_id(0, is_answer=True)])
        equal(len(answers), 1, "answers to IDS")
        late_ns = answers[0].t_ns - began_ns - after_ms * MS
        demand(0 < late_ns < 2 * MS, f"IDS is answered {late_ns} ns late")
        message = decode_service(answers[0].frame)
        demand(isinstance(message, ServiceMessage), "IDS is answered with no service")
        assert isinstance(message, ServiceMessage)
        equal(read_identification(message), IDENTIFICATION, "its identification")
    began_ns = manager.now_ns
    manager.main.say(encode_service(request(Service.IDS, 125)))
    manager.run(45)
    equal(manager.main.since(began_ns, [service_id(0, is_answer=True)]), [], "answers to IDS of another node")


def the_start_waits_for_pes_that_were_never_heard() -> None:
    """The manager waits until the start-up window of 5 s closes, but not once all PEs are heard."""
    manager = ManagerUnderTest()
    manager.run(130)
    demand(bool(manager.plan_requests()), "all are heard, and nothing is planned")
    equal(manager.plan_requests()[0].now.down, frozenset(), "down")
    manager = ManagerUnderTest()
    manager.pes["tail_b"].speaks = False
    manager.run_until(4990 * MS)
    equal(manager.plan_requests(), [], "plans requested while the window is open")
    equal(manager.has_available(), {"flight", "tail_a"}, "available while the window is open")
    manager.run(25)
    demand(bool(manager.plan_requests()), "the window has closed, and nothing is planned")
    equal(manager.plan_requests()[0].now.down, {"pe:tail_b"}, "down")


def in_flight_the_start_does_not_wait() -> None:
    """Where a PE runs a configuration, the window closes when the others have missed one state more than they may."""
    manager = ManagerUnderTest()
    manager.pes["tail_b"].speaks = False
    flying = manager.pes["flight"]
    flying.epoch, flying.digest, flying.state = 3, 0x42, PeState.ACTIVE
    manager.run_until(75 * MS)
    equal(manager.plan_requests(), [], "plans requested before")
    manager.run_until(150 * MS)
    demand(bool(manager.plan_requests()), "the flight is under way, and nothing is planned")
    equal(manager.plan_requests()[0].now.down, {"pe:tail_b"}, "down")
    demand(manager.plan_requests()[0].running is None, "it says that it knows what runs")
    manager = ManagerUnderTest()
    for pe in ("flight", "tail_b"):
        manager.pes[pe].speaks = False
    flying = manager.pes["flight"]
    flying.epoch, flying.digest, flying.state = 3, 0x42, PeState.ACTIVE
    manager.run_until(155 * MS)
    flying.speaks = True
    flying.beat()
    manager.run_until(233 * MS)
    equal(manager.plan_requests(), [], "plans requested before the others have missed what they may, and one")
    manager.run_until(245 * MS)
    equal(len(manager.plan_requests()), 1, "plans requested after that")


def a_late_pe_gets_a_ping_and_a_silent_pe_is_lost() -> None:
    """PING goes out a period and a quarter after the last state, and with each beat; three and a quarter is a loss."""
    manager = ManagerUnderTest().flies()
    last_ns = _silence(manager, "tail_b")
    manager.run_until(last_ns + 200 * MS)
    pings = [(t_ns, ping) for t_ns, ping in manager.said(Ping, last_ns) if ping.node == manager.pes["tail_b"].node]
    demand(len(pings) >= 3, f"{len(pings)} PINGs")
    demand(24 * MS < pings[0][0] - last_ns < 26.5 * MS, f"the first PING comes {(pings[0][0] - last_ns) / MS} ms later")
    equal({ping.node for _, ping in manager.said(Ping, last_ns)}, {manager.pes["tail_b"].node}, "PEs that get a PING")
    demand(max(t_ns for t_ns, _ in pings) < last_ns + 70 * MS, "a lost PE gets a PING")
    lost = manager.told(events.PeLost, last_ns)
    equal([one.pe for one in lost], ["tail_b"], "PEs that are lost")
    demand(64 * MS < lost[0].t_ns - last_ns < 66.5 * MS, f"lost {(lost[0].t_ns - last_ns) / MS} ms later")
    gone_ns = _gone_ns(manager, "tail_b", last_ns)
    demand(0 < gone_ns - lost[0].t_ns <= PERIOD_NS + MS, "ALIVE names a lost PE")
    equal(manager.plan_requests()[-1].now.down, {"pe:tail_b"}, "planned without")


def a_pe_that_answers_in_time_stays() -> None:
    """A PE whose next state comes 64 ms after the last one is not lost."""
    manager = ManagerUnderTest().flies()
    before = len(manager.plan_requests())
    last_ns = _silence(manager, "tail_b")
    manager.run_until(last_ns + 62 * MS)
    manager.pes["tail_b"].speaks = True
    manager.pes["tail_b"].beat()
    manager.run(500)
    equal(_gone_ns(manager, "tail_b", last_ns), -1, "when ALIVE did not name it")
    equal(len(manager.plan_requests()), before, "plans requested")
    began_ns = manager.now_ns
    manager.run(200)
    equal(manager.said(Ping, began_ns), [], "PINGs when all is well")


def a_pe_that_comes_back_is_held_down() -> None:
    """The PE must be heard for ten periods without a gap; with each loss for twice as long, a minute at most."""
    manager = ManagerUnderTest().flies()
    tail = manager.pes["tail_b"]
    for hold_ms in (200, 400, 800, 1600):
        last_ns = _silence(manager, "tail_b")
        manager.run(150)
        tail.reboot()
        tail.speaks = True
        manager.run(1)
        tail.beat()
        back_ns = manager.now_ns
        manager.run(hold_ms + 60)
        joined_ns = _back_ns(manager, "tail_b", _gone_ns(manager, "tail_b", last_ns))
        took_ms = (joined_ns - back_ns) / MS
        demand(hold_ms - 1 < took_ms < hold_ms + 24, f"held down for {took_ms} ms, and not for {hold_ms}")
        manager.run(300)
    last_ns = _silence(manager, "tail_b")
    manager.run(150)
    tail.speaks = True
    manager.run(3000)
    gap_ns = _silence(manager, "tail_b")
    manager.run(100)
    tail.speaks = True
    manager.run(3150)
    equal(_back_ns(manager, "tail_b", gap_ns), -1, "when it was back after a gap in its hold-down")
    manager.run(300)
    demand(_back_ns(manager, "tail_b", gap_ns) > 0, "it does not come back after a hold-down without a gap")
    demand(last_ns < gap_ns, "time goes on")


def a_cleared_pe_waits_for_the_shortest_time() -> None:
    """A PE in quarantine that the operator clears joins after ten periods, and an event reports it."""
    manager = ManagerUnderTest().flies()
    tail = manager.pes["tail_b"]
    for hold_ms in (200, 400):
        _silence(manager, "tail_b")
        manager.run(100)
        tail.speaks = True
        manager.run(hold_ms + 60)
    equal(len(manager.told(events.PeJoined)), 5, "joins: three, and two more of one PE")
    _silence(manager, "tail_b")
    manager.run(100)
    tail.speaks = True
    manager.run(50)
    demand(manager.accept(ClearElement("pe:tail_b")).done, "a PE in quarantine cannot be cleared")
    manager.run(120)
    demand("tail_b" not in manager.has_available(), "a cleared PE is back immediately")
    manager.run(90)
    demand("tail_b" in manager.has_available(), "a cleared PE waits on")
    demand(not manager.accept(ClearElement("pe:tail_b")).done, "an available PE is cleared")


def losses_are_forgiven_after_a_minute() -> None:
    """When a PE has been available for a minute, its next hold-down is the shortest one again."""
    manager = ManagerUnderTest().flies()
    tail = manager.pes["tail_b"]
    for available_s, hold_ms in ((0, 200), (59, 400), (61, 200)):
        manager.run(1000 * available_s)
        _silence(manager, "tail_b")
        manager.run(100)
        tail.reboot()
        tail.speaks = True
        heard = manager.told(events.PeHeardAgain)
        count = len(heard)
        manager.run(30)
        heard = manager.told(events.PeHeardAgain)
        equal(len(heard), count + 1, "how often it is heard again")
        equal(heard[-1].cause, f"held down for {hold_ms} ms", "hold-down")
        manager.run(hold_ms + 60)
        demand("tail_b" in manager.has_available(), f"it is not back after {hold_ms} ms")


def the_longest_hold_down_is_a_minute() -> None:
    """The limit holds however often a PE is lost; a restarted manager remembers the losses and the hold-down."""
    spec = example("demux_actuators")
    for losses, hold_ms in ((2, 400), (8, 25_600), (9, 51_200), (10, 60_000), (30, 60_000)):
        manager = ManagerUnderTest(spec, disk=remembering(spec, Memory(term=1, quarantined={"tail_b": losses})))
        manager.run(700)
        heard = [one.cause for one in manager.told(events.PeHeardAgain)]
        equal(heard, [f"held down for {hold_ms} ms"], f"after {losses} losses it is")
        equal(manager.has_available() == _ALL, hold_ms < 700, "available after 700 ms")


def a_reboot_is_a_loss() -> None:
    """Another incarnation is a loss, however soon; what the PE ran has stopped, so T_lease is not waited for."""
    manager = ManagerUnderTest().flies()
    tail = manager.pes["tail_a"]  # it drives
    tail.reboot()
    tail.beat()
    began_ns = manager.run(45)
    lost = manager.told(events.PeLost, began_ns)
    equal([(one.pe, one.cause) for one in lost], [("tail_a", "it rebooted (incarnation 2)")], "PEs that are lost")
    demand(lost[0].t_ns - began_ns < 2 * MS, "a reboot is not noticed immediately")
    manager.run(250)
    steps = [one.step for one in manager.told(events.EpochStep, began_ns)]
    equal(steps[:1], ["GO_ALL"], "steps after a reboot of the PE that drove")


def a_pe_that_does_not_hear_is_failed() -> None:
    """The manager fails a PE that reports for longer than T_lease that it hears no LEASE, while most PEs hear it."""
    manager = ManagerUnderTest().flies()
    tail = manager.pes["tail_b"]
    manager.run_into_next_period(8)
    tail.hears = False
    began_ns = manager.run(95)
    equal(manager.told(events.PeLost, began_ns), [], "lost within T_lease")
    manager.run(50)
    lost = manager.told(events.PeLost, began_ns)
    equal([(one.pe, one.cause) for one in lost], [("tail_b", "it hears no lease")], "PEs that are failed")
    manager.run(1000)
    demand("tail_b" not in manager.has_available(), "a PE that does not hear is available again")
    tail.hears = True
    manager.run(300)
    demand("tail_b" in manager.has_available(), "a PE that hears again is not available again")
    tail.hears = False
    manager.run(90)
    tail.hears = True
    manager.run(30)
    tail.hears = False
    began_ns = manager.run(90)
    equal(manager.told(events.PeLost, began_ns), [], "lost although it has heard in between")


def what_page_1_reports_of_the_lease_counts_too() -> None:
    """Where every page 0 is lost, page 1 shows that the PE lives, and that it hears LEASE."""
    manager = ManagerUnderTest().flies()
    quiet = manager.pes["tail_b"]
    quiet.speaks = False
    for hears, lost in ((True, []), (False, ["tail_b"])):
        quiet.hears = hears
        began_ns = manager.now_ns
        for _ in range(10):
            quiet.answer()
            manager.run(20)
        equal([one.pe for one in manager.told(events.PeLost, began_ns)], lost, f"lost when page 1 says hears={hears}")


def when_most_pes_do_not_hear_none_is_failed() -> None:
    """Then the manager is the one that is not heard; half of the PEs are not most."""
    manager = ManagerUnderTest().flies()
    for pe in ("tail_a", "tail_b"):
        manager.pes[pe].hears = False
    began_ns = manager.run(400)
    equal(manager.told(events.PeLost, began_ns), [], "PEs that are lost")
    manager.pes["tail_a"].hears = True
    manager.run(200)
    equal([one.pe for one in manager.told(events.PeLost, began_ns)], ["tail_b"], "lost when one of three does not hear")
    manager.pes["tail_b"].speaks = False
    manager.run(200)
    manager.pes["tail_a"].hears = False
    began_ns = manager.run(200)
    equal([one.pe for one in manager.told(events.PeLost, began_ns)], ["tail_a"], "lost when one of two does not hear")


def a_manager_that_hears_no_pe_sends_nothing() -> None:
    """The manager sends nothing until it hears a PE; then it listens for T_lease, and begins a new term."""
    manager = ManagerUnderTest().flies()
    term = manager.lease().term
    last_ns = _silence(manager, "flight", "tail_a", "tail_b")
    manager.run(300)
    demand(bool(manager.told(events.HearsNobody, last_ns)), "it hears no PE, and goes on")
    began_ns = manager.run(5000)
    equal(manager.heard(began_ns, *Command), [], "commands of a manager that hears no PE")
    manager.pes["flight"].speaks = True
    began_ns = manager.run(600)
    first_ns, lease = manager.said(Lease, began_ns)[0]
    equal(lease.term, term + 2, "its next term")
    demand(95 * MS < first_ns - began_ns < 125 * MS, f"it sends {(first_ns - began_ns) / MS} ms after it hears a PE")


def a_manager_that_hears_no_pe_puts_none_in_quarantine() -> None:
    """A PE that was lost before, and is now lost with all others, has no longer hold-down; the journal agrees."""
    manager = ManagerUnderTest().flies()
    manager.pes["tail_b"].reboot()
    manager.run(800)
    demand("tail_b" in manager.has_available(), "a PE that has restarted is not available again")
    began_ns = _silence(manager, "flight", "tail_a", "tail_b")
    manager.run(300)
    lost = [one.pe for one in manager.told(events.PeLost, began_ns)]
    equal(sorted(lost), ["flight", "tail_a", "tail_b"], "PEs that are lost")
    equal(manager.disk.opened().quarantined, {}, "PEs in quarantine after a restart")


def a_manager_that_most_pes_refuse_falls_silent() -> None:
    """It falls silent when most PEs report no LEASE for T_lease; the next mastership waits for twice as long."""
    manager = ManagerUnderTest(standby=True).flies()
    for pe in manager.pes.values():
        pe.hears = False
    began_ns = manager.run(3000)
    refused = [one.t_ns for one in manager.told(events.Refused, began_ns)]
    began = [began_ns, *(one.t_ns for one in manager.told(events.TakenOver, began_ns))]
    for number, (first_ns, last_ns) in enumerate(zip(began, refused, strict=False)):
        wanted_ns = LEASE_NS << number
        lasted_ns = last_ns - first_ns
        demand(wanted_ns <= lasted_ns <= wanted_ns + 2 * PERIOD_NS, f"term {number} is refused for {lasted_ns} ns")
    demand(len(refused) >= 3, f"it is refused {len(refused)} times in three seconds")
    manager = ManagerUnderTest(standby=True)
    for pe in manager.pes.values():
        pe.hears = False
    manager.run(400)
    lasted_ns = manager.told(events.Refused)[0].t_ns - manager.said(Lease)[0][0]
    demand(lasted_ns <= LEASE_NS + 2 * PERIOD_NS, f"a manager that was never heard sends for {lasted_ns} ns")


def a_manager_that_is_far_behind_skips_terms_once() -> None:
    """Where PEs know a far higher term, only the third mastership in a row skips terms: 256 of them."""
    manager = ManagerUnderTest(standby=True).flies()
    for known, leaps in ((200, 1), (1000, 0)):
        terms: list[int] = []
        began_ns = manager.now_ns
        while manager.now_ns < began_ns + 4000 * MS:
            for pe in manager.pes.values():
                pe.hears = manager.lease().term > known
            manager.run(20)
            terms = sorted({lease.term for _, lease in manager.said(Lease, began_ns)})
        steps = [later - earlier for earlier, later in pairwise(terms)]
        equal([step for step in steps if step != 2], [258] * leaps, f"steps between terms where {known} is known")
        demand(len(steps) >= 2, "it is refused less than twice")
        if leaps:
            demand(terms[-1] > known, f"it is not active in a term above {known}, but in {terms[-1]}")


def of_two_managers_the_lower_term_gives_way() -> None:
    """At the start a manager that hears another gives way; later the lower term, or of doubles the one heard later.

    Without a key a manager that is active and alone ends only at the second LEASE: one may be recorded or forged.
    """
    other = LAST_MANAGER
    for at_ms, said, by, ends in (
        (50, Lease(2, 0, Step.PREPARED, 0), other, True),
        (50, Lease(4, 0, Step.PREPARED, 0), 126, True),
        (700, Lease(2, 0, Step.PREPARED, 0), other, True),
        (700, Lease(1, 0, Step.PREPARED, 0), other, False),
        (700, Lease(1, 0, Step.PREPARED, 0), 126, True),
        (700, Lease(3, 0, Step.PREPARED, 0), 126, True),
    ):
        manager = ManagerUnderTest()
        manager.run(at_ms)
        manager.main.command(said, manager=by)
        manager.run(15)
        equal(
            manager.manager.stopped is not None, ends and at_ms == 50, f"ended after one {said} of {by} at {at_ms} ms"
        )
        manager.main.command(said, manager=by)
        manager.run(5)
        began_ns = manager.run(300)
        own = manager.main.since(began_ns, [management_id(126, Command.LEASE)])
        equal(not own, ends, f"silent after {said} of {by} at {at_ms} ms")
        equal(manager.manager.stopped is not None, ends, f"ended after {said} of {by} at {at_ms} ms")
        equal(len(manager.told(events.SecondManager)), int(ends), "told of a second manager")
    manager = ManagerUnderTest().flies()
    frame = command_frame(Lease(9, 0, Step.PREPARED, 0), other)
    manager.main.say(frame._replace(data=frame.data[:7]), frame._replace(extended=True))
    manager.main.command(Alive(9, 0, frozenset()), Prepare(9, 9, 9), manager=other)
    began_ns = manager.run(100)
    demand(bool(manager.said(Lease, began_ns)), "it gives way to what is no LEASE")


def a_starting_manager_gives_way_too() -> None:
    """While a manager waits for a PE that has not been heard, a higher term makes it end, or stand by."""
    for standby in (False, True):
        manager = ManagerUnderTest(standby=standby)
        manager.pes["tail_b"].speaks = False
        manager.run(400)
        demand(
            bool(manager.said(Lease)) and not manager.plan_requests(),
            "it does not wait for a PE that has not been heard",
        )
        for _ in range(2):
            manager.main.command(Lease(2, 0, Step.PREPARED, 0), manager=LAST_MANAGER)
            manager.run(15)
        began_ns = manager.run(80)
        equal(manager.main.since(began_ns, [management_id(126, Command.LEASE)]), [], "its LEASEs after a higher term")
        equal(manager.manager.stopped is None, standby, "it stands by")


def other_frames_mean_nothing() -> None:
    """A state that is cut short, has a 29-bit identifier, or comes under no PE's number changes no standing."""
    manager = ManagerUnderTest().flies()
    tail = manager.pes["tail_b"]
    last_ns = _silence(manager, "tail_b")
    frame = Frame(165 + tail.node, tail.page_0().encode())
    for wrong in (frame._replace(data=frame.data[:7]), frame._replace(extended=True), Frame(165 + 99, frame.data)):
        manager.main.say(wrong)
        manager.run(10)
    manager.run(60)
    (lost,) = manager.told(events.PeLost, last_ns)
    equal(lost.pe, "tail_b", "PEs that are lost")
    after_ns = lost.t_ns - last_ns
    demand(64 * MS < after_ns < 66 * MS, f"it is lost {after_ns / MS} ms after its last word")
