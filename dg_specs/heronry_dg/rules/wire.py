"""DG5xx: the wire, that is, identifiers, priorities on the bus, and bit rates.

These rules say that identifiers are used as CANaerospace assigns them, that there are enough of them, that critical
data arrive first, and that bit rates are those of CAN controllers.

check/wire.py checks these rules in a spec that loads. If two variables have the same identifier, this is DG218, which
stops a spec from being loaded. How a rule is added is shown in rule.py.
"""

from typing import Final

from heronry_dg.rules.rule import Family
from heronry_dg.rules.samples import DISPLAY, RUNS

FAMILY: Final = Family("DG5", "the wire: bit rates, identifiers and arbitration", fast=True)

_STANDARD: Final = (
    "Displays and recorders of other makers read a standard identifier by CANaerospace's default list (V1.7, section 5)"
)
_MORE_THAN_THERE_ARE: Final = 222
_SMALL: Final = "cpu: 0.001, ram: 10, rate_hz: 10"
_MORE_RADIOS_THAN_THERE_ARE: Final = 10
_MORE_THAN_A_SLICE_HAS: Final = 5


def _many(count: int) -> str:
    """Write a spec in which a driver gives `count` variables, and a display reads them."""
    names = [f"datum_{number}" for number in range(count)]
    gives = ", ".join(f"{name}: 1" for name in names)
    return (
        f"variables: {{{', '.join(f'{name}: {{type: UCHAR}}' for name in names)}}}\n"
        f"modules:\n  driver: {{device: gps, gives: {{{gives}}}, {RUNS}}}\n"
        f"  display: {{device: lamp, needs: {{and: [{', '.join(names)}]}}, {RUNS}}}\n"
    )


def _kept(checkpoint: str) -> str:
    """Write a spec whose driver has this key."""
    return f"modules:\n  driver: {{device: gps, gives: {{speed: 1}}, {RUNS}, {checkpoint}}}\n{DISPLAY}"


def _beside_chatter(first: str, second: str, third: str, fourth: str, fifth: str) -> str:
    """Write a spec with two displays for one function of class A on a slow bus, and five unimportant variables.

    Each argument is the text that follows the type of one of these variables, and gives its further fields.
    """
    rest = "cpu: 0.1, ram: 1KiB, rate_hz: 50"
    return (
        "buses: {can0: {bitrate: 125000, channels: 2, heartbeat_ms: 50}}\n"
        "devices:\n  gps: {kind: sensor, pe: nav}\n  pitot: {kind: sensor, pe: tail}\n"
        "  lamp: {kind: actuator, pe: tail}\n  second_lamp: {kind: actuator, pe: nav}\n"
        "  probe: {kind: sensor, pe: nav}\n  recorder: {kind: actuator, pe: tail}\n"
        "gates: {light: {demux: speed}}\n"
        "variables:\n  speed: {type: FLOAT, versions: 2}\n"
        f"  c1: {{type: FLOAT{first}}}\n  c2: {{type: FLOAT{second}}}\n  c3: {{type: FLOAT{third}}}\n"
        f"  c4: {{type: FLOAT{fourth}}}\n  c5: {{type: FLOAT{fifth}}}\n"
        f"modules:\n  driver: {{device: gps, gives: {{speed: 1}}, {rest}}}\n"
        f"  other_driver: {{device: pitot, gives: {{speed: 2}}, {rest}}}\n"
        f"  display: {{device: lamp, needs: light, {rest}}}\n"
        f"  second_display: {{device: second_lamp, needs: light, {rest}}}\n"
        f"  chatter: {{device: probe, gives: {{c1: 1, c2: 1, c3: 1, c4: 1, c5: 1}}, {rest}}}\n"
        f"  logger: {{device: recorder, needs: {{and: [c1, c2, c3, c4, c5]}}, {rest}}}\n"
        "functions: {showing: {output: light, criticality: A}, logging: {output: logger}}\n"
    )


def _radios(count: int) -> str:
    """Write a spec in which a gateway has `count` wireless buses; beyond each of them, one PE reads one sensor."""
    numbers = range(count)
    radios = "".join(f", r{number}: {{kind: wireless, bitrate: 250000, heartbeat_ms: 100}}" for number in numbers)
    names = ", ".join(f"r{number}" for number in numbers)
    fields = "cpu: 1, ram: 8KiB, flash: 8KiB"
    far = "".join(f"  far{number}: {{node_id: {93 + number}, buses: [r{number}], {fields}}}\n" for number in numbers)
    devices = "".join(f"  gps{number}: {{kind: sensor, pe: far{number}}}\n" for number in numbers)
    modules = "".join(f"  reader{number}: {{device: gps{number}, {RUNS}}}\n" for number in numbers)
    functions = "".join(f"  reading{number}: {{output: reader{number}}}\n" for number in numbers)
    return (
        f"buses: {{can0: {{bitrate: 1000000}}{radios}}}\n"
        f"pes:\n  nav: {{node_id: 92, buses: [can0, {names}], {fields}}}\n{far}"
        f"devices:\n{devices}variables: {{}}\nmodules:\n{modules}functions:\n{functions}"
    )


