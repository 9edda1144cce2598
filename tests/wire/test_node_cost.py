"""What a node costs: wake-ups, processor time and the longest turn, in windows."""

from heronry_wire.node_cost import WINDOW_NS, CostMeter, NodeCost

MS = 1_000_000


class Computer:
    """Counts the processor time of an agent and of its partitions, in ns."""

    def __init__(self) -> None:
        self.agent_ns = self.modules_ns = 0


def turns(meter: CostMeter, computer: Computer, begin_ns: int, number: int, *, took_ms: int) -> int:
    """Wake a loop `number` times, every 20 ms, for `took_ms` each; returns the time of the next wake-up."""
    for turn in range(number):
        woke_ns = begin_ns + turn * 20 * MS
        meter.woke(woke_ns)
        computer.agent_ns += took_ms * MS
        meter.waits(woke_ns + took_ms * MS)
    return begin_ns + number * 20 * MS


def meter_of(computer: Computer) -> CostMeter:
    return CostMeter(0, lambda: computer.agent_ns, lambda: computer.modules_ns)


def test_nothing_is_known_before_the_first_window_has_ended() -> None:
    computer = Computer()
    meter = meter_of(computer)
    turns(meter, computer, 0, 100, took_ms=1)
    assert meter.last is None


def test_a_window_has_the_wake_ups_the_shares_and_the_longest_turn() -> None:
    computer = Computer()
    meter = meter_of(computer)
    next_ns = turns(meter, computer, 0, 250, took_ms=1)
    computer.modules_ns = WINDOW_NS // 4
    next_ns = turns(meter, computer, next_ns, 1, took_ms=7)
    turns(meter, computer, next_ns, 260, took_ms=1)
    assert meter.last is not None
    assert meter.last == NodeCost(wake_ups_per_s=50, agent_per_mille=50, modules_per_mille=249, longest_turn_us=7_000)


def test_the_next_window_counts_anew_and_an_ended_partition_takes_nothing_away() -> None:
    computer = Computer()
    meter = meter_of(computer)
    computer.modules_ns = 9 * MS
    next_ns = turns(meter, computer, 0, 501, took_ms=3)
    computer.modules_ns = 0
    turns(meter, computer, next_ns, 501, took_ms=1)
    assert meter.last == NodeCost(wake_ups_per_s=50, agent_per_mille=50, modules_per_mille=0, longest_turn_us=1_000)


def test_people_read_one_line() -> None:
    cost = NodeCost(wake_ups_per_s=310, agent_per_mille=74, modules_per_mille=15, longest_turn_us=2_350)
    assert cost.sentence == "310 wake-ups/s, 7.4 % of a core, its modules 1.5 %, longest turn 2.35 ms"
