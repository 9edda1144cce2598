"""DG2xx, rules about the graph: names refer to something, gates can hold, and declared elements are used.

expression_reader.py, gate_rules.py, reference_rules.py and demux_paths.py check the rules that stop a spec from being
loaded; check/graph.py checks the others, from DG230 on, in a spec that loads. How a rule is added is shown in rule.py.
"""

from typing import Final

from heronry_dg.rules.rule import Family
from heronry_dg.rules.samples import DISPLAY, DRIVER, ROOM, RUNS, doubled, pes

FAMILY: Final = Family("DG2", "the graph: names, gates, wiring", fast=True)

_TWO_BUSES: Final = "buses: {can0: {bitrate: 1000000}, can1: {bitrate: 1000000}}\n"
_TWO_DRIVERS: Final = (
    "devices:\n  gps: {kind: sensor, pe: nav}\n  pitot: {kind: sensor, pe: tail}\n  lamp: {kind: actuator, pe: tail}\n"
    "variables:\n  speed: {type: FLOAT, versions: 2}\n"
    f"modules:\n{DRIVER}"
    f"  other_driver: {{device: pitot, gives: {{speed: 2}}, {RUNS}}}\n"
)
_LAMPS: Final = (
    "devices:\n  gps: {kind: sensor, pe: nav}\n  lamp: {kind: actuator, pe: tail}\n"
    "  second_lamp: {kind: actuator, pe: nav}\n"
    f"functions: {{showing: {{output: light}}}}\ngates: {{light: {{demux: speed}}}}\nmodules:\n{DRIVER}"
)


def _display(needs: str) -> str:
    """Write the section `modules`: a driver that gives `speed`, and a display with these needs."""
    return f"modules:\n{DRIVER}  display: {{device: lamp, needs: {needs}, {RUNS}}}\n"


def _voter(needs: str) -> str:
    """Write sections of a spec: two drivers, each with a version of `speed` of its own, and a display with `needs`."""
    return f"{_TWO_DRIVERS}  display: {{device: lamp, needs: {needs}, {RUNS}}}\n"


def _lamps(first: str, second: str, demux: str = "speed") -> str:
    """Write a spec with DEMUX `light` and two displays.

    first: fields of the module `display`, as YAML text.
    second: fields of the module `second_display`, as YAML text.
    demux: what is in front of the DEMUX.
    """
    return (
        f"{_LAMPS.replace('demux: speed', f'demux: {demux}')}  display: {{device: lamp, {first}, {RUNS}}}\n"
        f"  second_display: {{device: second_lamp, {second}, {RUNS}}}\n"
    )


def _paths(ends: str) -> str:
    """Write a spec with a DEMUX of two branches, each of which leads on to an actuator; `ends` is the field `to`."""
    return (
        "devices:\n  gps: {kind: sensor, pe: nav}\n  lamp: {kind: actuator, pe: tail}\n"
        "  second_lamp: {kind: actuator, pe: nav}\n"
        "variables:\n  speed: {type: FLOAT}\n  text: {type: FLOAT}\n  second_text: {type: FLOAT}\n"
        f"functions: {{showing: {{output: light}}}}\ngates: {{light: {{demux: speed, {ends}}}}}\nmodules:\n{DRIVER}"
        f"  writer: {{needs: light, gives: {{text: 1}}, {RUNS}}}\n"
        f"  second_writer: {{needs: light, gives: {{second_text: 1}}, {RUNS}}}\n"
        f"  display: {{device: lamp, needs: text, {RUNS}}}\n"
        f"  second_display: {{device: second_lamp, needs: second_text, {RUNS}}}\n"
    )


