"""The response-time analysis against a simulated bus, at critical instants and in any phasing.

A bus is simulated by itself, event by event, without code of the analysis (`heronry_wire.timing`). Its nodes queue
frames of greatest length by priority; the bus carries one at a time, without interruption. Frames have jitter, and a
node with the lowest priority always has a frame of 135 bits to send. Random message sets are run in two ways:

    critical instant   for every message: the longest frame of lower priority has just started, and the message and all
                       of higher priority are queued, each as late after it was due as it may be; then each comes as
                       soon as it may
    any phasing        drawn offsets, and a drawn lateness of every instance

No response may be longer than the bound of the analysis, and at its critical instant each response must reach nine
tenths of the bound. Time is counted in quarters of a bit. A node that has a frame less than a bit time after another
one has taken the bus may still take part in that arbitration, or may not: here a message more urgent than the watched
one does, and the watched one does not. That is why the equations have a whole frame of blocking, and `tau`.

Exit code 1 where a bound is wrong.
"""

import heapq
import itertools
import sys
from argparse import Namespace
from collections.abc import Iterable, Iterator, Sequence
from fractions import Fraction
from random import Random
from typing import NamedTuple

from heronry_wire.timing import WORST_BLOCKING_BITS, Message, analyse
from lab.benches.harness import Benchmark, Report, option

QUARTERS = 4  # of a bit time
REACHED = Fraction(9, 10)
_MOST_INSTANCES = 400  # of a message in one run of any phasing


class Stream(NamedTuple):
    """A message of the simulated bus, in quarters of a bit; the place in a list is its priority."""

    length: int
    period: int
    jitter: int


class Release(NamedTuple):
    """One instance: when it is queued, and when it was due."""

    queued: int
    priority: int
    due: int


class Tally(NamedTuple):
    """The results of some message sets."""

    sets: int
    messages: int  # with a bound
    several: int  # messages of which more than one instance had to be looked at
    exceeded: int  # messages that took longer than their bound
    short: int  # messages whose critical instant stayed below nine tenths of their bound
    least: Fraction  # the least share of a bound that a critical instant reached


def run_bus(
    streams: Sequence[Stream], releases: Iterable[Release], lower: Iterator[tuple[int, int]], watched: int
) -> list[int]:
    """Send all instances; gives the longest response of each stream.

    lower: frames of lower priority, as (not before, length) in order of time; each is sent once where the bus is free
    and nothing else is queued. watched: the stream that loses against what comes within a bit time.
    """
    longest, now = [0] * len(streams), 0
    waiting: list[tuple[int, int]] = []  # priority, and when it was due
    coming = sorted(releases, reverse=True)
    below = next(lower, None)
    while coming or waiting:
        if not waiting and coming[-1].queued > now:
            now = coming[-1].queued if below is None else min(coming[-1].queued, max(now, below[0]))
        for one in _taking_part(coming, now, watched, waiting):
            heapq.heappush(waiting, (one.priority, one.due))
        if waiting:
            priority, due = heapq.heappop(waiting)
            now += streams[priority].length
            longest[priority] = max(longest[priority], now - due)
        else:
            assert below is not None
            now += below[1]
            below = next(lower, None)
    return longest


def _taking_part(coming: list[Release], now: int, watched: int, waiting: Sequence[tuple[int, int]]) -> list[Release]:
    """Remove from `coming`, latest first, the instances that take part in the arbitration of this moment."""
    taken: list[Release] = []
    later: list[Release] = []
    while coming and coming[-1].queued <= now:
        taken.append(coming.pop())
    if watched in {priority for priority, _ in waiting} | {one.priority for one in taken}:
        while coming and coming[-1].queued < now + QUARTERS:
            (taken if coming[-1].priority < watched else later).append(coming.pop())
        coming.extend(reversed(later))
    return taken


def critical_instant(streams: Sequence[Stream], priority: int, blocker: int, until: int) -> int:
    """Return a stream's longest response when all come at once, behind a frame of `blocker` that has just started."""
    instant = 1  # the frame below started just before
    releases = []
    for above in range(priority + 1):
        _, period, jitter = streams[above]
        for number in itertools.count():
            due = instant - jitter + number * period
            if number and due > until:
                break
            releases.append(Release(max(due, instant), above, due))
    return run_bus(streams, releases, iter([(0, blocker)]), priority)[priority]


def any_phasing(streams: Sequence[Stream], blocker: int, random: Random) -> list[int]:
    """Return each stream's longest response with drawn offsets and lateness, above a node that always has a frame."""
    horizon = min(_MOST_INSTANCES * min(s.period for s in streams), 4 * max(s.period for s in streams))
    releases = []
    for priority, (_, period, jitter) in enumerate(streams):
        queued = 0
        for due in range(random.randrange(period), horizon, period):
            queued = max(queued, due + random.choice((0, jitter, random.randint(0, jitter))))
            releases.append(Release(queued, priority, due))
    return run_bus(streams, releases, itertools.repeat((0, blocker)), random.randrange(len(streams)))


