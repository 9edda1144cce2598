"""DG5xx: checks what a spec puts on its buses: standard identifiers, bit rates, limits of the wire, and arbitration.

A variable with a standard identifier is compared with CANaerospace's list, and the bit rate of a wired bus with those
of CiA 301. The arbitration is checked for less critical data that make data of class A or B late.

The check needs no solver. The plan decides later which frames are sent. So for the arbitration the check assumes that
every frame that some configuration could put on a bus is sent, at its fastest rate. On a bus behind a gateway, the
response time of a forwarded frame is counted from its arrival at the gateway.

To add a rule, define it in rules/wire.py, write a function `_thing(subject, findings)` here, and call it in `check`.
"""

from collections.abc import Mapping
from typing import Final

from heronry_dg.check.checkpoints import check_checkpoints
from heronry_dg.check.subject import Subject
from heronry_dg.field_types import CRITICALITIES
from heronry_dg.findings import Findings, listed, shown
from heronry_dg.model import Spec
from heronry_dg.own_identifiers import own_identifiers, possible_hops
from heronry_dg.response_times import Response, ResponseTimes
from heronry_dg.rules import wire as rules
from heronry_dg.traffic import Hop, criticality_ranks
from heronry_dg.wire_limits import exceeded
from heronry_wire.canopen_objects import BIT_RATES
from heronry_wire.identifiers import ALLOCATED_DATA_IDS
from heronry_wire.standard_identifiers import StandardIdentifier, standard_identifier

_SAME_UNIT: Final[Mapping[str, tuple[str, ...]]] = {  # unit in the list: other spellings of the same unit
    "volt": ("V", "volts"),
    "ampere": ("A", "amp", "amperes"),
    "deg": ("°", "degree", "degrees"),
    "deg/s": ("°/s", "degrees/s"),
    "1/min": ("rpm", "RPM", "min-1", "min^-1"),
    "hPa": ("mbar", "mb"),
    "l": ("L", "litre", "liter"),
    "l/h": ("L/h",),
    "min": ("minute", "minutes"),
    "K": ("kelvin",),
    "KHz": ("kHz",),
    "Norm -1/+1": ("norm", "normalized"),
    "Mach": ("mach",),
}
_CONVERSIONS: Final[Mapping[tuple[str, str], str]] = {
    ("ft", "m"): "1 ft is 0.3048 m",
    ("kt", "m/s"): "1 kt is 0.514444 m/s",
    ("km/h", "m/s"): "1 km/h is 0.277778 m/s",
    ("ft/min", "m/s"): "1 ft/min is 0.00508 m/s",
    ("rad", "deg"): "1 rad is 57.29578 deg",
    ("rad/s", "deg/s"): "1 rad/s is 57.29578 deg/s",
    ("Pa", "hPa"): "100 Pa are 1 hPa",
    ("kPa", "hPa"): "1 kPa is 10 hPa",
    ("m/s2", "g"): "9.80665 m/s2 are 1 g",
    ("degC", "K"): "0 degC is 273.15 K",
    ("°C", "K"): "0 °C is 273.15 K",
}
_BIT_RATES: Final = frozenset({*BIT_RATES, 83_333, 100_000})  # also of ARINC 825, and of serial adapters
_OUTRANKED_CLASSES: Final = 2  # A and B
_SHOWN_IN_THE_WAY: Final = 3


def check(subject: Subject, findings: Findings) -> None:
    """Check a spec against the rules DG5xx (head of this file), and add a finding for each mistake."""
    _bit_rates(subject, findings)
    _standard_identifiers(subject, findings)
    _limits(subject, findings)
    check_checkpoints(subject, findings)
    if lacks_identifiers(subject.spec):
        _too_many(subject, findings)
    else:
        _taken(subject, findings)
        _outranked(subject, findings)


