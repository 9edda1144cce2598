"""The rules DG3xx, about resources: with everything up, there is room, bandwidth and time for all that is wanted.

They are checked by resources.py, in a spec that loads. They are about the system with nothing down; the rules DG4xx are
about faults. The head of heronry_dg/rules/rule.py shows how a rule is added.
"""

from typing import Final

from heronry_dg.rules.rule import Family
from heronry_dg.rules.samples import DISPLAY, DRIVER, RUNS, doubled

FAMILY: Final = Family("DG3", "resources: room, bandwidth, deadlines", fast=False)

_CHECKED: Final = "No plan can make this spec do what it promises, so the fault is reported before a flight."


def _display_with(cpu: str) -> str:
    return f"modules:\n{DRIVER}  display: {{device: lamp, needs: speed, cpu: {cpu}, ram: 1KiB, rate_hz: 10}}\n"


def _two_functions(cpu: str) -> str:
    """Write a spec with two functions of class C; each has two output modules behind a DEMUX.

    cpu: the CPU that each of these four modules needs.
    """
    lit = f"cpu: {cpu}, ram: 1KiB, rate_hz: 10"
    return (
        "buses: {can0: {bitrate: 1000000, channels: 2}}\n"
        "devices:\n  gps: {kind: sensor, pe: nav}\n  pitot: {kind: sensor, pe: tail}\n"
        "  red_1: {kind: actuator, pe: nav}\n  red_2: {kind: actuator, pe: tail}\n"
        "  green_1: {kind: actuator, pe: nav}\n  green_2: {kind: actuator, pe: tail}\n"
        "gates: {red: {demux: speed}, green: {demux: speed}}\n"
        f"modules:\n{DRIVER}  other_driver: {{device: pitot, gives: {{speed: 1}}, {RUNS}}}\n"
        f"  red_driver_1: {{device: red_1, needs: red, {lit}}}\n"
        f"  red_driver_2: {{device: red_2, needs: red, {lit}}}\n"
        f"  green_driver_1: {{device: green_1, needs: green, {lit}}}\n"
        f"  green_driver_2: {{device: green_2, needs: green, {lit}}}\n"
        "functions: {warning: {output: red, criticality: C}, safe: {output: green, criticality: C}}\n"
    )


def _on_one_pe(gps_pe: str) -> str:
    return (
        f"devices:\n  gps: {{kind: sensor, pe: {gps_pe}}}\n  lamp: {{kind: actuator, pe: tail}}\n"
        "modules:\n  driver: {device: gps, gives: {speed: 1}, cpu: 0.6, ram: 1KiB, rate_hz: 10}\n"
        "  display: {device: lamp, needs: speed, cpu: 0.6, ram: 1KiB, rate_hz: 10}\n"
    )


def _slow_bus(rate_hz: str) -> str:
    return (
        "buses: {can0: {bitrate: 10000, heartbeat_ms: 1000}}\n"
        f"modules:\n  driver: {{device: gps, gives: {{speed: 1}}, cpu: 0.1, ram: 1KiB, rate_hz: {rate_hz}}}\n{DISPLAY}"
    )


_TWO_BUSES: Final = "buses: {can0: {bitrate: 1000000}, can1: {bitrate: 1000000}}\n"


def _pes_on(spare: str, second_spare: str) -> str:
    """Write the PEs `nav` and `tail` on bus can0, and two more, which no function needs, on these buses."""
    room = "cpu: 1, ram: 64KiB, flash: 64KiB"
    return (
        f"pes:\n  nav: {{node_id: 92, buses: [can0], {room}}}\n  tail: {{node_id: 93, buses: [can0], {room}}}\n"
        f"  spare: {{node_id: 94, buses: [{spare}], {room}}}\n"
        f"  second_spare: {{node_id: 95, buses: [{second_spare}], {room}}}\n"
    )


def _beyond(reserve: str) -> str:
    """Write a spec with a radio that has this share of `reserve`, and a lamp beyond the radio."""
    room = "cpu: 1, ram: 64KiB, flash: 64KiB"
    return (
        "buses:\n  can0: {bitrate: 1000000}\n"
        f"  radio: {{kind: wireless, bitrate: 25000, reserve: {reserve}, heartbeat_ms: 200}}\n"
        f"pes:\n  nav: {{node_id: 92, buses: [can0, radio], {room}}}\n"
        f"  tail: {{node_id: 93, buses: [radio], {room}}}\n"
    )


def _seen_in(phases: str, criticality: str = "D") -> str:
    """Write a spec with two phases and two displays, which read the speed only in some phases."""
    reads = f"{{demux: {{var: speed, only_in: [{phases}]}}}}"
    return doubled(criticality).replace("{demux: speed}", reads) + "phases: {climb: , cruise: }\n"


