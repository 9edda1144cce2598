"""DG4xx, rules about dependability: functions that one fault loses, and redundancy that protects from no fault.

dependability.py checks these rules in a spec that loads. They are warnings, since an aircraft may have a single point
of failure by design, such as its only engine. An engineer who accepts a single point of failure says so where the
element is declared, with an ignore comment and its reason; a project that accepts none raises the codes to errors. The
head of heronry_dg/rules/rule.py shows how a rule is added.
"""

from typing import Final

from heronry_dg.rules.rule import Family
from heronry_dg.rules.samples import DRIVER, ROOM, RUNS, doubled

FAMILY: Final = Family("DG4", "dependability: single faults and redundancy", fast=False)

_PLANNED: Final = (
    "The planner makes the best plan without the element, in every phase, for the functions that the best plan with "
    "everything up serves."
)
_IMAGINED: Final = "Redundancy that one fault defeats costs weight and adds nothing."


def _smoothed(criticality: str, *names: str) -> str:
    """Write a spec in which each of the modules `names` computes `level` from `speed`.

    criticality: the class of the spec's only function, which shows `level`.
    """
    middle = "".join(f"  {name}: {{needs: speed, gives: {{level: 1}}, {RUNS}}}\n" for name in names)
    return doubled(criticality, middle=middle, reads="level")


def _over_radio(where: str) -> str:
    """Write a spec with a PE beyond a radio. Of two modules that compute `level`, each has the field `where`."""
    middle = "".join(
        f"  {name}: {{{where}needs: speed, gives: {{level: 1}}, {RUNS}}}\n" for name in ("filter", "other_filter")
    )
    room = "cpu: 1, ram: 64KiB, flash: 64KiB"
    radio = "radio: {bitrate: 50000, kind: wireless, heartbeat_ms: 200}"
    return (
        doubled("A", middle=middle, reads="level").replace("channels: 2}", f"channels: 2}}, {radio}")
        + f"pes:\n  nav: {{node_id: 92, buses: [can0, radio], {room}}}\n"
        f"  tail: {{node_id: 93, buses: [can0], {room}}}\n"
        f"  ground: {{node_id: 94, buses: [radio], {room}}}\n"
    )


def _two_lamps(second_lamp_pe: str) -> str:
    return (
        "devices:\n  gps: {kind: sensor, pe: nav}\n  lamp: {kind: actuator, pe: tail}\n"
        f"  second_lamp: {{kind: actuator, pe: {second_lamp_pe}}}\n"
        f"gates: {{light: {{demux: speed}}}}\nmodules:\n{DRIVER}"
        f"  display: {{device: lamp, needs: light, {RUNS}}}\n"
        f"  second_display: {{device: second_lamp, needs: light, {RUNS}}}\n"
        "functions: {showing: {output: light}}\n"
    )


def _choice(pitot_pe: str) -> str:
    return (
        f"devices:\n  gps: {{kind: sensor, pe: nav}}\n  pitot: {{kind: sensor, pe: {pitot_pe}}}\n"
        "  lamp: {kind: actuator, pe: tail}\n"
        "variables:\n  speed: {type: FLOAT, versions: 2}\n"
        f"modules:\n{DRIVER}"
        f"  other_driver: {{device: pitot, gives: {{speed: 2}}, {RUNS}}}\n"
        f'  display: {{device: lamp, needs: {{xor: ["speed@1", "speed@2"]}}, {RUNS}}}\n'
    )


def _voter(third_pe: str) -> str:
    return (
        "pes:\n  nav: {node_id: 92, buses: [can0], cpu: 1, ram: 64KiB, flash: 64KiB}\n"
        "  tail: {node_id: 93, buses: [can0], cpu: 1, ram: 64KiB, flash: 64KiB}\n"
        "  wing: {node_id: 94, buses: [can0], cpu: 1, ram: 64KiB, flash: 64KiB}\n"
        "devices:\n  one: {kind: sensor, pe: nav}\n  two: {kind: sensor, pe: tail}\n"
        f"  three: {{kind: sensor, pe: {third_pe}}}\n"
        "variables:\n  speed_1: {type: FLOAT}\n  speed_2: {type: FLOAT}\n  speed_3: {type: FLOAT}\n"
        f"modules:\n  driver_1: {{device: one, gives: {{speed_1: 1}}, {RUNS}}}\n"
        f"  driver_2: {{device: two, gives: {{speed_2: 1}}, {RUNS}}}\n"
        f"  driver_3: {{device: three, gives: {{speed_3: 1}}, {RUNS}}}\n"
        f"  display: {{needs: {{or: {{k: 2, of: [speed_1, speed_2, speed_3]}}}}, {RUNS}}}\n"
    )


def _smoothers(placement: str) -> str:
    """Write a spec with two modules that could replace each other, under these placement rules."""
    return (
        "variables:\n  speed: {type: FLOAT}\n  level: {type: FLOAT}\n"
        f"modules:\n{DRIVER}"
        f"  one: {{needs: speed, gives: {{level: 1}}, {RUNS}}}\n"
        f"  two: {{needs: speed, gives: {{level: 1}}, {RUNS}}}\n"
        f"  display: {{device: lamp, needs: level, {RUNS}}}\n{placement}"
    )