UNKNOWN_NAME = FAMILY.stop(
    "DG201",
    "unknown-name",
    what="A name refers to nothing.",
    why="The name is misspelt, or the element was removed or renamed.",
    fix="Write the suggested name, or declare the element.",
    bad=_display("sped"),
    good=_display("speed"),
)
VERSION_OUT_OF_RANGE = FAMILY.stop(
    "DG202",
    "version-out-of-range",
    what="A version is given or read that the variable does not have.",
    why="A variable has versions 1 (the best) to `versions`, which is 1 if left out.",
    fix="Write a version that exists, or raise the variable's `versions`.",
    bad=_voter("speed@3"),
    good=_voter("speed"),
)
CYCLE = FAMILY.stop(
    "DG203",
    "cycle-without-initial",
    what="Modules wait for one another in a circle, and no variable on it has an `initial` value.",
    why="None of them would ever get its first input, so none would ever start.",
    fix="Give an `initial` value to a variable from which the modules may start.",
    bad="variables:\n  speed: {type: FLOAT}\n  echo: {type: FLOAT}\n"
    f"modules:\n  driver: {{device: gps, needs: echo, gives: {{speed: 1}}, {RUNS}}}\n"
    f"  display: {{device: lamp, needs: speed, gives: {{echo: 1}}, {RUNS}}}\n",
    good="variables:\n  speed: {type: FLOAT}\n  echo: {type: FLOAT, initial: 0}\n"
    f"modules:\n  driver: {{device: gps, needs: echo, gives: {{speed: 1}}, {RUNS}}}\n"
    f"  display: {{device: lamp, needs: speed, gives: {{echo: 1}}, {RUNS}}}\n",
)
BAD_K = FAMILY.stop(
    "DG204",
    "k-out-of-range",
    what="The `k` of an OR is not a whole number from 0 to the number of its inputs.",
    why="An OR holds when at least k of its n inputs do: with k above n it never would.",
    fix="Write a k from 0 (all inputs optional) to n (all needed).",
    bad=_voter('{or: {k: 3, of: ["speed@1", "speed@2"]}}'),
    good=_voter('{or: {k: 1, of: ["speed@1", "speed@2"]}}'),
)
ARITY = FAMILY.stop(
    "DG205",
    "gate-arity",
    what="A gate has too few inputs: an AND or an OR none, a XOR fewer than two.",
    why="A XOR chooses one of its inputs; with one input there is nothing to choose.",
    fix="Add inputs, or write the only input without the gate.",
    bad=_display("{xor: [speed]}"),
    good=_display("speed"),
)
DEMUX_BRANCHES = FAMILY.stop(
    "DG206",
    "demux-branches",
    what="A DEMUX has fewer than two branches.",
    why="Its branches are the modules whose `needs` name it. One of them runs: a single branch is not redundant.",
    fix="Let a second module name the DEMUX, or let the only branch name the variable itself.",
    bad=_lamps("needs: light", "needs: speed"),
    good=_lamps("needs: light", "needs: light"),
)
BRANCH_IN_PART = FAMILY.stop(
    "DG207",
    "branch-in-part",
    what="One mode of a module names a DEMUX, and another mode of the module does not.",
    why="Whether the module is the branch that runs would depend on its mode.",
    fix="Name the DEMUX in every mode of the module.",
    bad=_lamps("needs: light", "needs: light").replace(
        "needs: light, cpu: 0.1, ram: 1KiB, rate_hz: 10}\n  second",
        "modes: {a: {needs: light, cpu: 0.1, ram: 1KiB, rate_hz: 10}, b: {cpu: 0.1, ram: 1KiB, rate_hz: 5}}}\n  second",
    ),
    good=_lamps("needs: light", "needs: light").replace(
        "needs: light, cpu: 0.1, ram: 1KiB, rate_hz: 10}\n  second",
        "modes: {a: {needs: light, cpu: 0.1, ram: 1KiB, rate_hz: 10},"
        " b: {needs: light, cpu: 0.1, ram: 1KiB, rate_hz: 5}}}\n  second",
    ),
)
DEMUX_MISPLACED = FAMILY.stop(
    "DG208",
    "demux-misplaced",
    what="A DEMUX is named below an OR or a XOR, in front of another DEMUX, or twice in one mode, or has no name.",
    why="The DEMUX decides whether a branch runs; an input that may be left out cannot decide that.",
    fix="Name it once per mode, at the root of `needs` or below ANDs alone.",
    bad=_lamps("needs: light", "needs: {or: {k: 1, of: [light]}}"),
    good=_lamps("needs: light", "needs: {and: [light]}"),
)
DEMUX_UNWIRED = FAMILY.stop(
    "DG234",
    "demux-holds-unwired",
    what="The gate expression in front of a DEMUX holds with nothing wired below it.",
    why="A branch that runs must be wired to something of what the DEMUX distributes.",
    fix="Give the OR in the expression a `k` of 1 or more.",
    bad=_lamps("needs: light", "needs: light", demux="{or: {k: 0, of: [speed]}}"),
    good=_lamps("needs: light", "needs: light", demux="{or: {k: 1, of: [speed]}}"),
)
READ_TWICE = FAMILY.stop(
    "DG209",
    "read-twice",
    what="Two inputs of one mode accept the same version of one variable.",
    why="One producer could be wired to both inputs, and would count twice in a vote.",
    fix="Let the inputs accept different versions: `speed@1` and `speed@2`.",
    bad=_voter('{or: {k: 2, of: ["speed@<=2", "speed@2"]}}'),
    good=_voter('{or: {k: 2, of: ["speed@1", "speed@2"]}}'),
)
XOR_UNWIRED = FAMILY.stop(
    "DG210",
    "xor-input-holds-unwired",
    what="An input of a XOR holds with nothing wired below it.",
    why="Exactly one input of a XOR holds; if one always holds, no other can be chosen.",
    fix="Give the OR below the XOR a `k` of 1 or more.",
    bad=_voter('{xor: ["speed@1", {or: {k: 0, of: ["speed@2"]}}]}'),
    good=_voter('{xor: ["speed@1", {or: {k: 1, of: ["speed@2"]}}]}'),
)
BAD_EXPRESSION = FAMILY.stop(
    "DG211",
    "bad-expression",
    what="A value is not a gate expression: it is neither a name nor a gate with its inputs.",
    why="Expressions have few forms, so that each has one meaning.",
    fix="Write NAME, NAME@2, NAME@<=2, {and: [...]}, {or: {k: 1, of: [...]}}, {xor: [...]} or "
    "{var: NAME, worth: [...]}.",
    bad=_display("[speed]"),
    good=_display("{and: [speed]}"),
)
UNKNOWN_GATE = FAMILY.stop(
    "DG212",
    "unknown-gate",
    what="There is no gate of that kind, or the gate has no such field.",
    why="Gates are `and`, `or` (with `k` and `of`) and `xor`; a `demux` has a name under `gates:`.",
    fix="Write one of these. There is no NOT: a module cannot wait for the absence of a datum.",
    bad=_display("{nand: [speed]}"),
    good=_display("{and: [speed]}"),
)
GATE_VERSION = FAMILY.stop(
    "DG213",
    "version-of-a-gate",
    what="A named gate is written with a version.",
    why="Versions belong to variables; a gate holds or does not.",
    fix="Write the gate's name alone, and put versions inside the gate.",
    bad=f"gates: {{any_speed: speed}}\n{_display('any_speed@1')}",
    good=f"gates: {{any_speed: speed}}\n{_display('any_speed')}",
)
BAD_WORTH = FAMILY.stop(
    "DG214",
    "bad-worth",
    what="The `worth` of an input is not a list with one number per accepted version, or per version of the variable.",
    why="Points say how much better one version is than another; each version needs its own.",
    fix="List whole numbers from 0 on, best version first.",
    bad=_voter("{var: speed, worth: [30, 20, 10]}"),
    good=_voter("{var: speed, worth: [30, 20]}"),
)
GATE_IN_ITSELF = FAMILY.stop(
    "DG215",
    "gate-in-itself",
    what="A named gate contains itself.",
    why="A named gate is replaced by its expression wherever it is named; here that would never end.",
    fix="Let one of the gates on the circle name variables alone.",
    bad=f"gates: {{one: {{and: [speed, two]}}, two: one}}\n{_display('one')}",
    good=f"gates: {{one: {{and: [speed]}}, two: one}}\n{_display('two')}",
)
GATE_TOO_LARGE = FAMILY.stop(
    "DG216",
    "gate-too-large",
    what="A gate has too many inputs, or is too deep, when named gates are expanded.",
    why="A few named gates that name each other can stand for millions of inputs.",
    fix="Let a module in between read some of the inputs, and give one variable for them.",
    bad=f"gates: {{wide: {{or: {{k: 1, of: [{', '.join(['speed'] * 1001)}]}}}}}}\n{_display('speed')}",
    good=f"gates: {{narrow: {{or: {{k: 1, of: [speed]}}}}}}\n{_display('narrow')}",
)
NODE_ID_TWICE = FAMILY.stop(
    "DG217",
    "node-id-twice",
    what="Two PEs have the same `node_id`.",
    why="The identifiers of management frames follow from the node-ID: two nodes would send under the same identifier.",
    fix="Give every PE a different `node_id`, from 92 to 125.",
    bad=pes(tail="node_id: 92, buses: [can0]"),
    good=pes(),
)
IDENTIFIER_TWICE = FAMILY.stop(
    "DG218",
    "identifier-twice",
    what="Two variables have the same `identifier`.",
    why="The identifier of a frame tells its receivers which variable it carries.",
    fix="Leave `identifier` out where it need not be a standard one: then heronry allocates an identifier.",
    bad="variables:\n  speed: {type: FLOAT, unit: m/s, identifier: 315}\n"
    "  height: {type: FLOAT, unit: m, identifier: 315}\n"
    f"modules:\n  driver: {{device: gps, gives: {{speed: 1, height: 1}}, {RUNS}}}\n"
    f"  display: {{device: lamp, needs: {{and: [speed, height]}}, {RUNS}}}\n",
    good="variables:\n  speed: {type: FLOAT, unit: m/s, identifier: 315}\n"
    "  height: {type: FLOAT, unit: m, identifier: 322}\n"
    f"modules:\n  driver: {{device: gps, gives: {{speed: 1, height: 1}}, {RUNS}}}\n"
    f"  display: {{device: lamp, needs: {{and: [speed, height]}}, {RUNS}}}\n",
)
SECOND_ROUTE = FAMILY.stop(
    "DG219",
    "second-route",
    what="The buses of the PEs close a ring: there are two routes between two PEs.",
    why="The route of data, and what a broken bus cuts off, must be unique. So the buses must form a forest.",
    fix="Take one PE off one of the buses. Against a broken wire, `channels: 2` doubles a bus.",
    bad=_TWO_BUSES + pes("node_id: 92, buses: [can0, can1]", "node_id: 93, buses: [can0, can1]"),
    good=_TWO_BUSES + pes("node_id: 92, buses: [can0, can1]"),
)
MANAGER_BUS = FAMILY.stop(
    "DG220",
    "manager-bus",
    what="There is no bus for the manager, or the manager is on a wireless bus although there is a wired one.",
    why="Management must arrive in time, which a radio cannot guarantee.",
    fix="Add a wired bus, or name the right one: `manager: {bus: can0}`.",
    bad="buses: {can0: {bitrate: 1000000, kind: wireless}}\n",
    good="buses: {can0: {bitrate: 1000000}}\n",
)
GATE_AND_VARIABLE = FAMILY.stop(
    "DG221",
    "gate-and-variable",
    what="A gate and a variable have the same name.",
    why="In an expression the name could mean the gate or the variable.",
    fix="Rename the gate.",
    bad=f"gates: {{speed: speed}}\n{_display('speed')}",
    good=f"gates: {{any_speed: speed}}\n{_display('any_speed')}",
)
BAD_OUTPUT = FAMILY.stop(
    "DG222",
    "bad-output",
    what="The `output` of a function is a gate that is not a DEMUX, or a name that both a module and a DEMUX have.",
    why="A function is served when its output module runs, or one branch (with `to`: one end) of its DEMUX.",
    fix="Name a module or a DEMUX; if both have that name, rename one of them.",
    bad=f"gates: {{any_speed: speed}}\n{_display('any_speed')}functions: {{showing: {{output: any_speed}}}}\n",
    good=f"gates: {{any_speed: speed}}\n{_display('any_speed')}functions: {{showing: {{output: display}}}}\n",
)
RUNS_NOWHERE = FAMILY.stop(
    "DG223",
    "runs-nowhere",
    what="`runs_on` of a module does not allow the PE that its device is connected to.",
    why="A module with a device runs on the device's PE; so this module can run nowhere.",
    fix="Leave `runs_on` out: the device decides.",
    bad=f"modules:\n  driver: {{device: gps, runs_on: [tail], gives: {{speed: 1}}, {RUNS}}}\n{DISPLAY}",
    good=f"modules:\n{DRIVER}{DISPLAY}",
)
VALUE_LENGTH = FAMILY.stop(
    "DG224",
    "value-length",
    what="The `value` of a function does not have one number per mode of its output.",
    why="Each number says what the function is worth in that mode.",
    fix="List as many numbers as the output has modes (of a DEMUX: as the end with the most modes), best first.",
    bad="functions: {showing: {output: display, value: [100, 40]}}\n",
    good="functions: {showing: {output: display, value: [100]}}\n",
)
NOT_A_NUMBER_TO_WATCH = FAMILY.stop(
    "DG225",
    "not-a-number-to-watch",
    what="A phase watches a variable that is not a single number.",
    why="A threshold is compared with one number; a pair or a string has no order.",
    fix="Watch a variable of a numeric type.",
    bad="variables:\n  speed: {type: SHORT2}\nphases:\n  climb: {}\n  cruise: {when: {variable: speed, above: 10}}\n",
    good="variables:\n  speed: {type: SHORT}\nphases:\n  climb: {}\n  cruise: {when: {variable: speed, above: 10}}\n",
)

