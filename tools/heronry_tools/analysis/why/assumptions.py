"""All that could keep a function from being served, as a list of assumptions that can be relaxed.

An assumption that is *relaxed* no longer holds: an element is up again, or has its whole capacity, a capacity is
unlimited, a placement rule is gone, deadlines are gone, or another function need not be served. `relaxed` changes the
question accordingly: the spec, the elements that are down or limited, and the functions that must be served. The
planner answers the changed question.
"""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Final, Literal

from heronry_dg.model import Bus, Pe, Spec
from heronry_dg.situation import checked_element
from heronry_tools.analysis.servable import PLENTY, without_deadlines

Kind = Literal[
    "down", "limit", "cpu", "ram", "flash", "bandwidth", "deadlines", "separate", "together", "actuator", "function"
]
CAPACITIES: Final[tuple[Kind, ...]] = ("cpu", "ram", "flash", "bandwidth")
MENDABLE: Final[tuple[Kind, ...]] = ("down", "limit", *CAPACITIES)


@dataclass(frozen=True, slots=True)
class Assumption:
    """One assumption that could be relaxed.

    name: what the assumption is about. It depends on the kind:

        down                 the element
        limit                the element that has less than its capacity
        cpu, ram, flash      the PE
        bandwidth            the bus
        separate, together   the index of the placement rule
        actuator             the actuator that has several drivers, of which at most one may run
        function             the function
        deadlines            empty
    """

    kind: Kind
    name: str


@dataclass(frozen=True, slots=True)
class Question:
    """The question whether all functions in `least` can be served together.

    down: the elements that are down.
    limits: by element, the share of its capacity that is left.
    least: by function, the least value with which the function must be served.
    """

    spec: Spec
    down: frozenset[str]
    limits: Mapping[str, Fraction]
    least: Mapping[str, int]


def assumptions(question: Question, goal: str) -> list[Assumption]:
    """List what may keep the function `goal` from being served, the least likely explanation first."""
    return list(_assumptions(question, goal))


def _assumptions(question: Question, goal: str) -> Iterator[Assumption]:
    spec = question.spec
    yield from (Assumption("function", name) for name in question.least if name != goal)
    yield from (Assumption("separate", str(number)) for number in range(len(spec.separate)))
    yield from (Assumption("together", str(number)) for number in range(len(spec.together)))
    yield from (Assumption("actuator", name) for name in spec.drivers_of_one_actuator())
    yield Assumption("deadlines", "")
    yield from (Assumption("bandwidth", name) for name in spec.buses)
    for pe in spec.pes:
        yield from (Assumption("flash", pe), Assumption("ram", pe), Assumption("cpu", pe))
    yield from (Assumption("limit", element) for element in sorted(question.limits))
    yield from (Assumption("down", element) for element in sorted(question.down))


def relaxed(question: Question, without: Collection[Assumption]) -> Question:
    """Return the question that remains if the assumptions in `without` are relaxed.

    A relaxed capacity becomes unlimited. A relaxed placement rule no longer holds, nor does the rule that an actuator
    has one driver; the assumption `deadlines`
    stands for all deadlines, which then no longer hold. A relaxed element is not down, and a relaxed function
    need not be served.
    """
    names: dict[Kind, set[str]] = {}
    for one in without:
        names.setdefault(one.kind, set()).add(one.name)

    def gone(kind: Kind) -> set[str]:
        return names.get(kind, set())

    spec = without_deadlines(question.spec) if gone("deadlines") else question.spec
    return Question(
        spec=replace(
            spec,
            pes={
                name: _endless(pe, [kind for kind in CAPACITIES if name in gone(kind)]) for name, pe in spec.pes.items()
            },
            buses={
                name: replace(bus, bitrate=PLENTY) if name in gone("bandwidth") else bus
                for name, bus in spec.buses.items()
            },
            separate=_others(spec.separate, gone("separate")),
            together=_others(spec.together, gone("together")),
            devices={
                name: replace(device, kind="sensor")
                if name in gone("actuator")
                else device  # a sensor has many readers
                for name, device in spec.devices.items()
            },
        ),
        down=question.down - gone("down"),
        limits={name: share for name, share in question.limits.items() if name not in gone("limit")},
        least={name: value for name, value in question.least.items() if name not in gone("function")},
    )


def _endless(pe: Pe, kinds: Collection[Kind]) -> Pe:
    return replace(
        pe,
        cpu_millis=PLENTY if "cpu" in kinds else pe.cpu_millis,
        ram=PLENTY if "ram" in kinds else pe.ram,
        flash=PLENTY if "flash" in kinds else pe.flash,
    )


def _others(rules: tuple[tuple[str, ...], ...], gone: Collection[str]) -> tuple[tuple[str, ...], ...]:
    return tuple(group for number, group in enumerate(rules) if str(number) not in gone)


def capacity(spec: Spec, one: Assumption) -> int:
    """Return the amount of the capacity that an assumption is about.

    The unit is thousandths of a core for CPU, bytes for RAM and flash, and bit/s for the bit rate of a bus.
    Raises ValueError if the assumption is not about a capacity.
    """
    match one.kind:
        case "bandwidth":
            return spec.buses[one.name].bitrate
        case "cpu":
            return spec.pes[one.name].cpu_millis
        case "ram":
            return spec.pes[one.name].ram
        case "flash":
            return spec.pes[one.name].flash
        case _:
            raise ValueError(f"{one.kind} is no capacity")


def with_capacity(spec: Spec, one: Assumption, amount: int) -> Spec:
    """Return the spec with the capacity that an assumption is about changed to `amount`.

    amount: thousandths of a core, bytes, or bit/s, as `capacity` gives it.
    """
    if one.kind == "bandwidth":
        bus: Bus = replace(spec.buses[one.name], bitrate=amount)
        return replace(spec, buses={**spec.buses, one.name: bus})
    pe = spec.pes[one.name]
    changed = replace(
        pe,
        cpu_millis=amount if one.kind == "cpu" else pe.cpu_millis,
        ram=amount if one.kind == "ram" else pe.ram,
        flash=amount if one.kind == "flash" else pe.flash,
    )
    return replace(spec, pes={**spec.pes, one.name: changed})


def in_words(spec: Spec, one: Assumption) -> str:
    """Write an assumption as a sentence for the user."""
    match one.kind:
        case "down" | "limit":
            what = "is down" if one.kind == "down" else "has less than its capacity"
            return f"{checked_element(spec, one.name)} {what}"
        case "cpu":
            return f"pe {one.name} has {capacity(spec, one) / 1000:g} cores"
        case "ram" | "flash":
            return f"pe {one.name} has {capacity(spec, one)} bytes of {one.kind.replace('ram', 'RAM')}"
        case "bandwidth":
            return f"bus {one.name} carries {capacity(spec, one)} bit/s"
        case "actuator":
            return f"one module alone may drive {one.name}"
        case "deadlines":
            return "data must arrive in time"
        case "separate":
            return f"{' and '.join(spec.separate[int(one.name)])} must not share a PE"
        case "together":
            return f"{' and '.join(spec.together[int(one.name)])} must share a PE"
        case "function":
            return f"{one.name} is served, and comes first"
