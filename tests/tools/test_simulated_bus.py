"""The simulated bus: which frame wins it, for how long, and what can happen to a frame on the way."""

from random import Random

from heronry_tools.sim.world.bus import Faults, Sent, SimulatedBus, Tampering
from heronry_tools.sim.world.clock import Clock
from heronry_tools.sim.world.station import Station
from heronry_wire.frame import Frame
from heronry_wire.sansio import Received
from heronry_wire.timing import exact_bits

LOW, MIDDLE, HIGH = Frame(0x700, b"\x01"), Frame(0x400, b"\x03"), Frame(0x100, b"\x02")


class Nodes:
    """Three stations on a bus of 1 Mbit/s, and what each has received."""

    def __init__(self, faults: Faults | None = None) -> None:
        self.clock = Clock()
        self.bus = SimulatedBus("can0", 1_000_000, self.clock, Random(1), faults or Faults())
        self.sent: list[Sent] = []
        self.bus.taps.append(self.sent.append)
        self.heard: dict[str, list[Frame]] = {}
        self.a, self.b, self.c = (self.join(name) for name in "abc")

    def join(self, name: str) -> Station:
        heard = self.heard[name] = []
        return self.bus.join(name, 0, lambda event: heard.append(frame_of(event)))

    def run(self, duration_ns: int = 10_000_000) -> None:
        self.clock.run_until(self.clock.now_ns + duration_ns)


def frame_of(event: Received) -> Frame:
    return event.frame


def test_arbitration_waits_for_all_frames_that_are_offered_at_that_instant() -> None:
    clock, order = Clock(), list[str]()
    clock.at(5, lambda: clock.at_last(lambda: order.append("late")))
    clock.at(5, lambda: clock.at(1, lambda: order.append("third")))
    clock.at(5, lambda: order.append("second"))
    clock.run_until(4)
    assert (order, clock.now_ns) == ([], 4)
    clock.run_until(9)
    assert order == ["second", "third", "late"]


def test_of_frames_offered_at_one_instant_the_most_urgent_wins_and_takes_the_time_of_its_bits() -> None:
    nodes = Nodes()
    nodes.bus.offer(nodes.a, LOW)
    nodes.bus.offer(nodes.b, HIGH)
    nodes.run()
    first_ns = exact_bits(HIGH) * 1000
    assert nodes.sent == [Sent(first_ns, "can0", "b", HIGH), Sent(first_ns + exact_bits(LOW) * 1000, "can0", "a", LOW)]
    assert nodes.bus.busy_bits == exact_bits(HIGH) + exact_bits(LOW)


def test_a_frame_on_the_bus_is_not_interrupted_by_a_more_urgent_one() -> None:
    nodes = Nodes()
    nodes.bus.offer(nodes.a, LOW)
    nodes.run(10_000)
    nodes.bus.offer(nodes.b, HIGH)
    nodes.run()
    assert [sent.frame for sent in nodes.sent] == [LOW, HIGH]


def test_a_station_that_stands_back_hands_over_only_frames_more_urgent_than_data() -> None:
    nodes = Nodes()
    nodes.bus.stand_back(nodes.a, 5_000_000)
    nodes.bus.offer(nodes.a, LOW)
    nodes.bus.offer(nodes.a, HIGH)
    nodes.bus.offer(nodes.b, MIDDLE)
    nodes.run()
    assert [sent.frame for sent in nodes.sent] == [HIGH, MIDDLE, LOW]
    assert nodes.sent[-1].end_ns == 5_000_000 + exact_bits(LOW) * 1000


def test_what_is_in_the_mailbox_stands_back_no_more() -> None:
    nodes = Nodes()
    nodes.bus.offer(nodes.a, LOW)
    nodes.bus.stand_back(nodes.a, 100_000)
    nodes.run()
    assert [sent.end_ns for sent in nodes.sent] == [exact_bits(LOW) * 1000]


def test_all_stations_but_the_sender_receive_a_frame() -> None:
    nodes = Nodes()
    nodes.bus.offer(nodes.a, LOW)
    nodes.run()
    assert nodes.heard == {"a": [], "b": [LOW], "c": [LOW]}