WRONG_DEVICE = FAMILY.stop(
    "DG226",
    "wrong-kind-of-device",
    what="A plant is moved by a sensor, or seen by an actuator.",
    why="A loop through the physical world leaves by an actuator and comes back by a sensor.",
    fix="Name actuators in `moved_by` and sensors in `seen_by`.",
    bad="plants:\n  room: {moved_by: [lamp], seen_by: [lamp]}\n",
    good="plants:\n  room: {moved_by: [lamp], seen_by: [gps]}\n",
)
DEMUX_ENDS = FAMILY.stop(
    "DG228",
    "demux-ends",
    what="`to` of a DEMUX does not name one end for each branch.",
    why="A function with this output is served when an end runs. An end belongs to a branch if it can run with "
    "everything up, but not without that branch. If two ends belonged to one branch, or an end to no branch, the "
    "DEMUX would not decide which end runs.",
    fix="Name for each branch the module at which its path ends, often the driver of the actuator.",
    bad=_paths("to: [display, driver]"),
    good=_paths("to: [display, second_display]"),
)
DEMUX_WITHOUT_ENDS = FAMILY.stop(
    "DG229",
    "demux-without-ends",
    what="A branch of a DEMUX drives no actuator, leads on to one, and the DEMUX has no `to`.",
    why="The function would count as served as soon as the branch runs, though the actuator need not move.",
    fix="Name under `to` the module at which each branch ends.",
    bad=_paths("").replace("speed, }", "speed}"),
    good=_paths("to: [display, second_display]"),
)