def _displays(count: int) -> str:
    """Write a spec in which `count` displays on one PE read all the hundred variables of a driver."""
    names = [f"datum_{number}" for number in range(100)]
    reads = f"needs: {{and: [{', '.join(names)}]}}, {_SMALL}"
    displays = "".join(f"  display_{number}: {{device: lamp_{number}, {reads}}}\n" for number in range(count))
    lamps = "".join(f"  lamp_{number}: {{kind: actuator, pe: tail}}\n" for number in range(count))
    functions = "".join(f"  showing_{number}: {{output: display_{number}}}\n" for number in range(count))
    return (
        f"devices:\n  gps: {{kind: sensor, pe: nav}}\n{lamps}"
        f"variables: {{{', '.join(f'{name}: {{type: UCHAR}}' for name in names)}}}\n"
        f"modules:\n  driver: {{device: gps, gives: {{{', '.join(f'{name}: 1' for name in names)}}}, {_SMALL}}}\n"
        f"{displays}functions:\n{functions}"
    )


STANDARD_TYPE = FAMILY.error(
    "DG501",
    "standard-type",
    what="A variable with a standard identifier has another type than CANaerospace gives that identifier.",
    why=f"{_STANDARD}; they refuse the frame, or show what its bytes happen to mean in the type that they expect.",
    fix="Use one of the types that the message names, or leave `identifier` out: then heronry allocates an identifier.",
    bad="variables:\n  speed: {type: LONG, unit: m/s, identifier: 315}\n",
    good="variables:\n  speed: {type: FLOAT, unit: m/s, identifier: 315}\n",
)
STANDARD_UNIT = FAMILY.error(
    "DG502",
    "standard-unit",
    what="A variable with a standard identifier has another unit than CANaerospace gives that identifier.",
    why=f"{_STANDARD}: a receiver that reads knots as metres per second is off by a factor of two, without a warning.",
    fix="Let the producer convert, write the unit as the list does, or leave `identifier` out. Another spelling of the "
    "same unit is understood (V for volt, rpm for 1/min, mbar for hPa).",
    bad="variables:\n  speed: {type: FLOAT, unit: kt, identifier: 315}\n",
    good="variables:\n  speed: {type: FLOAT, unit: m/s, identifier: 315}\n",
)
UNASSIGNED_IDENTIFIER = FAMILY.warning(
    "DG503",
    "unassigned-identifier",
    what="A variable has a standard identifier to which CANaerospace's default list gives no meaning.",
    why="The identifier is reserved, or free for a later edition of the list; a receiver that follows the list cannot "
    "tell what the frame means.",
    fix="Leave `identifier` out: then heronry allocates a free identifier.",
    bad="variables:\n  speed: {type: FLOAT, identifier: 1300}\n",
    good="variables:\n  speed: {type: FLOAT}\n",
)
BYTE_2_IS_AN_INDEX = FAMILY.warning(
    "DG504",
    "byte-2-is-an-index",
    what="A variable has one of the identifiers whose byte 2 is the number of a waypoint, a tire or a brake pad: "
    "1000 to 1035 and 1177 to 1184.",
    why="This project's frames carry version and validity in byte 2. Other receivers would read both as such a number.",
    fix="Leave `identifier` out: then no other reader takes version 1 for waypoint 1.",
    bad="variables:\n  speed: {type: FLOAT, unit: m, identifier: 1003}\n",
    good="variables:\n  speed: {type: FLOAT}\n",
)
TOO_MANY_SOURCES = FAMILY.error(
    "DG505",
    "too-many-identifiers",
    what="More (module, variable) pairs need an allocated identifier than there are such identifiers.",
    why="Each pair has its own, so that receivers can tell redundant producers apart; 221 lie between CANaerospace's "
    "data and CANopen's.",
    fix="Give variables a standard identifier, put several values into one (SHORT2, UCHAR4), or merge modules.",
    bad=_many(_MORE_THAN_THERE_ARE),
    good=_many(_MORE_THAN_THERE_ARE - 1),
)
STARVED = FAMILY.warning(
    "DG506",
    "outranked-on-the-bus",
    what="Less critical data can hold a datum of class A or B back for more than half of its deadline.",
    why="The smaller identifier wins the bus. Allocated identifiers follow criticality; standard ones come before "
    "all of them, and follow CANaerospace's list. The check counts all data that could be sent before the datum, at "
    "their fastest rates, and reports a datum that would be in time (within half its deadline) without the less "
    "critical data. "
    "The other half of the deadline is a reserve for frames that are destroyed and sent again, and for unknowns.",
    fix="Leave the `identifier` of less critical variables out, lower their rates, or give the datum a standard one.",
    bad=_beside_chatter(
        ", unit: m, identifier: 320",
        ", unit: deg, identifier: 321",
        ", unit: m, identifier: 322",
        ", unit: hPa, identifier: 326",
        ", unit: K, identifier: 324",
    ),
    good=_beside_chatter("", "", "", "", ""),
)
TOO_MANY = FAMILY.error(
    "DG507",
    "too-many-elements",
    what="There are more devices, modules, checkpoints, modes or radios than a frame or an object of a PE can number.",
    why="Devices and modes have a byte in the echo of an output, so there are 256 devices, and 256 modes of a module. "
    "The frames of a state number modules with `checkpoint` in a byte, too. "
    "CANopen lists 254 modules of one PE, and numbers 4 096 modules of a system in its error history. 9 gateways can "
    "report on radios. Beyond these numbers, two elements would look the same, or one element would never be reported.",
    fix="Merge elements, or let modules run on fewer PEs (`runs_on`).",
    bad=_radios(_MORE_RADIOS_THAN_THERE_ARE),
    good=_radios(_MORE_RADIOS_THAN_THERE_ARE - 1),
)
TOO_LONG_A_SLICE = FAMILY.error(
    "DG508",
    "slice-too-long",
    what="The part of a configuration that one PE is to run may need more bytes than SLICE carries, which is 1 275.",
    why="The PE would refuse the configuration each time it is sent. The check counts the largest part that the PE's "
    "CPU and RAM can hold: numbers of modules, modes, inputs, outputs and forwarded data, one or two bytes each.",
    fix="Let fewer modules run on the PE (`runs_on`, another PE), merge small modules, or forward fewer data.",
    bad=_displays(_MORE_THAN_A_SLICE_HAS),
    good=_displays(_MORE_THAN_A_SLICE_HAS - 1),
)
UNUSUAL_BIT_RATE = FAMILY.warning(
    "DG509",
    "unusual-bit-rate",
    what="A wired bus has a bit rate that is in no standard.",
    why="A node whose controller cannot be set to this bit rate cannot join the bus. CiA 301 has 10, 20, 50, 125, 250, "
    "500, 800 and 1 000 kbit/s; ARINC 825 has 83.333 kbit/s as well, and most serial adapters have 100 kbit/s. A "
    "wireless bus may have any rate.",
    fix="Write one of these rates, in bit/s. If every controller on the bus can be set to that rate, ignore the "
    "finding.",
    bad="buses: {can0: {bitrate: 512000}}\n",
    good="buses: {can0: {bitrate: 500000}}\n",
)
NO_UNIT = FAMILY.warning(
    "DG510",
    "unit-missing",
    what="A variable with a standard identifier has no unit, and CANaerospace gives that identifier one.",
    why=f"{_STANDARD}: a reader of the spec cannot tell whether its producer keeps to that unit.",
    fix="Write the unit of the list, or leave `identifier` out.",
    bad="variables:\n  speed: {type: FLOAT, identifier: 315}\n",
    good="variables:\n  speed: {type: FLOAT, unit: m/s, identifier: 315}\n",
)
TAKEN_IDENTIFIER = FAMILY.error(
    "DG511",
    "foreign-identifier-taken",
    what="Declared `foreign` frames have an 11-bit identifier that heronry itself uses on the same bus.",
    why="Two nodes that send one identifier at the same time destroy each other's frames, and receivers take "
    "the frames of one for those of the other.",
    fix="Configure the other equipment for another identifier, or put it on another bus. For a variable, let heronry "
    "allocate the identifier.",
    bad="buses: {can0: {bitrate: 1000000, foreign: [{identifier: 257, bytes: 8, period_ms: 10}]}}\n",
    good="buses: {can0: {bitrate: 1000000, foreign: [{identifier: 1793, bytes: 8, period_ms: 10}]}}\n",
)
OLD_STATES = FAMILY.warning(
    "DG512",
    "checkpoint-too-old",
    what="With its `max_age_ms`, no state of a module's `checkpoint` may be young enough at some moment.",
    why="The age of a state counts from its saving, and the next state may arrive a period and the longest time of a "
    "transfer later. In between the module would start without its state on another PE.",
    fix="Write a larger `max_age_ms`, a larger `hz`, or fewer `bytes`.",
    bad=_kept("checkpoint: {bytes: 8, hz: 2, max_age_ms: 400}"),
    good=_kept("checkpoint: {bytes: 8, hz: 5, max_age_ms: 400}"),
)