def test_a_destroyed_frame_is_sent_again_and_costs_its_time() -> None:
    nodes = Nodes(Faults(loss=0.5))
    for _ in range(20):
        nodes.bus.offer(nodes.a, LOW)
    nodes.run(100_000_000)
    assert nodes.heard["b"] == [LOW] * 20
    assert nodes.bus.busy_bits > 25 * exact_bits(LOW)


def test_one_receiver_may_miss_a_frame_or_have_it_twice() -> None:
    nodes = Nodes(Faults(omission=0.3, doubled=0.3))
    for _ in range(200):
        nodes.bus.offer(nodes.a, LOW)
    nodes.run(100_000_000)
    assert len(nodes.sent) == 200
    assert len({len(nodes.heard["b"]), len(nodes.heard["c"]), 200}) == 3


def test_a_station_that_leaves_sends_nothing_more_and_destroys_its_frame_on_the_wire() -> None:
    nodes = Nodes()
    nodes.bus.offer(nodes.a, LOW)
    nodes.bus.offer(nodes.a, LOW)
    nodes.run(10_000)
    nodes.bus.leave(nodes.a)
    nodes.bus.offer(nodes.a, HIGH)
    nodes.run()
    assert nodes.sent == []


def test_a_station_that_was_bus_off_sends_in_order_what_has_waited_and_what_comes_meanwhile() -> None:
    nodes = Nodes()
    lost, *waiting, late = (Frame(LOW.can_id, bytes((n,))) for n in range(4))
    for frame in (lost, *waiting):
        nodes.bus.offer(nodes.a, frame)
    nodes.bus.turn_off(nodes.a)
    nodes.bus.offer(nodes.a, late)
    nodes.run(1_000_000_000)
    assert [sent.frame for sent in nodes.sent] == [*waiting, late]


def test_a_station_that_was_cut_off_sends_later_what_has_not_expired() -> None:
    nodes = Nodes()
    nodes.bus.wire(nodes.a, cut_off=True)
    nodes.bus.offer(nodes.a, LOW, 50_000_000)
    nodes.bus.offer(nodes.a, HIGH, 5_000_000)
    nodes.bus.offer(nodes.b, HIGH)
    nodes.run()
    assert [(sent.sender, sent.frame) for sent in nodes.sent] == [("b", HIGH)]
    assert nodes.heard["a"] == []
    nodes.bus.wire(nodes.a, cut_off=False)
    nodes.run()
    assert [(sent.sender, sent.frame) for sent in nodes.sent[1:]] == [("a", LOW)]


def test_a_frame_cut_in_the_middle_is_sent_again_when_the_wire_is_mended() -> None:
    nodes = Nodes()
    nodes.bus.offer(nodes.a, LOW)
    nodes.run(10_000)
    nodes.bus.wire(nodes.a, cut_off=True)
    nodes.run()
    assert nodes.sent == []
    nodes.bus.wire(nodes.a, cut_off=False)
    nodes.run()
    assert nodes.heard["b"] == [LOW]


def test_a_station_whose_receiver_has_failed_is_heard() -> None:
    nodes = Nodes(Faults(doubled=1.0))
    nodes.bus.wire(nodes.a, receive_failed=True)
    nodes.bus.offer(nodes.a, LOW)
    nodes.bus.offer(nodes.b, HIGH)
    nodes.run()
    assert nodes.heard["a"] == []
    assert nodes.heard["b"] == [LOW, LOW]


def test_what_is_withdrawn_is_not_sent_but_for_what_the_controller_has() -> None:
    nodes = Nodes()
    nodes.bus.offer(nodes.b, LOW)
    nodes.run(1_000)
    nodes.bus.offer(nodes.a, MIDDLE)
    nodes.bus.offer(nodes.a, LOW)
    nodes.bus.offer(nodes.a, HIGH)
    nodes.bus.withdraw(nodes.a, frozenset({LOW.can_id, MIDDLE.can_id}))
    nodes.run()
    assert [(sent.sender, sent.frame) for sent in nodes.sent] == [("b", LOW), ("a", MIDDLE), ("a", HIGH)]


