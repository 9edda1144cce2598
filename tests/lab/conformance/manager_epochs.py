"""How a manager deploys a configuration: its requests to PEs, how often, and what it waits for (protocol rule 4)."""

from dataclasses import replace
from itertools import pairwise

from heronry_manager import events
from heronry_manager.core.vocabulary import ClearElement, FailElement
from heronry_tools.sim.world.disk import Disk
from heronry_wire.frame import Frame
from heronry_wire.identifiers import Command, state_id
from heronry_wire.management import (
    NO_EPOCH,
    SLICE_BYTES_PER_FRAME,
    Activate,
    Alive,
    Prepare,
    SliceBody,
    SliceHead,
    Step,
)
from heronry_wire.state_frames import PeFlags, PeState, Reason, StatePage1
from lab.conformance.manager_under_test import LEASE_NS, PERIOD_NS, ManagerUnderTest, example
from lab.conformance.player import MS, demand, equal


def _asks_anew(manager: ManagerUnderTest, pe: str = "tail_a") -> int:
    """Let a PE be lost, so that another epoch follows; gives the moment."""
    manager.pes[pe].speaks = False
    manager.until(lambda: bool(manager.told(events.PeLost, manager.now_ns - MS)), 100, "no PE is lost")
    return manager.now_ns


def every_pe_gets_its_slice() -> None:
    """After PREPARE each PE gets head and body of its slice: all bytes, in frames of five, under the epoch's number."""
    manager = ManagerUnderTest().flies()
    began = manager.said(Prepare)[0]
    prepare = began[1]
    heads = {head.node: head for _, head in manager.said(SliceHead)}
    equal(set(heads), {pe.node for pe in manager.pes.values()}, "nodes with a head")
    demand(all(t_ns > began[0] for t_ns, _ in manager.said(SliceHead)), "a head comes before PREPARE")
    for node, head in heads.items():
        bodies = [body for _, body in manager.said(SliceBody) if body.node == node]
        equal(len(bodies), -(-head.length // SLICE_BYTES_PER_FRAME), f"frames of the body of node {node}")
        equal([body.index for body in bodies], list(range(1, len(bodies) + 1)), "their numbers")
        equal({body.epoch_low for body in bodies} | {head.epoch_low}, {prepare.epoch & 0xFF}, "their epoch")
    equal(prepare.term, manager.lease().term, "its term")
    equal(len(manager.said(Prepare)), 1, "PREPAREs while no PE is late")
    equal([one.step for one in manager.told(events.EpochStep)], ["GO_ALL"], "steps of the first epoch")
    equal((manager.lease().epoch, manager.lease().digest), (prepare.epoch, prepare.digest), "what LEASE repeats")
    equal(manager.lease().step, Step.GO_ALL, "the step that LEASE repeats")
    equal({(pe.state, pe.epoch) for pe in manager.pes.values()}, {(PeState.ACTIVE, prepare.epoch)}, "what the PEs run")


def a_pe_that_runs_its_slice_already_gets_the_head_alone() -> None:
    """In the new epoch such a PE gets only the head; a PE with another slice gets the body as well."""
    manager = ManagerUnderTest(example("n_version")).flies()
    runs = {pe.node: pe.runs for pe in manager.pes.values()}
    began_ns = manager.now_ns
    manager.accept(FailElement("device:imu_2"))
    manager.run(300)
    heads = {head.node: (head.digest, head.length) for _, head in manager.said(SliceHead, began_ns)}
    equal(heads.keys(), runs.keys(), "nodes with a head")
    changed = {node for node in runs if heads[node] != runs[node]}
    demand(0 < len(changed) < len(runs), "all slices of this test change, or none does")
    equal({body.node for _, body in manager.said(SliceBody, began_ns)}, changed, "nodes with a body")


def bodies_take_half_of_the_bus() -> None:
    """Bodies take at most half of the bus, since their identifier has priority over all data."""
    manager = ManagerUnderTest(example("elevator_and_chute")).flies()
    frames = manager.heard(-1, Command.SLICE)
    demand(len(frames) > 8, "the slices of this test are too short")
    bits = 135 * len(frames)
    took_ns = frames[-1].t_ns - frames[0].t_ns
    share = bits * 1_000_000_000 / took_ns / manager.main.bus.bitrate
    demand(0.44 < share < 0.62, f"slices take {share:.0%} of the bus")


def a_pe_that_does_not_stage_is_asked_again() -> None:
    """PREPARE and slice are repeated after a heartbeat period, then after 2, 4 and 8; the PE is given up after 25."""
    manager = ManagerUnderTest().flies()
    lazy = manager.pes["tail_b"]
    lazy.stages = False
    began_ns = _asks_anew(manager)
    manager.run(700)
    heads = [(t_ns, one) for t_ns, one in manager.said(SliceHead, began_ns) if one.node == lazy.node]
    epoch_low = heads[0][1].epoch_low
    times = [t_ns for t_ns, one in heads if one.epoch_low == epoch_low]
    waits = [round((b - a) / PERIOD_NS) for a, b in pairwise(times)]
    equal(waits, [1, 2, 4, 8, 8], "periods between two requests")
    lost = [one for one in manager.told(events.PeLost, began_ns) if one.pe == "tail_b"]
    equal([one.cause for one in lost], ["it does not acknowledge"], "why it is given up")
    after_ns = lost[0].t_ns - times[0]
    demand(
        0 <= after_ns - 25 * PERIOD_NS < PERIOD_NS + 3 * MS,
        f"it is given up after {after_ns / MS} ms",
    )
    prepares = [t_ns for t_ns, one in manager.said(Prepare, began_ns) if one.epoch & 0xFF == epoch_low]
    equal(len(prepares), len(times), "PREPAREs")
    equal([t for t, a in manager.said(Activate, began_ns) if a.epoch & 0xFF == epoch_low], [], "ACTIVATEs")


def what_is_for_all_pes_is_not_sent_for_each() -> None:
    """However many PEs are late at different times, PREPARE goes out at most once in half a heartbeat period."""
    manager = ManagerUnderTest()
    for pe in manager.pes.values():
        pe.stages = False
    manager.run(160)
    manager.pes["tail_a"].answer(Reason.INCOMPLETE)
    manager.run(6)
    manager.pes["tail_b"].answer(Reason.INCOMPLETE)
    manager.run(300)
    times = [t_ns for t_ns, _ in manager.said(Prepare)]
    demand(len(times) > 5, "PREPARE is not repeated")
    apart = [later - earlier for earlier, later in pairwise(times)]
    demand(min(apart) > PERIOD_NS // 2 - MS, f"PREPAREs are {[one / MS for one in apart]} ms apart")


def a_pe_that_does_not_take_a_step_is_asked_again() -> None:
    """ACTIVATE is repeated at the same pace, LEASE every period; at last the manager fails the PE and plans anew."""
    manager = ManagerUnderTest()
    manager.pes["tail_b"].steps = False
    manager.run(450)
    demand(not manager.told(events.Reconfigured), "a PE does not take the step, and the epoch is done")
    times = [t_ns for t_ns, _ in manager.said(Activate)]
    waits = [round((b - a) / PERIOD_NS) for a, b in pairwise(times)]
    equal(waits, [1, 2, 4, 8], "periods between ACTIVATEs")
    manager.run(400)
    equal([one.pe for one in manager.told(events.PeLost)], ["tail_b"], "PEs that are failed")
    demand(bool(manager.told(events.Reconfigured)), "nothing runs without the PE that was failed")


def a_pe_that_misses_frames_gets_them_again() -> None:
    """The manager answers INCOMPLETE with head and body immediately."""
    manager = ManagerUnderTest()
    late = manager.pes["flight"]
    late.stages = False
    manager.run(150)
    count = len({body.index for _, body in manager.said(SliceBody) if body.node == late.node})
    demand(count > 0, "no body is sent")
    late.answer(Reason.INCOMPLETE)
    began_ns = manager.run(9)
    bodies = [body.index for _, body in manager.said(SliceBody, began_ns) if body.node == late.node]
    equal(bodies, list(range(1, count + 1)), "frames that are sent again")
    late.stages = True
    late.take(manager.said(SliceHead)[-1][1])
    manager.run(60)
    demand(bool(manager.told(events.Reconfigured)), "after that it does not go on")


def a_pe_that_refuses_is_failed() -> None:
    """The manager fails a PE for each reason that no repetition removes, and for no other reason.

    A PE that lacks an image also reports the module, and is planned with for everything else. A PE whose table is
    another one is left out until it restarts.
    """
    for reason, cause in (
        (Reason.DIGEST, "its table is another one than this manager compiles for it"),
        (Reason.UNKNOWN_INDEX, "it cannot stage its slice: UNKNOWN_INDEX"),
        (Reason.IMAGE, None),
        (Reason.INCOMPLETE, None),
        (Reason.STALE_EPOCH, None),
        (Reason.STALE_TERM, None),
        (Reason.NOT_ON_BOARD, None),
    ):
        manager = ManagerUnderTest()
        manager.pes["tail_b"].refuses = reason
        manager.run(250)
        lost = [(one.pe, one.cause) for one in manager.told(events.PeLost)]
        wanted = [("tail_b", cause)] if cause else []
        equal(lost, wanted, f"PEs that are failed when one reports {reason.name}")


def an_answer_about_something_else_does_not_count() -> None:
    """Page 1 of another epoch, or with another digest, does not count."""
    manager = ManagerUnderTest()
    late = manager.pes["tail_b"]
    late.stages = False
    manager.run(150)
    prepare = manager.said(Prepare)[-1][1]
    for epoch, digest in ((prepare.epoch - 1, prepare.digest), (prepare.epoch, prepare.digest + 1), (prepare.epoch, 0)):
        page = StatePage1(PeState.UNCONFIGURED, PeFlags.HEARS_LEASE, epoch, digest, Reason.NONE, 0)
        manager.main.say(Frame(state_id(late.node), page.encode()))
        manager.run(5)
        equal(manager.said(Activate), [], f"ACTIVATEs after page 1 of {epoch}, {digest}")
    page = StatePage1(PeState.UNCONFIGURED, PeFlags.HEARS_LEASE, prepare.epoch, prepare.digest, Reason.STALE_TERM, 0)
    manager.main.say(Frame(state_id(late.node), page.encode()))
    manager.run(5)
    demand(bool(manager.said(Activate)), "a PE that has staged, and refuses another manager, does not count as staged")


def a_change_before_activate_gives_the_number_up() -> None:
    """The manager never uses that number again and sends nothing more of it; the next epoch has a new number."""
    manager = ManagerUnderTest().flies()
    manager.pes["tail_b"].stages = False
    began_ns = _asks_anew(manager)
    manager.run(30)
    given_up = manager.said(Prepare)[-1][1].epoch
    manager.accept(FailElement("pe:tail_b"))
    changed_ns = manager.now_ns
    manager.pes["tail_b"].stages = True
    manager.run(300)
    equal([one.epoch for one in manager.told(events.EpochAbandoned, began_ns)], [given_up], "epochs given up")
    later = {one.epoch for _, one in manager.said(Prepare, changed_ns + MS)}
    demand(bool(later) and min(later) == given_up + 1, f"epochs after {given_up}: {later}")
    demand(all(a.epoch != given_up for _, a in manager.said(Activate)), "an epoch that was given up is activated")


def what_is_driven_breaks_before_it_makes() -> None:
    """Where a healthy PE must let go, BREAK comes first: no PE gets GO before that PE has reported BROKEN."""
    manager = ManagerUnderTest().flies()
    driver, rival = manager.pes["tail_a"], manager.pes["tail_b"]
    driver.steps = False
    rival.holds = True
    began_ns = manager.now_ns
    manager.accept(FailElement("device:elevator_servo_1"))
    manager.run(110)
    steps = {one.step for _, one in manager.said(Activate, began_ns)}
    equal(steps, {Step.BREAK}, "steps while the driver has not broken")
    equal(manager.lease().step, Step.BREAK, "step that LEASE repeats")
    equal(manager.told(events.EpochStep, began_ns)[0].waiting_for, ("tail_a",), "PEs that are waited for")
    driver.steps = True
    manager.run(60)
    steps_in_order = [one.step for one in manager.told(events.EpochStep, began_ns)]
    equal(steps_in_order, ["BREAK", "GO_ALL"], "steps")
    equal(len(manager.told(events.Reconfigured, began_ns)), 1, "reconfigurations")


def what_is_late_frees_nothing() -> None:
    """A page 0 of the previous epoch arrives late, through a gateway: the PE that drives now still has to break."""
    for behind in (1, 8):
        manager = ManagerUnderTest().flies()
        driver = manager.pes["tail_b"]
        before = driver.page_0()
        manager.accept(FailElement("device:elevator_servo_1"))
        manager.run(300)
        manager.accept(ClearElement("device:elevator_servo_1"))
        manager.run_into_next_period(15)
        late = replace(before, sequence=(driver.sequence - 1 - behind) % 256)
        manager.main.say(Frame(state_id(driver.node), late.encode()))
        manager.run(1)
        began_ns = manager.now_ns
        manager.accept(FailElement("device:elevator_servo_2"))
        manager.run(200)
        steps = [(one.step, one.waiting_for) for one in manager.told(events.EpochStep, began_ns)]
        equal(steps[0], ("BREAK", ("tail_b",)), f"the first step after a page that is {behind} behind")


def a_silent_driver_is_given_t_lease() -> None:
    """T_lease counts from the first ALIVE without the PE, which goes out immediately; other steps do not wait."""
    manager = ManagerUnderTest().flies()
    manager.pes["tail_b"].holds = True
    began_ns = _asks_anew(manager, "tail_a")
    manager.run(400)
    steps = [(one.t_ns, one.step) for one in manager.told(events.EpochStep, began_ns)]
    equal([step for _, step in steps], ["GO", "GO_ALL"], "steps")
    node = manager.pes["tail_a"].node
    named_ns = max(t_ns for t_ns, alive in manager.said(Alive) if node in alive.nodes)
    left_out_ns = min(t_ns for t_ns, _ in manager.said(Alive, named_ns))
    demand(abs(left_out_ns - began_ns) < MS, f"it is left out {(left_out_ns - began_ns) / MS} ms after it was lost")
    waited_ns = steps[1][0] - left_out_ns
    demand(abs(waited_ns - LEASE_NS) < MS, f"GO_ALL comes {waited_ns / MS} ms after the first ALIVE without it")


def a_pe_that_a_mastership_has_never_heard_is_given_t_lease() -> None:
    """T_lease counts from the first ALIVE, which leaves the PE out: a previous manager may have given it an output."""
    manager = ManagerUnderTest()
    for pe in manager.pes.values():
        pe.epoch, pe.digest, pe.state = 16, 1, PeState.ACTIVE
    manager.pes["tail_a"].speaks = False
    manager.run(500)
    _goes_t_lease_after(manager, manager.said(Alive)[0][0])


def a_pe_that_has_only_staged_what_is_adopted_is_given_t_lease_too() -> None:
    """The PE reports that it runs nothing, but it may have taken the epoch up by LEASE since then."""
    before = ManagerUnderTest().flies()
    manager = ManagerUnderTest(disk=before.disk)
    manager.manager.planning = lambda _: None  # no plan comes between
    for name in ("flight", "tail_b"):
        manager.pes[name].goes_on_as(before.pes[name])
    manager.until(lambda: bool(manager.told(events.Adopted)), 300, "what runs is not adopted")
    manager.run(25)
    manager.manager.planning = manager.plans
    manager.pes["tail_a"].speaks = False
    manager.until(lambda: bool(manager.told(events.PeLost)), 100, "no PE is lost")
    began_ns = manager.now_ns
    manager.run(400)
    _goes_t_lease_after(manager, manager.said(Alive, began_ns - MS)[0][0])


def an_alive_that_waits_leaves_no_pe_out() -> None:
    """The manager cannot send when it leaves a driver out: T_lease counts from when that ALIVE is on the bus."""
    manager = ManagerUnderTest().flies()
    manager.pes["tail_a"].speaks = False
    manager.run_into_next_period(15)
    manager.manager.wire(transmit_failed=True)
    manager.run(60)
    equal([one.pe for one in manager.told(events.PeLost)], ["tail_a"], "PEs that are lost")
    manager.manager.wire(transmit_failed=False)
    heard_ns = manager.run(500)
    node = manager.pes["tail_a"].node
    left_out_ns = next(t_ns for t_ns, one in manager.said(Alive, heard_ns) if node not in one.nodes)
    _goes_t_lease_after(manager, left_out_ns)


def what_is_remembered_and_newer_is_not_given_up_for_what_is_seen() -> None:
    """The heard PEs run the same plan in an older epoch: the manager keeps the newer one, which another PE may run."""
    before = ManagerUnderTest().flies()
    older = {name: (pe.epoch, pe.digest, pe.state, pe.runs) for name, pe in before.pes.items()}
    before.pes["tail_a"].speaks = False
    before.run(400)
    newest = before.lease().epoch
    manager = ManagerUnderTest(disk=before.disk)
    for name in ("flight", "tail_a"):
        pe = manager.pes[name]
        pe.epoch, pe.digest, pe.state, pe.runs = older[name]
    manager.pes["tail_b"].speaks = False
    manager.run(500)
    equal(manager.told(events.Adopted), [], "epochs that are adopted")
    demand(manager.lease().epoch > newest, f"epoch {manager.lease().epoch} runs, and {newest} is remembered")
    _goes_t_lease_after(manager, manager.said(Alive)[0][0])


def a_pe_that_may_still_accept_another_mastership_is_given_t_lease() -> None:
    """It runs the adopted epoch and has reported no LEASE since, or it runs what this manager did not command."""
    servos = [f"device:elevator_servo_{number}" for number in (1, 2)]
    before = ManagerUnderTest().flies()
    for servo in servos:
        before.accept(FailElement(servo))
    before.run(300)
    for hears, epoch, waits in ((True, 0, False), (False, 0, True), (True, 5, True)):
        manager = ManagerUnderTest(disk=Disk(before.spec, before.disk.data))
        for name, ran in before.pes.items():
            manager.pes[name].goes_on_as(ran)
        silent = manager.pes["tail_a"]
        silent.hears = hears
        manager.until(lambda m=manager: bool(m.told(events.Adopted)), 300, "what runs is not adopted")  # type: ignore[misc]
        manager.run_into_next_period(15)
        silent.epoch += epoch
        manager.run(20)
        silent.speaks = False
        manager.until(lambda m=manager: bool(m.told(events.PeLost)), 100, "no PE is lost")  # type: ignore[misc]
        left_out_ns = manager.told(events.PeLost)[0].t_ns
        for servo in servos:
            manager.accept(ClearElement(servo))
        manager.run(300)
        goes_ns = next(
            one.t_ns for one in manager.told(events.Reconfigured, left_out_ns) if "servo_driver_2" in one.started
        )
        took_ms = (goes_ns - left_out_ns) / MS
        demand((took_ms > 99) is waits, f"hearing {hears}, {epoch} epochs on: the DEMUX goes after {took_ms} ms")


def _goes_t_lease_after(manager: ManagerUnderTest, alive_ns: int) -> None:
    """Demand that a PE drives the DEMUX again, and not before T_lease after an ALIVE."""
    epoch = manager.lease().epoch
    gone = [t_ns for t_ns, one in manager.said(Activate) if (one.epoch, one.step) == (epoch, Step.GO_ALL)]
    demand(bool(gone), "no PE drives the DEMUX again")
    waited_ns = gone[0] - alive_ns
    demand(waited_ns > LEASE_NS - MS, f"GO_ALL comes {waited_ns / MS} ms after the ALIVE from which T_lease counts")


def a_pe_that_repeats_what_it_ran_before_may_drive_what_comes() -> None:
    """The last page 0 heard was on its way at ACTIVATE: the manager waits T_lease for what the PE may take up now."""
    manager = ManagerUnderTest().flies()
    servos = [f"device:elevator_servo_{number}" for number in (1, 2)]
    for servo in servos:
        manager.accept(FailElement(servo))
    manager.run(300)
    driver = manager.pes["tail_a"]
    driver.steps = False
    began_ns = manager.run_into_next_period(12)
    for servo in servos:
        manager.accept(ClearElement(servo))
    manager.until(lambda: bool(manager.said(Activate, began_ns)), 200, "nothing is activated")
    driver.beat()
    manager.run(0.3)
    driver.speaks = False
    manager.run(300)
    _goes_t_lease_after(manager, [t_ns for t_ns, one in manager.said(Alive) if driver.node in one.nodes][-1])


def a_pe_that_sends_and_is_given_up_is_given_t_lease_too() -> None:
    """The manager waits before another PE gets its identifiers: the PE sends until it hears an ALIVE without it."""
    manager = ManagerUnderTest(example("fail_over")).flies()
    host = next(pe for pe in ("left", "right") if manager.pes[pe].runs[1] > 0)
    manager.pes[host].steps = False
    manager.accept(FailElement(f"pe:{host}"))
    began_ns = manager.run(400)
    steps = [(one.t_ns, one.step) for one in manager.told(events.EpochStep, began_ns)]
    equal([step for _, step in steps], ["BREAK", "GO_ALL"], "steps")
    named_ns = max(t_ns for t_ns, alive in manager.said(Alive) if manager.pes[host].node in alive.nodes)
    waited_ns = steps[1][0] - named_ns
    demand(abs(waited_ns - LEASE_NS) < 3 * MS, f"others go {waited_ns / MS} ms after the last ALIVE that named it")


def a_jump_of_the_clock_frees_nothing() -> None:
    """The manager's clock jumps, and a PE counts as lost: the manager waits as long as without the jump."""
    manager = ManagerUnderTest(example("fail_over")).flies()
    host = next(pe for pe in manager.pes.values() if pe.name in ("left", "right") and pe.runs[1] > 0)
    silent_since_ns = manager.run_into_next_period(0)
    manager.run(17)
    host.speaks = False
    for pe in manager.pes.values():
        pe.beat()
    manager.run(1)
    manager.manager.jump(5 * PERIOD_NS // 2)
    began_ns = manager.run(5)
    equal([one.pe for one in manager.told(events.PeLost, began_ns)], [host.name], "PEs that are lost immediately")
    manager.run(400)
    steps = [(t_ns - silent_since_ns, one.step) for t_ns, one in manager.said(Activate, began_ns)]
    equal([step for _, step in steps], [Step.BREAK, Step.GO_ALL], "steps")
    demand(steps[-1][0] >= PERIOD_NS * 13 // 4, f"others go {steps[-1][0] / MS} ms after its last state")


def a_pe_that_runs_nothing_any_more_is_not_waited_for() -> None:
    """A PE that reports that it runs nothing has released all its outputs, although its incarnation is the same."""
    manager = ManagerUnderTest(example("fail_over")).flies()
    host = next(pe for pe in manager.pes.values() if pe.name in ("left", "right") and pe.runs[1] > 0)
    host.state, host.epoch, host.digest, host.steps = PeState.UNCONFIGURED, NO_EPOCH, 0, False
    began_ns = manager.run(400)
    equal([one.pe for one in manager.told(events.PeLost, began_ns)], [host.name], "PEs that are lost")
    equal([one.step for one in manager.told(events.EpochStep, began_ns)], ["GO_ALL"], "steps")


def a_silent_stranger_may_drive_anything_that_could_be_placed_there() -> None:
    """A PE that was available under another manager falls silent before the first epoch: the manager waits T_lease."""
    manager = ManagerUnderTest()
    stranger = manager.pes["tail_a"]
    stranger.state, stranger.epoch, stranger.digest = PeState.ACTIVE, 40, 0x99
    manager.manager.planning = lambda _: None
    manager.run(200)
    demand(stranger.name in manager.has_available(), "a stranger is not available")
    manager.manager.planning = manager.plans
    began_ns = _asks_anew(manager, stranger.name)
    manager.pes["tail_b"].holds = True
    manager.run(400)
    equal([one.step for one in manager.told(events.EpochStep, began_ns)], ["GO", "GO_ALL"], "steps")


def a_pe_that_has_let_go_is_not_waited_for() -> None:
    """A PE that drove an output, and has since reported another configuration, holds nothing when it falls silent."""
    manager = ManagerUnderTest().flies()
    manager.accept(FailElement("device:elevator_servo_1"))
    manager.run(300)
    manager.pes["tail_a"].speaks = False
    manager.until(lambda: "tail_a" not in manager.has_available(), 100, "no PE is lost")
    began_ns = manager.now_ns
    manager.pes["flight"].reboot()
    manager.pes["flight"].beat()
    manager.run(400)
    steps = [one.step for one in manager.told(events.EpochStep, began_ns)]
    demand(bool(steps) and "GO" not in steps, f"steps after a PE that has let go was lost: {steps}")


def a_pe_that_comes_late_to_what_runs_is_admitted() -> None:
    """Where the late PE has nothing to do, it gets PREPARE, its slice and LEASE of the same epoch; other PEs go on."""
    manager = ManagerUnderTest().flies()
    began_ns = _asks_anew(manager, "tail_b")  # which has nothing to do
    manager.run(300)
    epoch = manager.lease().epoch
    late = manager.pes["tail_b"]
    late.reboot()
    late.speaks = True
    began_ns = manager.now_ns
    manager.run(500)
    equal(manager.lease().epoch, epoch, "the epoch")
    equal((late.state, late.epoch), (PeState.ACTIVE, epoch), "what the late PE runs")
    equal({one.node for _, one in manager.said(SliceHead, began_ns)}, {late.node}, "nodes that get a slice")
    equal(manager.said(Activate, began_ns), [], "ACTIVATEs")
    equal(len(manager.told(events.PlanUnchanged, began_ns)), 1, "plans that change nothing")


def a_pe_that_has_staged_what_was_given_up_gets_a_newer_epoch() -> None:
    """The plan is again what runs, but the late PE has staged a newer number and would not accept the older one."""
    manager = ManagerUnderTest().flies()
    _asks_anew(manager, "tail_b")
    manager.run(300)
    late, slow = manager.pes["tail_b"], manager.pes["flight"]
    late.reboot()
    late.speaks, slow.stages = True, False
    manager.accept(FailElement("device:elevator_servo_1"))
    manager.until(lambda: "tail_b" in manager.has_available(), 300, "a PE that is back is not available")
    manager.run(20)
    given_up = manager.said(Prepare)[-1][1].epoch
    slow.stages = True
    manager.accept(ClearElement("device:elevator_servo_1"))
    manager.run(500)
    equal(manager.lease().epoch, given_up + 1, "the epoch")
    equal({(pe.state, pe.epoch) for pe in manager.pes.values()}, {(PeState.ACTIVE, given_up + 1)}, "what the PEs run")


def a_pe_that_runs_what_no_manager_commanded_is_failed() -> None:
    """The manager fails a PE that runs another epoch or another digest, or that runs nothing any more."""
    for change, cause in (
        ({"epoch": 999}, "which no manager commanded"),
        ({"digest": 0x99}, "which no manager commanded"),
        ({"state": PeState.UNCONFIGURED, "epoch": 0, "digest": 0}, "it runs nothing although it was configured"),
    ):
        manager = ManagerUnderTest().flies()
        stray = manager.pes["tail_b"]
        stray.steps = False
        for name, value in change.items():
            setattr(stray, name, value)
        began_ns = manager.run(45)
        lost = manager.told(events.PeLost, began_ns)
        demand(bool(lost) and lost[0].pe == "tail_b" and cause in lost[0].cause, f"after {change}: {lost}")
        demand("pe:tail_b" in manager.plan_requests()[-1].now.down, "it is not planned around")


def a_manager_adopts_what_runs() -> None:
    """A manager that starts in flight, and whose plan runs already, opens no epoch: it repeats the one that runs."""
    first = ManagerUnderTest().flies()
    lease = first.lease()
    manager = ManagerUnderTest()
    for name, ran in first.pes.items():
        manager.pes[name].goes_on_as(ran)
    manager.run(400)
    equal([one.epoch for one in manager.told(events.Adopted)], [lease.epoch], "adopted")
    equal(manager.said(Prepare), [], "PREPAREs")
    equal((manager.lease().epoch, manager.lease().digest), (lease.epoch, lease.digest), "what LEASE repeats")
    equal(manager.lease().step, Step.GO_ALL, "its step")


def what_is_adopted_is_newest_even_if_the_pes_that_ran_it_are_gone() -> None:
    """A PE that joins gets a newer epoch than the adopted one, wherever this manager's own numbers begin."""
    first = ManagerUnderTest()
    manager = ManagerUnderTest()
    for one in (first, manager):
        for name in ("tail_a", "tail_b"):
            one.pes[name].speaks = False
    first.run(5500)
    runs, played = first.pes["flight"], manager.pes["flight"]
    played.epoch, played.digest, played.state, played.runs = 40, runs.digest, runs.state, runs.runs
    manager.run(5500)
    equal([one.epoch for one in manager.told(events.Adopted)], [40], "adopted")
    began_ns = _asks_anew(manager, "flight")
    manager.pes["tail_a"].speaks = True
    manager.run(600)
    epochs = [one.epoch for _, one in manager.said(Prepare, began_ns)]
    demand(bool(epochs) and min(epochs) > 40, f"epochs after 40 was adopted: {epochs}")


def a_manager_adopts_nothing_that_is_not_clean() -> None:
    """One PE has another digest, another epoch, or is not ACTIVE: the manager opens a new epoch, newer than all."""
    first = ManagerUnderTest().flies()
    for change in ({"digest": 0x99}, {"epoch": 4000}, {"state": PeState.BROKEN}):
        manager = ManagerUnderTest()
        for name, ran in first.pes.items():
            manager.pes[name].goes_on_as(ran)
        for name, value in change.items():
            setattr(manager.pes["tail_a"], name, value)
        manager.run(600)
        equal(manager.told(events.Adopted), [], f"adopted with {change}")
        epochs = [one.epoch for _, one in manager.said(Prepare)]
        demand(bool(epochs) and min(epochs) > max(first.lease().epoch, change.get("epoch", 0)), f"epochs {epochs}")


def a_pre_planned_fault_is_called_by_its_number() -> None:
    """Where a PE holds the contingency, PREPARE suffices; a PE that reports NOT_ON_BOARD gets its slice, too."""
    manager = ManagerUnderTest(contingencies=1).flies()
    stubborn = manager.pes["flight"]
    stubborn.stages = False
    began_ns = _asks_anew(manager)
    manager.until(lambda: bool(manager.said(Prepare, began_ns)), 50, "no PREPARE comes")
    prepare = manager.said(Prepare, began_ns)[-1][1]
    demand(prepare.contingency > 0, "a pre-planned fault is not called by its number")
    equal(manager.said(SliceHead, began_ns), [], "heads while no PE reports that it does not hold the contingency")
    stubborn.answer(Reason.NOT_ON_BOARD)
    stubborn.answer(Reason.NOT_ON_BOARD)
    manager.run(8)
    heads = [one for _, one in manager.said(SliceHead, began_ns)]
    equal([head.node for head in heads], [stubborn.node], "nodes that get a head")
    equal(heads[0].epoch_low, prepare.epoch & 0xFF, "its epoch")


def epochs_of_a_term_begin_with_its_block() -> None:
    """A manager uses every second block of sixteen numbers, from the block of its term on, and no number twice."""
    manager = ManagerUnderTest().flies()
    epochs = [manager.lease().epoch]
    for _ in range(18):
        began_ns = manager.now_ns
        manager.accept(FailElement("device:elevator_servo_1" if len(epochs) % 2 else "device:elevator_servo_2"))
        manager.run(400)
        manager.accept(ClearElement("device:elevator_servo_1" if len(epochs) % 2 else "device:elevator_servo_2"))
        manager.run(400)
        epochs += [one.epoch for _, one in manager.said(Prepare, began_ns)]
    numbers = sorted(set(epochs))
    equal(numbers[:16], list(range(1, 17)), "the first epochs")
    demand(len(numbers) > 16, "the test is too short")
    equal(numbers[16], 33, "the epoch after the first block of term 1")