def drawn_messages(random: Random) -> list[Message]:
    """Draw 3 to 24 messages that load a bus to between 30 and 90 %, as an aircraft could have them; times in bits."""
    count, bitrate = random.randint(3, 24), random.choice((125_000, 250_000, 500_000, 1_000_000))
    sizes = [random.randint(0, 8) for _ in range(count)]
    lengths = [55 + 10 * size for size in sizes]
    rates = [random.choice((100, 100, 50, 50, 40, 20, 20, 10, 5, 2)) * random.uniform(0.9, 1.1) for _ in range(count)]
    load = sum(length * rate for length, rate in zip(lengths, rates, strict=True)) / bitrate
    faster = random.uniform(0.3, 0.9) / load
    messages = []
    for i, (length, rate) in enumerate(zip(lengths, rates, strict=True)):
        period = round(bitrate / (rate * faster))
        jitter = random.choice((0, 0, 0, random.randint(0, period // 2), random.randint(0, 2 * period)))
        messages.append(Message(f"m{i}", length, period, jitter, period))
    random.shuffle(messages)
    if random.random() < 0.7:
        messages.sort(key=lambda message: message.period)
    return messages


def tried(messages: Sequence[Message], random: Random) -> Tally:
    """Compare the bounds of one message set with the simulated bus."""
    streams = [Stream(QUARTERS * m.bits, QUARTERS * int(m.period), QUARTERS * int(m.jitter)) for m in messages]
    responses = analyse(messages, blocking_bits=WORST_BLOCKING_BITS)
    bounded = [response for response in responses if response.bits is not None]
    seen = any_phasing(streams, QUARTERS * WORST_BLOCKING_BITS, random)
    exceeded = short = 0
    least = Fraction(1)
    for priority, response in enumerate(bounded):
        assert response.bits is not None
        bound = response.bits * QUARTERS
        below = max([QUARTERS * WORST_BLOCKING_BITS, *(s.length for s in streams[priority + 1 :])])
        until = response.instances * streams[priority].period + int(bound)
        reached = critical_instant(streams, priority, below, until)
        exceeded += reached > bound or seen[priority] > bound
        short += reached < REACHED * bound
        least = min(least, reached / bound)
    several = sum(response.instances > 1 for response in bounded)
    return Tally(1, len(bounded), several, exceeded, short, least)


def try_sets(sets: int, seed: int) -> Tally:
    """Compare the bounds of drawn message sets with the simulated bus."""
    found = [tried(drawn_messages(random), random) for random in (Random(f"{seed}/{i}") for i in range(sets))]
    return Tally(
        sets,
        messages=sum(one.messages for one in found),
        several=sum(one.several for one in found),
        exceeded=sum(one.exceeded for one in found),
        short=sum(one.short for one in found),
        least=min((one.least for one in found), default=Fraction(1)),
    )


def worked_example() -> Iterator[str]:
    """The counterexample of Davis et al. 2007 section 3.1: three messages of 1 ms at 125 kbit/s."""
    ms = 125
    messages = [
        Message("A", ms, Fraction(5, 2) * ms, 0, Fraction(5, 2) * ms),
        Message("B", ms, Fraction(7, 2) * ms, 0, Fraction(13, 4) * ms),
        Message("C", ms, Fraction(7, 2) * ms, 0, Fraction(13, 4) * ms),
    ]
    streams = [Stream(QUARTERS * m.bits, int(QUARTERS * m.period), 0) for m in messages]
    for priority, response in enumerate(analyse(messages)):
        below = max((s.length for s in streams[priority + 1 :]), default=0)
        seen = critical_instant(streams, priority, below, 40 * ms)
        verdict = "meets its deadline" if response.meets_deadline else "misses its deadline"
        assert response.bits is not None
        yield (
            f"  {response.name}: at most {float(response.bits / ms):g} ms, seen {seen / QUARTERS / ms:g} ms, {verdict} "
            f"of {float(messages[priority].deadline / ms):g} ms"
        )


def measure(arguments: Namespace, report: Report) -> None:
    """Compare the analysis with the simulated bus, and report the figures."""
    report.lines(["Davis et al. 2007, 125 kbit/s:", *worked_example()])
    tally = try_sets(arguments.sets, arguments.seed)
    report.figures(
        "{sets} message sets, {messages} messages with a bound, {several} with several instances:\n"
        "  longer than the analysis says: {exceeded}\n"
        "  below {reached:.0%} of it at the critical instant: {short}\n"
        "  least share reached: {least:.1%}",
        **{**tally._asdict(), "least": float(tally.least)},
        reached=float(REACHED),
    )
    report.require(tally.exceeded == tally.short == 0)


main = Benchmark(
    "bus",
    __doc__,
    measure,
    option("--sets", 100, "random message sets"),
    option("--seed", 0, "from which they are drawn"),
)
if __name__ == "__main__":
    sys.exit(main())