def test_the_mailbox_holds_one_frame_and_nothing_of_the_same_node_overtakes_it() -> None:
    nodes = Nodes()
    nodes.bus.offer(nodes.b, HIGH)
    nodes.run(1_000)
    for frame in (LOW, MIDDLE, HIGH):
        nodes.bus.offer(nodes.a, frame)
    nodes.bus.offer(nodes.c, MIDDLE)
    nodes.run()
    assert [(sent.sender, sent.frame) for sent in nodes.sent[1:]] == [
        ("c", MIDDLE), ("a", LOW), ("a", HIGH), ("a", MIDDLE)
    ]  # fmt: skip


def test_a_frame_whose_time_is_over_leaves_the_mailbox_for_the_next_one() -> None:
    nodes = Nodes()
    nodes.bus.offer(nodes.b, HIGH)
    nodes.run(1_000)
    nodes.bus.offer(nodes.a, MIDDLE, 10_000)
    nodes.bus.offer(nodes.a, LOW)
    nodes.run()
    assert [sent.frame for sent in nodes.sent] == [HIGH, LOW]


def test_a_processor_that_stands_still_sends_what_its_controller_has_and_no_more() -> None:
    nodes = Nodes()
    nodes.bus.offer(nodes.a, LOW)
    nodes.bus.offer(nodes.a, HIGH)
    nodes.bus.stall(nodes.a, stalled=True)
    nodes.run()
    assert [sent.frame for sent in nodes.sent] == [LOW]
    nodes.bus.stall(nodes.a, stalled=False)
    nodes.run()
    assert [sent.frame for sent in nodes.sent] == [LOW, HIGH]


def test_a_station_whose_transmitter_has_failed_hears_and_sends_later() -> None:
    nodes = Nodes()
    nodes.bus.wire(nodes.a, transmit_failed=True)
    nodes.bus.offer(nodes.a, LOW)
    nodes.bus.offer(nodes.b, HIGH)
    nodes.run()
    assert (nodes.heard["a"], [sent.sender for sent in nodes.sent]) == ([HIGH], ["b"])
    nodes.bus.wire(nodes.a, transmit_failed=False)
    nodes.run()
    assert [sent.sender for sent in nodes.sent] == ["b", "a"]


def test_a_filter_keeps_out_what_a_station_does_not_want() -> None:
    nodes = Nodes()
    nodes.bus.wants(nodes.b, {HIGH.can_id})
    for frame in (LOW, HIGH):
        nodes.bus.offer(nodes.a, frame)
    nodes.run()
    assert (nodes.heard["b"], nodes.heard["c"]) == ([HIGH], [LOW, HIGH])
    nodes.bus.wants(nodes.b, {LOW.can_id})
    nodes.bus.offer(nodes.a, LOW)
    nodes.run()
    assert nodes.heard["b"] == [HIGH, LOW]


def test_a_slow_bus_takes_its_time() -> None:
    nodes = Nodes()
    nodes.bus.slowdown = 5
    nodes.bus.offer(nodes.a, LOW)
    nodes.run()
    assert nodes.sent[0].end_ns == 5 * exact_bits(LOW) * 1000


def test_every_failed_frame_raises_the_error_counters_and_every_sent_one_lowers_them() -> None:
    nodes = Nodes()
    nodes.bus.noisy = 1
    nodes.bus.offer(nodes.a, LOW)
    while nodes.bus.destroyed < 3:
        nodes.run(1_000)
    nodes.bus.noisy = 0
    nodes.run()
    failed = nodes.bus.destroyed
    assert nodes.heard["b"] == [LOW]
    assert (nodes.a.transmit_errors, nodes.b.receive_errors) == (8 * failed - 1, failed - 1)


def test_a_station_that_cannot_send_a_frame_goes_passive_then_bus_off_and_comes_back() -> None:
    nodes = Nodes()
    nodes.a.fails = True
    nodes.bus.offer(nodes.a, HIGH)
    nodes.bus.offer(nodes.a, LOW)
    while nodes.bus.destroyed < 16:
        nodes.run(1_000)
    assert nodes.a.is_passive
    nodes.bus.offer(nodes.b, LOW)  # a passive station lets others go first, however urgent its own frame is
    nodes.run(200_000)
    assert [sent.sender for sent in nodes.sent] == ["b"]
    nodes.run()
    assert (nodes.a.off, nodes.bus.bus_offs, nodes.bus.destroyed) == (True, 1, 32)
    nodes.bus.offer(nodes.b, HIGH)
    nodes.a.fails = False
    nodes.run(200_000_000)
    assert (nodes.a.off, nodes.heard["a"]) == (False, [LOW])  # the station has missed what came while it was off
    assert [sent.frame for sent in nodes.sent if sent.sender == "a"] == [LOW]  # what the controller had is lost