MODULE_FITS_NOWHERE = FAMILY.error(
    "DG301",
    "module-fits-nowhere",
    what="No mode of a module fits any PE on which the module may run, even with nothing else there.",
    why="The module never runs, and neither do modules that need its data. A PE must have the module's device and "
    "features, be allowed by "
    "`runs_on`, and offer enough CPU, RAM and flash.",
    fix="Allow or enlarge a PE, or let the module need less.",
    bad=_display_with("2"),
    good=_display_with("0.5"),
)
MODE_FITS_NOWHERE = FAMILY.error(
    "DG302",
    "mode-fits-nowhere",
    what="One mode of a module is too large for every PE on which the module may run; others fit.",
    why="The mode is never chosen, whatever it is worth: the quality that it promises does not exist.",
    fix="Let the mode need less, enlarge a PE, or remove the mode.",
    bad="modules:\n  driver:\n    device: gps\n    modes:\n"
    "      fine: {gives: {speed: 1}, cpu: 2, ram: 1KiB, rate_hz: 10}\n"
    f"      coarse: {{gives: {{speed: 1}}, {RUNS}}}\n{DISPLAY}",
    good="modules:\n  driver:\n    device: gps\n    modes:\n"
    "      fine: {gives: {speed: 1}, cpu: 0.5, ram: 1KiB, rate_hz: 10}\n"
    f"      coarse: {{gives: {{speed: 1}}, {RUNS}}}\n{DISPLAY}",
)
CRITICAL_DO_NOT_FIT = FAMILY.error(
    "DG303",
    "critical-do-not-fit",
    what="With everything up, not all functions of class A to D that a phase wants can be served at once.",
    why="Degradation is for faults. A system that gives up a critical function before any fault has no reserve. "
    "The best plan can serve the function alone, but not beside the others.",
    fix="Give the PEs more room, let modules need less or add smaller modes, lower a criticality to E, or set the "
    "priority to 0 in that phase.",
    bad=_two_functions("0.95"),
    good=_two_functions("0.4"),
)
NEVER_FITS = FAMILY.error(
    "DG304",
    "never-fits",
    what="A function cannot be served with everything up, even if nothing else were wanted.",
    why=f"Each of its modules fits some PE, but not all that it needs fit together. {_CHECKED}",
    fix="Give the PEs or buses that its modules need more room, loosen a placement rule, or remove the function.",
    bad=_on_one_pe("tail"),
    good=_on_one_pe("nav"),
)
BUS_OVERLOADED = FAMILY.error(
    "DG305",
    "bus-overloaded",
    what="What must cross a bus, wherever modules are placed and whichever modes they take, is more than it may carry.",
    why="Data may take max_load - reserve of the bit rate, in frames of the greatest length. Only forced data "
    "count: those that a function cannot do without, from PEs on one side of the bus to PEs on the other, at the "
    "lowest rate of the modules that give it.",
    fix="Lower the rates, add a slower mode, bring producer and consumer to one PE, or raise the bit rate.",
    bad=_slow_bus("60"),
    good=_slow_bus("10"),
)
LATE = FAMILY.error(
    "DG306",
    "missed-deadline",
    what="A function is not served with everything up, only because data would miss its deadline on a bus.",
    why="The response-time analysis of CAN bounds how late a datum can be: it waits for one frame that has just "
    "started, and for all that has a smaller identifier. A datum without `deadline_ms` must arrive within its period.",
    fix="Raise the deadline, lower the rates of more urgent frames, raise the bit rate, or let producer and consumer "
    "share a PE.",
    bad="variables:\n  speed: {type: FLOAT, deadline_ms: 0.5}\n",
    good="variables:\n  speed: {type: FLOAT, deadline_ms: 5}\n",
)
RESERVE_TOO_SMALL = FAMILY.error(
    "DG307",
    "reserve-too-small",
    what="The `reserve` of a bus is less than what management sends there all the time.",
    why="In each heartbeat period every PE on the bus sends its state and the manager its LEASE and ALIVE. Each output "
    "is echoed once a second or more, each node sends a CANopen heartbeat every second, and gateways report on their "
    "radios. Without room for these frames of up to 135 bits healthy PEs fall silent, and are declared down.",
    fix="Raise `reserve` to the share in the message, or raise `heartbeat_ms`.",
    bad="buses: {can0: {bitrate: 1000000, reserve: 0.01}}\n",
    good="buses: {can0: {bitrate: 1000000, reserve: 0.1}}\n",
)
NO_GATEWAY = FAMILY.error(
    "DG308",
    "no-gateway",
    what="No PE joins a bus with several PEs to the manager's bus.",
    why="A PE without a route to the manager's bus cannot be commanded, and counts as down: nothing ever runs there.",
    fix="Put one PE on both buses: it is the gateway.",
    bad=_TWO_BUSES + _pes_on("can1", "can1"),
    good=_TWO_BUSES + _pes_on("can0, can1", "can1"),
)
PE_UNREACHED = FAMILY.error(
    "DG309",
    "pe-unreached",
    what="A PE has no route to the manager's bus.",
    why="It cannot be commanded, and counts as down: nothing ever runs there.",
    fix="Put it on a bus that leads to the manager's bus, or add a gateway.",
    bad=_TWO_BUSES + _pes_on("can1", "can0"),
    good=_TWO_BUSES + _pes_on("can0", "can0"),
)
NEVER_SERVED = FAMILY.error(
    "DG310",
    "never-served",
    what="With everything up, the best plan of a phase does not serve a function of class A to D that is wanted there.",
    why=f"The message has the reason, as `heronry why` gives it. {_CHECKED}",
    fix="Remove the reason, or set the function's priority to 0 in that phase.",
    bad=_seen_in("climb"),
    good=_seen_in("climb, cruise"),
)
LESSER_NEVER_SERVED = FAMILY.echo(
    "DG311",
    "lesser-never-served",
    what="With everything up, the best plan of a phase does not serve a function of class E that is wanted there.",
    why="The message has the reason, as `heronry why` gives it.",
    fix="Remove the reason, or set the function's priority to 0 in that phase.",
    bad=_seen_in("climb", criticality="E"),
    good=_seen_in("climb, cruise", criticality="E"),
)
RADIO_RESERVE_TOO_SMALL = FAMILY.warning(
    "DG312",
    "radio-reserve-too-small",
    what="The `reserve` of a wireless bus is less than what management sends there all the time.",
    why="As for DG307. A gateway drops what is too old, so PEs beyond the radio may be declared down when it is full.",
    fix="Raise `reserve` to the share in the message, or raise `heartbeat_ms`.",
    bad=_beyond("0.05"),
    good=_beyond("0.2"),
)
