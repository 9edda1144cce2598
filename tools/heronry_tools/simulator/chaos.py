"""Acts drawn from a seed: swarm testing, aimed at the states of the protocol that are hard to hit.

A run does not draw from all kinds of faults alike: each seed first draws which kinds there are at all, about half of
them, and how often each comes. So some runs are all restarts and others all noise, and what one kind would hide another
run shows.

Most acts wait for a state of the protocol, since a reconfiguration lasts for milliseconds and the time between two of
them for seconds. How often each state is drawn (`AIM`) makes up for how seldom it is hit: the shorter it lasts, and the
fewer faults lead there, the more. These numbers were read off the tables of campaigns (`campaign.Coverage`) and are
the same for every seed, so that a seed flies alone as it did in its campaign.

An act that waits for anything but rest brings along what leads there: a PE is lost and comes back, so that the protocol
goes through all of its states; another one than the act strikes, or there would be nothing left to strike. Where
something exclusive must be given up (`activating`) it is a PE that a DEMUX may be driven from.
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
_WAITS_FOR_STATE = 0.85
AIM = {"idle": 1, "suspect": 4, "planning": 3, "preparing": 4, "activating": 5, "going": 4, "rejoining": 3}
_LEADS = (("crash", (200, 900)), ("cut", (70, 400)), ("reboot", (1, 60)))
_LEADS_APART_MS = 1200  # before a second one, where the first has not led there
_MANAGERS_ALONE = 0.05  # of the seeds: their silence must stop nobody
_LAST = 0.9  # of the chaos: what strikes later would be healed at once


def drawn_acts(spec: Spec, seed: int, seconds: float, kinds: Sequence[str] = ()) -> tuple[Act, ...]:
    """Draw the acts of a seed, of these kinds or of whichever the seed likes; times are in whole milliseconds."""
    random = Random(f"acts of {seed}")
    there = {name: targets for name in KINDS if (targets := possible_targets(spec, name))}
    swarm = [name for name in there if _takes_part(name, kinds, random)] or ["crash"]
    alone = not kinds and random.random() < _MANAGERS_ALONE
    if alone:
        swarm = [name for name in there if KINDS[name].strikes == MANAGER and KINDS[name].drawn]
    weights = [random.choice((1, 1, 2, 5)) for _ in swarm]
    aim = _aim(spec)
    acts: set[Act] = set()
    for_good = 0
    for name in random.choices(swarm, weights, k=max(_FEWEST_ACTS, round(ACTS_PER_S * seconds))):
        act = _drawn_act(random, name, there[name], seconds, aim)
        if not act.lasts_ms and KINDS[name].for_good:
            for_good += 1
            if for_good > _MOST_FOR_GOOD:
                continue
        acts.add(act)
        if act.during not in ("", "idle") and not alone:
            acts.update(_leading_there(random, spec, act))
    return tuple(sorted(acts))


def _leading_there(random: Random, spec: Spec, act: Act) -> list[Act]:
    """Draw losses, and returns, that make the protocol work while an act waits."""
    others = [f"pe:{pe}" for pe in spec.pes if f"pe:{pe}" != act.target] or [f"pe:{pe}" for pe in spec.pes]
    if act.during == "activating":
        others = [pe for pe in others if pe in _rivals(spec)] or others
    times_ms = (act.at_ms, act.at_ms + _LEADS_APART_MS) if act.during == "activating" else (act.at_ms,)
    leads = []
    for at_ms in times_ms:
        kind, lasts_ms = random.choice(_LEADS[: 2 if act.during == "suspect" else 3])  # a reboot is not waited for
        leads.append(Act(at_ms, kind, random.choice(others), random.randint(*lasts_ms)))
    return leads


def _rivals(spec: Spec) -> set[str]:
    """PEs of DEMUXes that can be driven from several."""
    rivals: set[str] = set()
    for demux in spec.demuxes.values():
        devices = (spec.modules[branch].device for branch in demux.branches)
        homes = {f"pe:{spec.devices[device].pe}" for device in devices if device is not None}
        rivals |= homes if len(homes) > 1 else set()
    return rivals


def _aim(spec: Spec) -> list[int]:
    """How often each state is drawn: one that this spec does not know, not at all."""
    return [0 if state == "activating" and not _rivals(spec) else AIM[state] for state in STATES]


def _takes_part(name: str, kinds: Sequence[str], random: Random) -> bool:
    drawn = random.random() < _KIND_THERE
    return name in kinds if kinds else drawn and KINDS[name].drawn


def _drawn_act(random: Random, name: str, targets: list[str], seconds: float, aim: list[int]) -> Act:
    kind = KINDS[name]
    shortest, longest = kind.lasts_ms
    at_ms = random.randrange(max(1, round(1000 * _LAST * seconds)))
    lasts_ms = random.randint(shortest, random.randint(shortest, longest))  # the short ones more often
    if random.random() < kind.for_good:
        lasts_ms = 0
    during = random.choices(STATES, aim)[0] if random.random() < _WAITS_FOR_STATE else ""
    return Act(at_ms, name, random.choice(targets), lasts_ms, during, random.choice(kind.levels))
