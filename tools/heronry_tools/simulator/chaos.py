"""Acts drawn from a seed: swarm testing.

A run does not draw from all kinds of faults alike: each seed first draws which kinds there are at all, about half of
them, and how often each comes. So some runs are all restarts and others all noise, and what one kind would hide another
run shows. Six acts in ten wait for a state of the protocol, all states alike, since a reconfiguration lasts for
milliseconds and the time between two of them for seconds. One that waits for anything but rest brings along another
fault that leads there: a PE that dies and comes back goes through all of them.
"""

from collections.abc import Sequence
from random import Random

from heronry_dg.model import Spec
from heronry_tools.simulator.act import KINDS, MANAGER, Act, possible_targets
from heronry_tools.simulator.protocol_state import STATES

ACTS_PER_S = 0.25
_FEWEST_ACTS = 3
_MOST_FOR_GOOD = 4
_KIND_THERE = 0.5
_WAITS_FOR_STATE = 0.6
_MANAGERS_ALONE = 0.05  # of the seeds: their silence must stop nobody
_LAST = 0.9  # of the chaos: what strikes later would be healed at once


def drawn_acts(spec: Spec, seed: int, seconds: float, kinds: Sequence[str] = ()) -> tuple[Act, ...]:
    """Draw the acts of a seed, of these kinds or of whichever the seed likes; times are in whole milliseconds."""
    random = Random(f"acts of {seed}")
    there = {name: targets for name in KINDS if (targets := possible_targets(spec, name))}
    swarm = [name for name in there if _takes_part(name, kinds, random)] or ["crash"]
    alone = not kinds and random.random() < _MANAGERS_ALONE
    if alone:
        swarm = [name for name in there if KINDS[name].strikes == MANAGER]
    weights = [random.choice((1, 1, 2, 5)) for _ in swarm]
    acts: set[Act] = set()
    for_good = 0
    for name in random.choices(swarm, weights, k=max(_FEWEST_ACTS, round(ACTS_PER_S * seconds))):
        act = _drawn_act(random, name, there[name], seconds)
        if not act.lasts_ms and KINDS[name].for_good:
            for_good += 1
            if for_good > _MOST_FOR_GOOD:
                continue
        acts.add(act)
        if act.during not in ("", "idle") and not alone:
            acts.add(_leading_there(random, spec, act.at_ms))
    return tuple(sorted(acts))


def _leading_there(random: Random, spec: Spec, at_ms: int) -> Act:
    """Draw a loss that makes the protocol work at this time, and a return."""
    kind, lasts_ms = random.choice((("crash", (200, 900)), ("cut", (70, 400)), ("reboot", (1, 60))))
    return Act(at_ms, kind, f"pe:{random.choice(list(spec.pes))}", random.randint(*lasts_ms))


def _takes_part(name: str, kinds: Sequence[str], random: Random) -> bool:
    drawn = random.random() < _KIND_THERE
    return name in kinds if kinds else drawn and KINDS[name].drawn


def _drawn_act(random: Random, name: str, targets: list[str], seconds: float) -> Act:
    kind = KINDS[name]
    shortest, longest = kind.lasts_ms
    at_ms = random.randrange(max(1, round(1000 * _LAST * seconds)))
    lasts_ms = random.randint(shortest, random.randint(shortest, longest))  # the short ones more often
    if random.random() < kind.for_good:
        lasts_ms = 0
    during = random.choice(STATES) if random.random() < _WAITS_FOR_STATE else ""
    return Act(at_ms, name, random.choice(targets), lasts_ms, during, random.choice(kind.levels))