def _bit_rates(subject: Subject, findings: Findings) -> None:
    for bus in subject.spec.buses.values():
        if bus.kind == "wired" and bus.bitrate not in _BIT_RATES:
            sentence = f"bus '{bus.name}' has {bus.bitrate} bit/s, which is no bit rate of CiA 301"
            hint = f"{_near(bus.bitrate)}, unless every controller on this bus can be set to {bus.bitrate}"
            findings.add(rules.UNUSUAL_BIT_RATE, subject.place("buses", bus.name, "bitrate"), sentence, hint)


def _near(bitrate: int) -> str:
    meant = [bitrate * factor for factor in (1000, 10) if bitrate * factor in _BIT_RATES]  # kbit/s, a lost zero
    below = [rate for rate in sorted(_BIT_RATES) if rate < bitrate][-1:]
    above = [rate for rate in sorted(_BIT_RATES) if rate > bitrate][:1]
    return f"write {listed(map(str, meant[:1] or [*below, *above]), last='or')}"


def _limits(subject: Subject, findings: Findings) -> None:
    for excess in exceeded(subject.spec):
        rule = rules.TOO_LONG_A_SLICE if excess.is_slice else rules.TOO_MANY
        findings.add(rule, subject.place(excess.section, excess.name), excess.sentence, excess.remedy)


def lacks_identifiers(spec: Spec) -> bool:
    """Tell whether more (module, variable) pairs need an allocated identifier than there are such identifiers."""
    return len(_allocated_to(spec)) > len(ALLOCATED_DATA_IDS)


def _allocated_to(spec: Spec) -> list[tuple[str, str]]:
    """Return as many (module, variable) pairs as need an allocated identifier, in the spec's order.

    One module that gives a variable with a standard identifier gets that identifier. The first such module in the
    spec's order is left out here; `identifiers.allocate` may choose another one, which does not change the number.
    """
    standard = {name for name, variable in spec.variables.items() if variable.identifier is not None}
    pairs = []
    for pair in spec.sources():
        if pair[1] in standard:
            standard.remove(pair[1])
        else:
            pairs.append(pair)
    return pairs


def _too_many(subject: Subject, findings: Findings) -> None:
    pairs, there_are = _allocated_to(subject.spec), len(ALLOCATED_DATA_IDS)
    module, variable = pairs[there_are]
    sentence = f"{len(pairs)} (module, variable) pairs need an allocated identifier, and there are {there_are}"
    hint = f"the first pair without an identifier is '{variable}' from '{module}'"
    findings.add(rules.TOO_MANY_SOURCES, subject.place("modules", module), sentence, hint)


def _standard_identifiers(subject: Subject, findings: Findings) -> None:
    """Check each variable that has a standard identifier against CANaerospace's list; add a finding per mistake."""
    for variable in subject.spec.variables.values():
        if variable.identifier is None:
            continue
        name, place = variable.name, subject.place("variables", variable.name, "identifier")
        standard = standard_identifier(variable.identifier)
        if standard is None:
            sentence = f"identifier {variable.identifier} of variable '{name}' is not in CANaerospace's list"
            hint = "leave 'identifier' out: then heronry allocates an identifier"
            findings.add(rules.UNASSIGNED_IDENTIFIER, place, sentence, hint)
            continue
        if standard.byte_2_is_an_index:
            sentence = f"byte 2 of identifier {standard.can_id} ({standard.name}) is an index, and not the version"
            hint = f"leave the identifier of '{name}' out: then heronry allocates an identifier"
            findings.add(rules.BYTE_2_IS_AN_INDEX, place, sentence, hint)
        _type(subject, findings, name, standard)
        _unit(subject, findings, name, standard)


def _type(subject: Subject, findings: Findings, name: str, standard: StandardIdentifier) -> None:
    given, allowed = subject.spec.variables[name].type, [data_type.name for data_type in standard.types]
    if given not in allowed:
        sentence = (
            f"variable '{name}' is of type {given}; {standard.can_id} ({standard.name}) is {listed(allowed, last='or')}"
        )
        place = subject.place("variables", name, "type")
        hint = f"give '{name}' the type {listed(allowed, last='or')}, or leave 'identifier' out"
        findings.add(rules.STANDARD_TYPE, place, sentence, hint)


