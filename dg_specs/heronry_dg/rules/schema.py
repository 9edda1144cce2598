"""DG1xx, rules about one element by itself: all its fields exist, and each field has a value that fits.

draft.py and quantities.py check the fields one by one, and reference_rules.py checks fields of one element that must
fit each other. How a rule is added is shown in rule.py.
"""

from typing import Final

from heronry_dg.rules.rule import Family
from heronry_dg.rules.samples import DISPLAY, DRIVER, RUNS, pes

FAMILY: Final = Family("DG1", "one element: fields and values", fast=True)

_EXACT: Final = "The model has exact whole numbers; a quantity that would have to be rounded is refused."

NOT_A_MAP = FAMILY.stop(
    "DG101",
    "not-a-map",
    what="A spec, a section or an element is a list or a single value, where `key: value` is expected.",
    why="Elements and fields are found by their names.",
    fix="Write `name: {field: value}`, or the fields on lines of their own, indented.",
    bad="devices: [gps, lamp]\n",
    good="devices:\n  gps: {kind: sensor, pe: nav}\n  lamp: {kind: actuator, pe: tail}\n",
)
UNKNOWN_FIELD = FAMILY.stop(
    "DG102",
    "unknown-field",
    what="An element has a field that does not exist.",
    why="A misspelt field would be skipped without a message, and its default would hold.",
    fix="Write the suggested name; `heronry schema` lists all fields.",
    bad="buses: {can0: {bitrate: 1000000, max_laod: 0.5}}\n",
    good="buses: {can0: {bitrate: 1000000, max_load: 0.5}}\n",
)
MISSING_FIELD = FAMILY.stop(
    "DG103",
    "missing-field",
    what="An element lacks a field that has no default.",
    why="No default would be right for every system.",
    fix="Add the missing fields.",
    bad="buses: {can0: {}}\n",
    good="buses: {can0: {bitrate: 1000000}}\n",
)
WRONG_TYPE = FAMILY.stop(
    "DG104",
    "wrong-type",
    what="A value is of the wrong kind: text for a number, a number for a list, a fraction for a whole number.",
    why="Values are not converted: `'1'` is text, and 1.5 is not a number of channels.",
    fix="Write a value of the kind that the message names.",
    bad=pes(nav="node_id: 92, buses: can0"),
    good=pes(),
)
NOT_A_CHOICE = FAMILY.stop(
    "DG105",
    "not-a-choice",
    what="A value is none of those that the field may have.",
    why="Each choice has another meaning, so a wrong one cannot be corrected automatically.",
    fix="Write one of the choices named, in exactly that spelling.",
    bad="functions: {showing: {output: display, criticality: high}}\n",
    good="functions: {showing: {output: display, criticality: E}}\n",
)
OUT_OF_RANGE = FAMILY.stop(
    "DG106",
    "out-of-range",
    what="A number is smaller or larger than the field allows.",
    why="The bounds are those of the protocol (node-IDs, identifiers, versions), of physics, or of exact arithmetic.",
    fix="Write a number within the bounds named.",
    bad=pes(nav="node_id: 12, buses: [can0]"),
    good=pes(),
)
BAD_NAME = FAMILY.stop(
    "DG107",
    "bad-name",
    what="The name of an element, or of the system, is not a valid name.",
    why="Names become C and DBC identifiers, and stand in gate expressions beside `@` and `<=`.",
    fix="Use a letter, then letters, digits and `_`, at most 64 in all.",
    bad="name: tail-unit\n",
    good="name: tail_unit\n",
)
SHORT_LIST = FAMILY.stop(
    "DG108",
    "short-list",
    what="A list has too few items to mean anything.",
    why="A PE on no bus receives nothing; a placement rule about one module has no effect.",
    fix="Add items, or remove the list.",
    bad="separate: [[driver]]\n",
    good="separate: [[driver, display]]\n",
)
BAD_TEXT = FAMILY.stop(
    "DG109",
    "bad-text",
    what="A text is empty, longer than 64 characters, or holds quotes, backslashes or control characters.",
    why="The text is written into DBC files and tables, in which these characters have a meaning.",
    fix="Write 1 to 64 printable characters.",
    bad="variables:\n  speed: {type: FLOAT, unit: ''}\n",
    good="variables:\n  speed: {type: FLOAT, unit: m/s}\n",
)
LISTED_TWICE = FAMILY.stop(
    "DG110",
    "listed-twice",
    what="A list contains the same name twice.",
    why="One of the two was probably meant to be another name.",
    fix="Remove one of them, or write the other name.",
    bad="separate: [[driver, display, driver]]\n",
    good="separate: [[driver, display]]\n",
)
TOO_FINE = FAMILY.stop(
    "DG111",
    "too-fine",
    what="A quantity is finer than its unit in the model: a thousandth of a core, a millihertz, a byte, a nanosecond.",
    why=_EXACT,
    fix="Round the quantity yourself, in the direction that is safe.",
    bad=f"modules:\n{DRIVER.replace('0.1', '0.0005')}{DISPLAY}",
    good=f"modules:\n{DRIVER.replace('0.1', '0.001')}{DISPLAY}",
)
WRONG_UNIT = FAMILY.stop(
    "DG112",
    "wrong-unit",
    what="A number carries a unit or a per cent sign, or stands in quotes.",
    why="The field's name gives the unit (`rate_hz`, `deadline_ms`), or the value is a share; a unit beside the value "
    "could contradict this.",
    fix="Write the number alone, in the field's unit: `rate_hz: 10`, `max_load: 0.8`.",
    bad="buses: {can0: {bitrate: 1000000, heartbeat_ms: 20ms}}\n",
    good="buses: {can0: {bitrate: 1000000, heartbeat_ms: 20}}\n",
)
BAD_MEMORY = FAMILY.stop(
    "DG113",
    "bad-memory-size",
    what="A size of memory is neither a number of bytes nor a number with KiB, MiB or GiB.",
    why="`64KB` is 64 000 bytes to some and 65 536 to others.",
    fix="Write 64KiB, 2MiB, 1GiB, or a plain number of bytes.",
    bad=pes(nav_ram="64KB"),
    good=pes(),
)
NO_DEFAULT = FAMILY.stop(
    "DG114",
    "no-default",
    what="A map by phase has no `default`.",
    why="A phase that is added later would have no criticality or priority at all.",
    fix="Add `default:` with the value for all phases that the map does not name.",
    bad="phases: {climb: {}, land: {}}\nfunctions: {showing: {output: display, priority: {land: 5}}}\n",
    good="phases: {climb: {}, land: {}}\nfunctions: {showing: {output: display, priority: {default: 1, land: 5}}}\n",
)
MODES_AND_FIELDS = FAMILY.stop(
    "DG115",
    "modes-and-fields",
    what="A module has `modes`, and also a field that belongs into a mode.",
    why="It would be unclear whether the field holds for all modes, or describes another mode.",
    fix="Move the field into each of the modes.",
    bad=f"modules:\n{DRIVER}  display:\n    device: lamp\n    needs: speed\n    modes: {{fast: {{{RUNS}}}}}\n",
    good=f"modules:\n{DRIVER}  display:\n    device: lamp\n    modes: {{fast: {{needs: speed, {RUNS}}}}}\n",
)
NO_MODE = FAMILY.stop(
    "DG116",
    "no-mode",
    what="A module lists no mode.",
    why="A module runs in one of its modes; without a mode it could never run.",
    fix="Write `modes: {fast: {cpu: ..., ram: ..., rate_hz: ...}}`, or the mode's fields on the module itself.",
    bad=f"modules:\n{DRIVER}  display: {{device: lamp, modes: {{}}}}\n",
    good=f"modules:\n{DRIVER}  display: {{device: lamp, modes: {{fast: {{needs: speed, {RUNS}}}}}}}\n",
)
UNKNOWN_TYPE = FAMILY.stop(
    "DG117",
    "unknown-type",
    what="The type of a variable is not a data type of CANaerospace.",
    why="Every data frame carries the code of its type, and receivers of other makers must know it.",
    fix="Write a CANaerospace type in capitals: FLOAT, SHORT, UCHAR ...",
    bad="variables:\n  speed: {type: float}\n",
    good="variables:\n  speed: {type: FLOAT}\n",
)
BAD_INITIAL = FAMILY.stop(
    "DG118",
    "bad-initial",
    what="The `initial` value of a variable does not fit its type.",
    why="Consumers get the `initial` value before the first frame, so a frame must be able to carry that value.",
    fix="Write a value that the type takes, or take a type that carries the value.",
    bad="variables:\n  speed: {type: UCHAR, initial: 300}\n",
    good="variables:\n  speed: {type: UCHAR, initial: 200}\n",
)
TOO_FAST_A_WIRE = FAMILY.stop(
    "DG119",
    "faster-than-can",
    what="A wired bus is faster than CAN: more than 1 000 000 bit/s.",
    why="Response times are computed for classical CAN (ISO 11898-1); CAN FD is not supported.",
    fix="Write the nominal bit rate. For a link without a cable write `kind: wireless`.",
    bad="buses: {can0: {bitrate: 2000000}}\n",
    good="buses: {can0: {bitrate: 1000000}}\n",
)
NOTHING_LEFT = FAMILY.stop(
    "DG120",
    "nothing-left-for-data",
    what="The `reserve` of a bus takes all of its `max_load`.",
    why="Data may use max_load - reserve of the bit rate, which is nothing here.",
    fix="Make `max_load` larger than `reserve`; the defaults are 0.8 and 0.1.",
    bad="buses: {can0: {bitrate: 1000000, max_load: 0.1}}\n",
    good="buses: {can0: {bitrate: 1000000, max_load: 0.2}}\n",
)
ONE_THRESHOLD = FAMILY.stop(
    "DG121",
    "one-threshold",
    what="A phase's `when` has both `above` and `below`, or neither.",
    why="A phase is entered when one variable crosses one threshold in one direction.",
    fix="Write either `above` or `below`.",
    bad="phases:\n  climb: {}\n  cruise: {when: {variable: speed, above: 10, below: 90}}\n",
    good="phases:\n  climb: {}\n  cruise: {when: {variable: speed, above: 10}}\n",
)
PHASE_NAMED_DEFAULT = FAMILY.stop(
    "DG122",
    "phase-named-default",
    what="A phase is named `default`.",
    why="In the maps by phase this name means all phases that are not named.",
    fix="Give the phase another name.",
    bad="phases: {default: {}}\n",
    good="phases: {climb: {}}\n",
)
FOREIGN_IDENTIFIERS = FAMILY.stop(
    "DG123",
    "foreign-identifiers",
    what="An entry of a bus's `foreign` has both `identifier` and `range`, or neither.",
    why="The identifier decides which data the foreign frames delay.",
    fix="Write `identifier` for frames with one identifier, and `range` for a sender with several.",
    bad="buses: {can0: {bitrate: 1000000, foreign: [{bytes: 8, period_ms: 10}]}}\n",
    good="buses: {can0: {bitrate: 1000000, foreign: [{identifier: 1793, bytes: 8, period_ms: 10}]}}\n",
)
REVERSED_RANGE = FAMILY.stop(
    "DG124",
    "reversed-range",
    what="A range has its larger end first, or a range of readings or commands holds nothing.",
    why="Which end is meant as the first must be certain: of identifiers, the first one counts in arbitration.",
    fix="Write the smaller end first.",
    bad="buses: {can0: {bitrate: 1000000, foreign: [{range: [1815, 1800], bytes: 8, period_ms: 10}]}}\n",
    good="buses: {can0: {bitrate: 1000000, foreign: [{range: [1800, 1815], bytes: 8, period_ms: 10}]}}\n",
)
OTHER_KINDS_KEY = FAMILY.stop(
    "DG125",
    "other-kinds-key",
    what="A sensor has `limits`, `rate_limit` or `safe`, or an actuator has `range` or `stale_ms`.",
    why="A sensor has readings and an actuator has commands; the key would have no effect.",
    fix="Remove the key, or write the one of the right kind: `range` of a sensor, `limits` of an actuator.",
    bad="devices:\n  gps: {kind: sensor, pe: nav, limits: [0, 9]}\n  lamp: {kind: actuator, pe: tail}\n",
    good="devices:\n  gps: {kind: sensor, pe: nav, range: [0, 9]}\n  lamp: {kind: actuator, pe: tail}\n",
)