def test_two_stations_with_one_identifier_and_different_data_destroy_each_other_until_one_gives_way() -> None:
    nodes = Nodes()
    other = Frame(LOW.can_id, b"\x7f")
    nodes.bus.offer(nodes.a, LOW)
    nodes.bus.offer(nodes.b, other)
    nodes.run(3_000_000)
    assert len(nodes.bus.clashes) == nodes.bus.destroyed == 32
    assert nodes.sent == []
    assert nodes.a.off
    assert nodes.b.off


def test_what_is_received_may_be_another_frame_than_the_one_sent() -> None:
    nodes = Nodes()
    nodes.bus.corrupt = lambda sent: HIGH if sent.frame == LOW else None
    nodes.bus.offer(nodes.a, LOW)
    nodes.bus.offer(nodes.a, MIDDLE)
    nodes.run()
    assert nodes.heard["b"] == [HIGH, MIDDLE]
    assert [sent.frame for sent in nodes.sent] == [LOW, MIDDLE]


def test_two_stations_that_want_to_send_one_identifier_clash() -> None:
    nodes = Nodes()
    nodes.bus.offer(nodes.a, LOW)
    nodes.bus.offer(nodes.a, LOW)
    nodes.run()
    assert nodes.bus.clashes == []
    nodes.bus.offer(nodes.a, LOW)
    nodes.bus.offer(nodes.b, LOW)
    nodes.run()
    (clash,) = nodes.bus.clashes
    assert (clash.can_id, clash.stations) == (LOW.can_id, ("a", "b"))


def test_one_frame_is_tampered_with_and_no_other() -> None:
    nodes = Nodes()
    nodes.bus.tamper = lambda sent: {HIGH: Tampering(2), LOW: Tampering(0, "b")}.get(sent.frame)
    nodes.bus.offer(nodes.a, LOW)
    nodes.bus.offer(nodes.a, HIGH)
    nodes.run()
    assert nodes.heard == {"a": [], "b": [HIGH, HIGH], "c": [LOW, HIGH, HIGH]}


def test_a_broken_wire_carries_nothing_costs_no_errors_and_what_still_serves_goes_out_when_it_is_mended() -> None:
    nodes = Nodes()
    nodes.bus.offer(nodes.a, LOW)
    nodes.clock.run_until(1_000)  # it is on the wire
    nodes.bus.break_wire()
    nodes.bus.break_wire()
    nodes.bus.offer(nodes.b, HIGH, until_ns=2_000)
    nodes.run()
    nodes.bus.mend_wire()
    nodes.run()
    assert (nodes.sent, nodes.bus.destroyed) == ([], 0)
    nodes.bus.mend_wire()
    nodes.run()
    assert [sent.frame for sent in nodes.sent] == [LOW]
    assert (nodes.a.transmit_errors, nodes.heard["b"]) == (0, [LOW])


def test_the_time_of_one_frame_that_waits_can_be_cut_short() -> None:
    nodes, copies = Nodes(), [Frame(0x300 + number, bytes([number])) for number in range(3)]
    nodes.bus.offer(nodes.b, HIGH)
    for frame in copies:
        nodes.bus.offer(nodes.a, frame)
    nodes.clock.run_until(1_000)
    for frame in (copies[0], copies[2], Frame(*copies[1])):
        nodes.bus.limit(nodes.a, frame, 2_000)
    nodes.run()
    assert [sent.frame for sent in nodes.sent] == [HIGH, copies[1]], "an equal frame is another one"


def test_what_is_on_the_wire_is_sent_to_its_end_and_not_again() -> None:
    nodes = Nodes()
    nodes.bus.offer(nodes.a, LOW)
    nodes.clock.run_until(1_000)
    nodes.bus.limit(nodes.a, LOW, 2_000)
    nodes.run()
    assert [sent.frame for sent in nodes.sent] == [LOW]
    assert nodes.a.mailbox is None