def _unit(subject: Subject, findings: Findings, name: str, standard: StandardIdentifier) -> None:
    unit = subject.spec.variables[name].unit
    if unit is None and standard.unit:
        sentence = f"variable '{name}' has no unit; {standard.can_id} ({standard.name}) is in '{standard.unit}'"
        hint = f"write unit: {standard.unit} if that is what its producer gives"
        findings.add(rules.NO_UNIT, subject.place("variables", name), sentence, hint)
    if unit is None or not standard.unit or unit in (standard.unit, *_SAME_UNIT.get(standard.unit, ())):
        return
    sentence = f"variable '{name}' is in {shown(unit)}; {standard.can_id} ({standard.name}) is in '{standard.unit}'"
    hint = _CONVERSIONS.get((unit, standard.unit), "let the producer convert it, or leave 'identifier' out")
    findings.add(rules.STANDARD_UNIT, subject.place("variables", name, "unit"), sentence, hint)


def _taken(subject: Subject, findings: Findings) -> None:
    """Find foreign frames with an 11-bit identifier that the system itself uses on their bus."""
    buses = [bus for bus in subject.spec.buses.values() if any(not one.extended for one in bus.foreign)]
    used = own_identifiers(subject.spec) if buses else {}
    for bus in buses:
        for number, one in enumerate(bus.foreign):
            taken = [can_id for can_id in sorted(used[bus.name]) if one.first <= can_id <= one.last]
            if one.extended or not taken:
                continue
            more = f", and {len(taken) - 1} more" if len(taken) > 1 else ""
            sentence = f"foreign frames on bus '{bus.name}' have identifier {taken[0]}, which is that of "
            place = subject.place("buses", bus.name, "foreign", number)
            hint = "two senders of one identifier destroy each other's frames: let the equipment use another one"
            findings.add(rules.TAKEN_IDENTIFIER, place, f"{sentence}{used[bus.name][taken[0]]}{more}", hint)


def _outranked(subject: Subject, findings: Findings) -> None:
    """Find, on each bus, data of class A and B that less critical data make late.

    Late means that the response time is more than half of the deadline. Such data are found only if they would not be
    late without the less critical data.
    """
    spec = subject.spec
    times, ranks = ResponseTimes(spec), criticality_ranks(spec)
    for hops in possible_hops(spec).values():
        ahead: list[Hop] = []
        for response in times.responses(hops):
            rank = ranks[response.hop.producer]
            lesser = [hop for hop in ahead if ranks[hop.producer] > rank]
            ahead.append(response.hop)
            if rank >= _OUTRANKED_CLASSES or not lesser or _in_half_its_time(response):
                continue
            alone = times.responses([hop for hop in ahead if hop not in lesser])[-1]
            if _in_half_its_time(alone):
                _starved(subject, findings, response, CRITICALITIES[rank], lesser)


def _in_half_its_time(response: Response) -> bool:
    return response.response_ns is not None and 2 * response.response_ns <= response.deadline_ns


def _starved(subject: Subject, findings: Findings, response: Response, level: str, lesser: list[Hop]) -> None:
    hop, deadline = response.hop, f"{response.deadline_ns / 1e6:g} ms"
    took = "without bound" if response.response_ns is None else f"up to {response.response_ns / 1e6:.3f} ms"
    sentence = (
        f"'{hop.variable}' from '{hop.producer}' (class {level}) can take {took} of its {deadline} on bus '{hop.bus}', "
        "because less critical data goes first"
    )
    shown_ones = [f"'{one.variable}' from '{one.producer}'" for one in lesser[:_SHOWN_IN_THE_WAY]]
    more = [f"{len(lesser) - len(shown_ones)} more"] if len(lesser) > len(shown_ones) else []
    hint = f"leave out the identifier of {listed([*shown_ones, *more])}"
    findings.add(rules.STARVED, subject.place("variables", hop.variable), sentence, hint)