LOST_WITH_HARDWARE = FAMILY.warning(
    "DG401",
    "lost-with-hardware",
    what="A function of class A or B is lost when one PE, device or bus fails.",
    why="Every flight must expect one fault. A function without an alternative, and one whose alternative has no "
    f"room, are reported alike. {_PLANNED}",
    fix="Double the device on another PE (a DEMUX chooses between actuators), give the bus `channels: 2`, let modules "
    "run on more PEs or with less, or accept it with a reason: `# dg: ignore[DG401] one engine`.",
    bad=doubled("A", pitot_pe="nav"),
    good=doubled("A", pitot_pe="tail"),
)
LESSER_LOST_WITH_HARDWARE = FAMILY.warning(
    "DG402",
    "lesser-lost-with-hardware",
    what="A function of class C or D is lost when one PE, device or bus fails.",
    why=f"This rule has another code than DG401, so that one can be an error and the other accepted. {_PLANNED}",
    fix="As for DG401; or make the function class E, if nothing depends on it.",
    bad=doubled("C", pitot_pe="nav"),
    good=doubled("C", pitot_pe="tail"),
)
LOST_WITH_MODULE = FAMILY.warning(
    "DG403",
    "lost-with-module",
    what="A function of class A or B is lost when one module fails, though all hardware works.",
    why="Software fails too: a module that raises an error is stopped until its fault is cleared. Drivers are left out "
    f"where their device has the same finding. {_PLANNED}",
    fix="Add a second module that gives the same variable, if possible of another design, even in a worse version; or "
    "accept it with a reason.",
    bad=_smoothed("A", "smoother"),
    good=_smoothed("A", "smoother", "plain_smoother"),
)
LESSER_LOST_WITH_MODULE = FAMILY.warning(
    "DG404",
    "lesser-lost-with-module",
    what="A function of class C or D is lost when one module fails, though all hardware works.",
    why=f"This rule has another code than DG403, so that one can be an error and the other accepted. {_PLANNED}",
    fix="As for DG403; or make the function class E, if nothing depends on it.",
    bad=_smoothed("D", "smoother"),
    good=_smoothed("D", "smoother", "plain_smoother"),
)
PLANT_LOST = FAMILY.warning(
    "DG405",
    "plant-off-path",
    what="A plant of class A or B is on no control path any more when one element fails.",
    why="Its function may still be served, by a module that no longer sees what it moves: the loop is open. Each plan "
    "is the best one without the element, in every phase whose plan with everything up has the plant on a path.",
    fix="Add a sensor that sees the plant, or an actuator that moves it, which that fault does not take away; or "
    "accept it with a reason.",
    bad=doubled("E", pitot_pe="nav") + ROOM,
    good=doubled("E", pitot_pe="tail") + ROOM,
)
DEMUX_SHARES = FAMILY.warning(
    "DG410",
    "demux-shares",
    what="All branches of a DEMUX are lost with one element, though the demanded variable is still there.",
    why=f"A DEMUX is there so that another output takes over. {_IMAGINED} The rule looks at the graph alone, as if "
    "resources were unlimited.",
    fix="Put the actuators on different PEs, on different sides of a gateway, and feed them separately.",
    bad=_two_lamps("tail"),
    good=_two_lamps("nav"),
)
XOR_SHARES = FAMILY.warning(
    "DG411",
    "xor-shares",
    what="All inputs of a XOR are lost with one element, though the module that reads them could still run.",
    why=f"A XOR is there to choose another source. {_IMAGINED} The rule also applies where one module gives all the "
    "versions.",
    fix="Feed one of the inputs from another PE, another sensor and another module.",
    bad=_choice("nav"),
    good=_choice("tail"),
)
VOTER_SHARES = FAMILY.warning(
    "DG412",
    "voter-shares",
    what="A voter (k of n inputs, 2 <= k < n) has fewer than three sources of which no two are lost with one element.",
    why="A vote overrules one wrong input. Inputs that share a PE, a sensor or a module can be wrong together, and "
    "then they are the majority.",
    fix="Bring each input from a PE and a sensor of its own.",
    bad=_voter("tail"),
    good=_voter("wing"),
)
SEPARATE_AND_TOGETHER = FAMILY.warning(
    "DG420",
    "separate-and-together",
    what="One rule separates two modules, and others put them together.",
    why="Both rules hold for modules that run, so the two never run at the same time.",
    fix="Remove one of the rules.",
    bad=_smoothers("separate: [[one, two]]\ntogether: [[one, two]]\n"),
    good=_smoothers("separate: [[one, two]]\n"),
)
SEPARATE_WITHOUT_ROOM = FAMILY.warning(
    "DG421",
    "separate-without-room",
    what="Modules must be on different PEs, and there are not enough PEs on which they fit.",
    why="Some of these modules never run beside the others: the rule defeats the redundancy that it protects.",
    fix="Let one of the modules run elsewhere, or remove it from the rule.",
    bad=_choice("nav").replace('{xor: ["speed@1", "speed@2"]}', "speed") + "separate: [[driver, other_driver]]\n",
    good=_choice("tail").replace('{xor: ["speed@1", "speed@2"]}', "speed") + "separate: [[driver, other_driver]]\n",
)
TOGETHER_NOWHERE = FAMILY.warning(
    "DG422",
    "together-nowhere",
    what="Two modules must be on one PE, and no PE fits both.",
    why="The two never run at the same time. If they are branches of one DEMUX, they never do in any case; then the "
    "rule has one effect: a third module that it names can run beside only one of them.",
    fix="Remove the module that cannot run on the PE of the others from the rule, or write one rule for each.",
    bad=_two_lamps("nav") + "together: [[display, second_display]]\n",
    good=_two_lamps("nav") + "together: [[driver, second_display]]\n",
)
BEYOND_RADIO = FAMILY.warning(
    "DG406",
    "may-run-beyond-radio",
    what="A module that a function of class A or B uses may run on a PE beyond a wireless bus, and on others.",
    why="After a fault the planner may put the module there, and then the function depends on the radio.",
    fix="Name in `runs_on` the PEs on which it may run.",
    bad=_over_radio(""),
    good=_over_radio("runs_on: [nav, tail], "),
)
