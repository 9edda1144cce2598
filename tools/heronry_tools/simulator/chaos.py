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
something exclusive must be given up (`activating`) it is a PE that a DEMUX may be driven from; where a reign must end
(`orphaned`) it is the manager that reigns.

Where there are two managers they are struck more often than anything else, either of them or whichever reigns, and with
what needs two of them (`Kind.of_two`). There is more to strike then, so there are more acts.
"""

from collections.abc import Sequence
from random import Random

from heronry_dg.model import Spec
from heronry_tools.simulator.act import KINDS, MANAGER, Act, drawn_kinds, possible_targets
from heronry_tools.simulator.protocol_state import STATES

ACTS_PER_S = 0.25
_ACTS_PER_S_OF_TWO = 0.35
_FEWEST_ACTS = 3
_MOST_FOR_GOOD = 4
_KIND_THERE = 0.5
_WAITS_FOR_STATE = 0.85
AIM = {"idle": 1, "suspect": 4, "planning": 3, "preparing": 4, "activating": 5, "going": 4, "rejoining": 3}
_AIM_OF_TWO = AIM | {"planning": 4, "preparing": 5, "going": 8, "rejoining": 2, "orphaned": 4}
_WHICH_MANAGER = (MANAGER, MANAGER, "primary", "standby")
_MANAGERS_MORE = 3  # times as often as anything else
_END_OF_REIGN = (("manager_crash", (150, 900)), ("manager_pause", (150, 500)), ("manager_cut", (150, 600)))
_LEADS = (("crash", (200, 900)), ("cut", (70, 400)), ("reboot", (1, 60)))
_LEADS_APART_MS = 1200  # before a second one, where the first has not led there
_MANAGERS_ALONE = 0.05  # of the seeds: their silence must stop nobody
_LAST = 0.9  # of the chaos: what strikes later would be healed at once


def drawn_acts(
    spec: Spec, seed: int, seconds: float, kinds: Sequence[str] = (), *, of_two: bool = False
) -> tuple[Act, ...]:
    """Draw the acts of a seed, of these kinds or of whichever the seed likes; times are in whole milliseconds.

    of_two: there are two managers.
    """
    random = Random(f"acts of {seed}")
    there = _kinds_there(spec, kinds, of_two=of_two)
    swarm = [name for name in there if kinds or random.random() < _KIND_THERE] or ["crash"]
    alone = not kinds and random.random() < _MANAGERS_ALONE
    if alone:
        swarm = [name for name in there if KINDS[name].strikes == MANAGER]
    weights = [random.choice((1, 1, 2, 5)) * _more_often(name, of_two=of_two) for name in swarm]
    aim = _aim(spec, of_two=of_two)
    acts: set[Act] = set()
    for_good = 0
    count = max(_FEWEST_ACTS, round((_ACTS_PER_S_OF_TWO if of_two else ACTS_PER_S) * seconds))
    for name in random.choices(swarm, weights, k=count):
        act = _drawn_act(random, name, there[name], seconds, aim)
        if not act.lasts_ms and KINDS[name].for_good:
            for_good += 1
            if for_good > _MOST_FOR_GOOD:
                continue
        acts.add(act)
        if act.during == "orphaned":
            acts.add(_ending_reign(random, act.at_ms))
        elif act.during not in ("", "idle") and not alone:
            acts.update(_leading_there(random, spec, act))
    return tuple(sorted(acts))


def _kinds_there(spec: Spec, kinds: Sequence[str], *, of_two: bool) -> dict[str, list[str]]:
    """Kinds of faults that may be drawn, and what they may strike."""
    asked = kinds or drawn_kinds(spec, of_two=of_two)
    there = {name: targets for name in asked if (targets := possible_targets(spec, name))}
    return {name: list(_WHICH_MANAGER) if of_two and t == [MANAGER] else t for name, t in there.items()}


def _more_often(name: str, *, of_two: bool) -> int:
    return _MANAGERS_MORE if of_two and KINDS[name].strikes == MANAGER else 1


def _ending_reign(random: Random, at_ms: int) -> Act:
    """Draw what lets the other manager take over."""
    kind, lasts_ms = random.choice(_END_OF_REIGN)
    return Act(at_ms, kind, MANAGER, random.randint(*lasts_ms))


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


def aimed_at(spec: Spec, *, of_two: bool) -> frozenset[str]:
    """States that acts wait for."""
    return frozenset(state for state, often in zip(STATES, _aim(spec, of_two=of_two), strict=True) if often)


def _aim(spec: Spec, *, of_two: bool) -> list[int]:
    """How often each state is drawn: one that this spec does not know, not at all."""
    aim = _AIM_OF_TWO if of_two else AIM
    return [0 if state == "activating" and not _rivals(spec) else aim.get(state, 0) for state in STATES]


def _drawn_act(random: Random, name: str, targets: list[str], seconds: float, aim: list[int]) -> Act:
    kind = KINDS[name]
    shortest, longest = kind.lasts_ms
    at_ms = random.randrange(max(1, round(1000 * _LAST * seconds)))
    lasts_ms = random.randint(shortest, random.randint(shortest, longest))  # the short ones more often
    if random.random() < kind.for_good:
        lasts_ms = 0
    during = random.choices(STATES, aim)[0] if random.random() < _WAITS_FOR_STATE else ""
    return Act(at_ms, name, random.choice(targets), lasts_ms, during, random.choice(kind.levels))
