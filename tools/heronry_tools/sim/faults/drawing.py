"""Draws the faults of a flight from a seed: swarm testing, aimed at protocol states that are hard to hit.

*Kinds.* A seed first draws which kinds of faults its flight has, about half of all kinds, and how often each occurs. So
one flight may have only restarts and another only noise, and no kind always hides the effect of another.

*States.* A reconfiguration takes milliseconds, and the time between two reconfigurations is seconds. So most faults
wait for a state of the protocol (`protocol_state`). A state that lasts for a shorter time is drawn more often (`_AIM`).
The state *idle* has the lowest weight, since most faults that wait for no state are injected in it. The weights were
chosen with the tables of campaigns (`campaign.Coverage`). They are the same for every seed, so that a seed flown alone
gives the same flight as in a campaign.

*Leading to a state.* For a fault that waits for a state other than idle, further faults are drawn that lead to this
state:

    in general    a PE other than the target is lost and returns, so that the protocol goes through all states
    orphaned      the active manager is lost, which ends its mastership
    activating    a PE must have an exclusive output to release. So the PE is cut off, and when it counts as lost, the
                  mastership ends. The PE returns with its old epoch, which the next manager does not know, and with the
                  outputs of this epoch. If several PEs can drive one DEMUX, the loss of one of them is enough

*Two managers.* Faults of managers are drawn more often. Their target is the active, the primary or the standby manager.
The kinds that need two managers (`Kind.of_two`) are drawn as well.

*Apart.* A kind that only some specs have a target for may be drawn apart (`Kind.drawn_apart`): with chances of its own,
in half of the flights, beside the faults that the seed draws anyway.

*With a key.* The kinds for such flights (`Kind.of_keyed`) are drawn in every flight with a key, and more often than
others.
"""

from collections.abc import Iterator, Sequence
from random import Random

from heronry_dg.model import Spec
from heronry_tools.sim.faults.fault import KINDS, MANAGER, Fault, drawn_kinds, possible_targets

_FAULTS_PER_S = 0.4
_FEWEST_FAULTS = 3
_MOST_FOR_GOOD = 4
_KIND_THERE = 0.5
_WAITS_FOR_STATE = 0.92
_AIM = {
    "suspect": 5,
    "planning": 5,
    "preparing": 8,
    "activating": 12,
    "going": 9,
    "rejoining": 2,
    "orphaned": 5,
    "idle": 1,
}
_WHICH_MANAGER = (MANAGER, MANAGER, "primary", "standby")
_MANAGERS_MORE = 2  # times as often as any other kind
_LATCHED_MORE = 3  # times as often, since a drawn order to clear mostly comes when nothing is latched
_KEYED_MORE = 4  # times as often, since few flights have a key
_END_OF_MASTERSHIP = (("manager_crash", (150, 900)), ("manager_pause", (150, 500)), ("manager_cut", (150, 600)))
_SILENCES = (("crash", (200, 900)), ("cut", (70, 400)))
_LEADS = (*_SILENCES, ("reboot", (1, 60)))  # a reboot is over before the manager misses the PE
_LEADS_APART_MS = 1200  # from the first loss to a second one, drawn in case the first does not lead to the state
_BY_DEMUX = 0.7  # share of the leads to "activating" that use a DEMUX, where the spec has one
_LOST_AFTER_MS = 200  # a PE that is cut off is lost by then
_CUT_ACROSS_MASTERSHIPS_MS = (300, 900)
_BETWEEN_MASTERSHIPS_MS = (100, 300)
_MANAGERS_ALONE = 0.05  # share of the seeds with faults of managers only, for the oracle `silence`
_APART_PER_S = 0.1  # faults of each kind that is drawn apart
_LAST = 0.9  # share of the flight in which faults are injected; a later fault would be ended immediately


def drawn_faults(
    spec: Spec, seed: int, seconds: float, kinds: Sequence[str] = (), *, of_two: bool = False, keyed: bool = False
) -> tuple[Fault, ...]:
    """Draw the faults of a flight from its seed; times are in whole milliseconds.

    kinds: the kinds to draw from; if empty, the seed decides on the kinds, too
    of_two: whether there are two managers
    keyed: whether managers and PEs have a key
    """
    random = Random(f"acts of {seed}")
    drawn = drawn_kinds(spec, of_two=of_two, keyed=keyed)
    there = _kinds_there(spec, kinds or [name for name in drawn if not KINDS[name].drawn_apart], of_two=of_two)
    swarm = [
        name for name in there if kinds or _is_for_keyed(name, of_two=of_two) or random.random() < _KIND_THERE
    ] or ["crash"]
    alone = not kinds and random.random() < _MANAGERS_ALONE
    if alone:
        swarm = [name for name in there if KINDS[name].target_kind == MANAGER]
    weights = [random.choice((1, 1, 2, 5)) * _more_often(name, of_two=of_two) for name in swarm]
    faults: set[Fault] = set()
    for_good = 0
    count = max(_FEWEST_FAULTS, round(_FAULTS_PER_S * seconds))
    for name in random.choices(swarm, weights, k=count):
        fault = _drawn_fault(random, name, there[name], seconds)
        if not fault.lasts_ms and KINDS[name].for_good:
            for_good += 1
            if for_good > _MOST_FOR_GOOD:
                continue
        faults.add(fault)
        faults.update(_leads(random, spec, fault, of_two=of_two, alone=alone))
    if not kinds and not alone:
        apart = [name for name in drawn if KINDS[name].drawn_apart]
        faults.update(_drawn_apart(Random(f"apart of {seed}"), spec, apart, seconds, of_two=of_two))
    return tuple(sorted(faults))