# These rules are checked in a spec that loads; those about unused parts only if all inputs can be wired.

UNPRODUCED = FAMILY.error(
    "DG230",
    "unproduced-variable",
    what="A module or a phase reads a variable that no module gives.",
    why="The input will never be wired. If the input is optional, the module runs without it, and no event says so.",
    fix="Let a module give the variable, or remove the input.",
    bad="variables:\n  speed: {type: FLOAT}\n  height: {type: FLOAT}\n"
    f"{_display('{and: [speed, {or: {k: 0, of: [height]}}]}')}",
    good="variables:\n  speed: {type: FLOAT}\n  height: {type: FLOAT}\n"
    f"modules:\n  driver: {{device: gps, gives: {{speed: 1, height: 1}}, {RUNS}}}\n"
    f"  display: {{device: lamp, needs: {{and: [speed, {{or: {{k: 0, of: [height]}}}}]}}, {RUNS}}}\n",
)
UNGIVEN_VERSION = FAMILY.error(
    "DG231",
    "ungiven-version",
    what="An input accepts only versions of a variable that no module gives.",
    why="The variable has producers, but none of this quality, so the input will never be wired.",
    fix="Read a version that some module gives, or let a module give this version.",
    bad=f"variables:\n  speed: {{type: FLOAT, versions: 2}}\n"
    f"{_display('{and: [speed@1, {or: {k: 0, of: [speed@2]}}]}')}",
    good=f"variables:\n  speed: {{type: FLOAT, versions: 2}}\n{_display('speed@1')}",
)
NEVER_HOLDS = FAMILY.error(
    "DG232",
    "never-holds",
    what="The `needs` of a mode can never hold, although some module gives each variable that they name.",
    why="The inputs exclude each other. Either one module gives several of the versions, each in another mode, and "
    "runs in one mode at a time; or they need several branches of one DEMUX or several drivers of one actuator (this "
    "module may be one of them), of which only one runs.",
    fix="Lower `k`, read one version, or let another module give what is missing.",
    bad=f"variables:\n  speed: {{type: FLOAT, versions: 2}}\nmodules:\n  driver:\n    device: gps\n    modes:\n"
    f"      fine: {{gives: {{speed: 1}}, {RUNS}}}\n      coarse: {{gives: {{speed: 2}}, {RUNS}}}\n"
    f'  display: {{device: lamp, needs: {{and: ["speed@1", "speed@2"]}}, {RUNS}}}\n',
    good=f"variables:\n  speed: {{type: FLOAT, versions: 2}}\nmodules:\n  driver:\n    device: gps\n    modes:\n"
    f"      fine: {{gives: {{speed: 1}}, {RUNS}}}\n      coarse: {{gives: {{speed: 2}}, {RUNS}}}\n"
    f'  display: {{device: lamp, needs: {{or: {{k: 1, of: ["speed@1", "speed@2"]}}}}, {RUNS}}}\n',
)
NO_LOOP = FAMILY.error(
    "DG233",
    "no-loop",
    what="No wiring, over all modes, puts a plant of class A or B on a control path.",
    why="Nothing that sees the plant leads to anything that moves it, so nothing controls it, whatever runs.",
    fix="Read its sensor in a module that leads to its actuator, or correct `moved_by`, `seen_by` and `affects`.",
    bad=doubled("E") + "plants:\n  room: {moved_by: [lamp, second_lamp], criticality: A}\n",
    good=doubled("E") + ROOM,
)
NEVER_FIRES = FAMILY.error(
    "DG246",
    "rule-never-fires",
    what="The rule of a phase can never fire.",
    why="It leads here from no other phase, its variable never is beyond the threshold, or no module that gives the "
    "variable serves a function that is wanted in the phases from which the rule leads here.",
    fix="Name in `from` the phases that the rule may leave, and let a function that is wanted there use the variable.",
    bad="phases:\n  climb: {when: {variable: speed, above: 10}}\n  cruise: {}\n",
    good="phases:\n  climb: {when: {variable: speed, above: 10, from: [cruise]}}\n  cruise: {}\n",
)
CIRCLE = FAMILY.error(
    "DG247",
    "phase-changes-without-end",
    what="Rules of phases lead from one phase to the next and back, and there are values at which all of them hold.",
    why="A rule fires again when a phase in its `from` begins while its condition holds. With such a value the phase "
    "would change with every message, and each change needs a plan and an epoch.",
    fix="Choose thresholds so that no value fulfils the conditions of all these rules, with a gap between them.",
    bad="phases:\n  climb: {when: {variable: speed, above: 5, from: [cruise]}}\n"
    "  cruise: {when: {variable: speed, above: 10, from: [climb]}}\n",
    good="phases:\n  climb: {when: {variable: speed, below: 5, from: [cruise]}}\n"
    "  cruise: {when: {variable: speed, above: 10, from: [climb]}}\n",
)
UNUSED_VARIABLE = FAMILY.echo(
    "DG240",
    "unused-variable",
    what="A variable is read by no module and watched by no phase.",
    why="The variable is a leftover, or its reader names another variable by mistake. The variable is never sent.",
    fix="Remove the variable, or let a module read it.",
    bad="variables:\n  speed: {type: FLOAT}\n  spare: {type: FLOAT}\n",
    good="variables:\n  speed: {type: FLOAT}\n",
)
UNUSED_MODULE = FAMILY.echo(
    "DG241",
    "unused-module",
    what="A module serves no function: its data never reach an output, directly or through other modules.",
    why="Only modules that serve a function run, so this module never will.",
    fix="Remove it, make it the output of a function, or let another module read what it gives.",
    bad=f"modules:\n{DRIVER}{DISPLAY}  logger: {{needs: speed, {RUNS}}}\n",
    good=f"modules:\n{DRIVER}{DISPLAY}  logger: {{needs: speed, {RUNS}}}\n"
    "functions: {showing: {output: display}, logging: {output: logger}}\n",
)
NO_SENSOR = FAMILY.echo(
    "DG242",
    "fed-by-no-device",
    what="No sensor feeds a function: no path leads from a sensor to its output.",
    why="The output does not depend on any measurement or command; a driver or its `device` may be missing.",
    fix="Put a module with a sensor at the beginning of the graph.",
    bad="devices:\n  lamp: {kind: actuator, pe: tail}\n"
    f"modules:\n  driver: {{gives: {{speed: 1}}, {RUNS}}}\n{DISPLAY}",
    good=f"modules:\n{DRIVER}{DISPLAY}",
)
UNUSED_GATE = FAMILY.echo(
    "DG243",
    "unused-gate",
    what="No expression names a named gate.",
    why="The gate is a leftover, or an expression names another gate by mistake.",
    fix="Remove the gate, or name it in an expression.",
    bad="gates: {any_speed: speed}\n",
    good=f"gates: {{any_speed: speed}}\n{_display('any_speed')}",
)
UNUSED_DEVICE = FAMILY.echo(
    "DG244",
    "unused-device",
    what="A device is driven by no module.",
    why="A device without a module is a leftover, or its module is missing.",
    fix="Remove the device, or write the module that drives it.",
    bad="devices:\n  gps: {kind: sensor, pe: nav}\n  pitot: {kind: sensor, pe: nav}\n"
    "  lamp: {kind: actuator, pe: tail}\n",
    good="devices:\n  gps: {kind: sensor, pe: nav}\n  lamp: {kind: actuator, pe: tail}\n",
)
LESSER_WITHOUT_LOOP = FAMILY.echo(
    "DG245",
    "lesser-plant-without-loop",
    what="No wiring, over all modes, puts a plant of class C or D on a control path.",
    why="Nothing that sees the plant leads to anything that moves it, so nothing controls it, whatever runs.",
    fix="As for DG233; class E says that the plant need not be controlled.",
    bad="plants:\n  room: {seen_by: [gps], criticality: D}\n",
    good="plants:\n  room: {seen_by: [gps], criticality: E}\n",
)