def _drawn_apart(random: Random, spec: Spec, kinds: Sequence[str], seconds: float, *, of_two: bool) -> Iterator[Fault]:
    """Draw the faults of kinds that are drawn apart; each kind is there in half of the flights."""
    for name in kinds:
        if random.random() < _KIND_THERE:
            for _ in range(max(1, round(_APART_PER_S * seconds))):
                fault = _drawn_fault(random, name, possible_targets(spec, name), seconds)
                yield fault
                yield from _leads(random, spec, fault, of_two=of_two)


def _kinds_there(spec: Spec, kinds: Sequence[str], *, of_two: bool) -> dict[str, list[str]]:
    """Return the kinds of faults that have a target in the spec, each with its targets."""
    there = {name: targets for name in kinds if (targets := possible_targets(spec, name))}
    return {name: list(_WHICH_MANAGER) if of_two and t == [MANAGER] else t for name, t in there.items()}


def _more_often(name: str, *, of_two: bool) -> int:
    kind = KINDS[name]
    if _is_for_keyed(name, of_two=of_two):
        return _KEYED_MORE
    return (
        _LATCHED_MORE
        if kind.target_kind == "latched"
        else _MANAGERS_MORE
        if of_two and kind.target_kind == MANAGER
        else 1
    )


def _is_for_keyed(name: str, *, of_two: bool) -> bool:
    """Tell whether a kind of fault is drawn as one of those that need a key."""
    # one that needs two managers as well is drawn as such in a flight that has two
    return KINDS[name].of_keyed and not (of_two and KINDS[name].of_two)


def _ending_mastership(random: Random, at_ms: int, *, of_two: bool) -> Fault:
    """Draw a fault that ends the mastership of the active manager."""
    kind, lasts_ms = random.choice([end for end in _END_OF_MASTERSHIP if of_two or KINDS[end[0]].drawn])
    return Fault(at_ms, kind, MANAGER, random.randint(*lasts_ms))


def _leads(random: Random, spec: Spec, fault: Fault, *, of_two: bool, alone: bool = False) -> list[Fault]:
    """Draw the faults that lead to the state for which `fault` waits; `alone`: only faults of managers."""
    if fault.during == "orphaned":
        return [_ending_mastership(random, fault.at_ms, of_two=of_two)]
    return [] if fault.during in ("", "idle") or alone else _leading_there(random, spec, fault)


def _leading_there(random: Random, spec: Spec, fault: Fault) -> list[Fault]:
    """Draw faults that bring the protocol into the state for which `fault` waits.

    In each of these faults a PE crashes, reboots or is cut off, and then returns. For the state activating, a
    crash of the manager may be drawn as well.
    """
    others = [f"pe:{pe}" for pe in spec.pes if f"pe:{pe}" != fault.target] or [f"pe:{pe}" for pe in spec.pes]
    if fault.during != "activating":
        return [_loss(random, fault.at_ms, others, _SILENCES if fault.during == "suspect" else _LEADS)]
    rivals = [pe for pe in others if pe in _rivals(spec)]
    if rivals and random.random() < _BY_DEMUX:
        return [_loss(random, fault.at_ms + later_ms, rivals, _LEADS) for later_ms in (0, _LEADS_APART_MS)]
    lost_ms = fault.at_ms + _LOST_AFTER_MS
    return [
        Fault(fault.at_ms, "cut", random.choice(others), random.randint(*_CUT_ACROSS_MASTERSHIPS_MS)),
        Fault(lost_ms, "manager_crash", MANAGER, random.randint(*_BETWEEN_MASTERSHIPS_MS)),
    ]


def _loss(random: Random, at_ms: int, pes: Sequence[str], leads: Sequence[tuple[str, tuple[int, int]]]) -> Fault:
    """Draw a fault at `at_ms` by which one PE is lost.

    pes: the PEs from which one is drawn, each as `pe:NAME`.
    leads: the kinds of faults from which one is drawn, each with its shortest and its longest duration in ms.
    """
    kind, lasts_ms = random.choice(leads)
    return Fault(at_ms, kind, random.choice(pes), random.randint(*lasts_ms))


def _rivals(spec: Spec) -> set[str]:
    """Return the PEs that share a DEMUX with another PE, each as `pe:NAME`.

    A DEMUX counts if its branches and ends have devices on more than one PE. All PEs with these devices are returned.
    """
    rivals: set[str] = set()
    for demux in spec.demuxes.values():
        devices = (spec.modules[branch].device for branch in (*demux.branches, *demux.to))
        homes = {f"pe:{spec.devices[device].pe}" for device in devices if device is not None}
        rivals |= homes if len(homes) > 1 else set()
    return rivals


def _drawn_fault(random: Random, name: str, targets: list[str], seconds: float) -> Fault:
    kind = KINDS[name]
    shortest, longest = kind.lasts_ms
    at_ms = random.randrange(max(1, round(1000 * _LAST * seconds)))
    lasts_ms = random.randint(shortest, random.randint(shortest, longest))  # short times more often
    if random.random() < kind.for_good:
        lasts_ms = 0
    during = random.choices(list(_AIM), list(_AIM.values()))[0] if random.random() < _WAITS_FOR_STATE else ""
    return Fault(at_ms, name, random.choice(targets), lasts_ms, during, random.choice(kind.levels))
