"""Every error in the elements of a spec, each with its place and its sentence."""

import pytest

from dg.marked_spec import RUNS, SOUND, complaint, complaints, spec_text
from heronry_dg.findings import SpecError
from heronry_dg.loader import loads

PE = "cpu: 1, ram: 1KiB, flash: 1KiB"


def two_pes(first: str, second: str) -> str:
    return f"{{a: {{{first}, {PE}}}, b: {{{second}, {PE}}}}}"


def test_a_sound_spec_is_no_reason_to_complain() -> None:
    assert complaints(spec_text()) == []


HEADER = [
    ({"dg": "»2"}, "'dg' of the spec must be 1, not 2"),
    ({"name": "»9lives"}, "'name' of the spec must be a name, not '9lives' (use a letter"),
    ({"»nmae": "x"}, "the spec has no field 'nmae' (did you mean 'name'?)"),
    ({"»xyz": "x"}, "the spec has no field 'xyz' (its fields are buses,"),
    ({"buses": "»[can0]"}, "'buses' must be a map, not a list"),
    ({"pes": "»nav", "devices": "{}", "modules": "{}", "functions": "{}"}, "'pes' must be a map, not 'nav'"),
    ({"variables": "{»x-y: {type: FLOAT}}", "modules": "{}", "functions": "{}"}, "'x-y' cannot be a name"),
    ({"»buses": "{}", "pes": "{}", "devices": "{}", "modules": "{}", "functions": "{}"}, "there is no bus"),
]

BUSES = [
    ("{»can0: {}}", "bus 'can0' lacks 'bitrate'"),
    ("{can0: {bitrate: »1.5}}", "'bitrate' of bus 'can0' must be a whole number, not 1.5"),
    ("{can0: {bitrate: »0}}", "'bitrate' of bus 'can0' must be more than 0, not 0"),
    ("{can0: {bitrate: »true}}", "must be a whole number, not true"),
    ("{can0: {bitrate: »2000000}}", "bus 'can0' is wired and faster than CAN: 2000000 bit/s (at most 1000000)"),
    ("{can0: {bitrate: 1000, max_load: »1.2}}", "'max_load' of bus 'can0' must be a share from 0 to 1, not 1.2"),
    ("{can0: {bitrate: 1000, max_load: »80%}}", "must be a number, not '80%'"),
    ("{can0: {bitrate: 1000, reserve: »0.8}}", "'reserve' of bus 'can0' leaves nothing of its 'max_load' to data"),
    ("{»can0: {bitrate: 1000, max_load: 0.1}}", "'reserve' of bus 'can0' leaves nothing"),
    ("{can0: {bitrate: 1000, kind: »Wired}}", "must be 'wired' or 'wireless', not 'Wired'"),
    ("{can0: {bitrate: 1000, channels: »3}}", "'channels' of bus 'can0' must be at most 2, not 3"),
    ("{can0: {bitrate: 1000, channels: »0}}", "'channels' of bus 'can0' must be at least 1, not 0"),
    ("{can0: {bitrate: 1000, heartbeat_ms: »0}}", "'heartbeat_ms' of bus 'can0' must be more than 0"),
    ("{can0: {bitrate: 1000, heartbeat_ms: »0.0000001}}", "must not be finer than a nanosecond"),
    ("{can0: {bitrate: 1000, misses: »0}}", "must be at least 1"),
    ("{can0: {bitrate: 1000, rate_per_h: »-1}}", "must be 0 or more failures per hour"),
    ("{can0: {bitrate: 1000, »bitrte: 1}}", "bus 'can0' has no field 'bitrte' (did you mean 'bitrate'?)"),
    ("{can0: »7}", "bus 'can0' must be a map, not 7"),
]

MANAGER = [
    ({"manager": "{bus: »can1}"}, "no bus is named 'can1' (did you mean 'can0'?)"),
    ({"manager": "{without_manager: »stop}"}, "must be 'keep' or 'safe_mode', not 'stop'"),
    ({"»buses": "{can0: {bitrate: 1000, kind: wireless}}"}, "no bus is wired, and no bus is given for the manager"),
    (
        {"buses": "{can0: {bitrate: 1000}, air: {bitrate: 1000, kind: wireless}}", "manager": "{bus: »air}"},
        "the manager is on bus 'air', which is wireless (put the manager on a wired bus, such as can0)",
    ),
]

PES = [
    (f"{{»nav: {{buses: [can0], {PE}}}}}", "pe 'nav' lacks 'node_id'"),
    ("{»nav: }", "pe 'nav' lacks 'node_id', 'buses', 'cpu', 'ram' and 'flash'"),
    (f"{{nav: {{node_id: »91, buses: [can0], {PE}}}}}", "'node_id' of pe 'nav' must be at least 92, not 91"),
    (f"{{nav: {{node_id: »126, buses: [can0], {PE}}}}}", "must be at most 125, not 126"),
    (f"{{nav: {{node_id: 92, buses: [»can1], {PE}}}}}", "no bus is named 'can1' (did you mean 'can0'?)"),
    (f"{{nav: {{node_id: 92, buses: »[], {PE}}}}}", "must be a list of 1 or more, not a list"),
    (f"{{nav: {{node_id: 92, buses: »can0, {PE}}}}}", "must be a list, not 'can0' (write [a, b])"),
    (f"{{nav: {{node_id: 92, buses: »[can0, can0], {PE}}}}}", "names 'can0' twice"),
    (f"{{nav: {{node_id: 92, buses: [»7], {PE}}}}}", "must be text, not 7"),
    (f"{{nav: {{node_id: 92, buses: [can0], {PE}, features: [»1]}}}}", "'features' of pe 'nav' must be text, not 1"),
    ("{nav: {node_id: 92, buses: [can0], cpu: »0, ram: 1, flash: 1}}", "'cpu' of pe 'nav' must be more than 0, not 0"),
    ("{nav: {node_id: 92, buses: [can0], cpu: »0.0001, ram: 1, flash: 1}}", "finer than a thousandth of a core"),
    (
        "{nav: {node_id: 92, buses: [can0], cpu: »'1', ram: 1, flash: 1}}",
        "must be a number, not '1' (remove the quotes)",
    ),
    ("{nav: {node_id: 92, buses: [can0], cpu: 1, ram: »64KB, flash: 1}}", "must be a size of memory, not '64KB'"),
    ("{nav: {node_id: 92, buses: [can0], cpu: 1, ram: 1, flash: »-1}}", "must be from 0 to 1099511627776, not -1"),
    (two_pes("node_id: 92, buses: [can0]", "node_id: »92, buses: [can0]"), "pe 'b' has the node_id of pe 'a', 92"),
]

DEVICES = [
    ("{gps: {kind: sensor, pe: »nva}}", "no PE is named 'nva' (did you mean 'nav'?)"),
    ("{gps: {kind: »radar, pe: nav}}", "must be 'sensor' or 'actuator', not 'radar'"),
    ("{»gps: {pe: nav}}", "device 'gps' lacks 'kind'"),
]

VARIABLES = [
    ("{»altitude: {unit: m}}", "variable 'altitude' lacks 'type'"),
    ("{altitude: {type: »FLAOT}}", "no data type is named 'FLAOT' (did you mean 'FLOAT'?)"),
    ("{altitude: {type: FLOAT, versions: »16}}", "must be at most 15, not 16"),
    ("{altitude: {type: FLOAT, versions: »0}}", "must be at least 1, not 0"),
    ("{altitude: {type: FLOAT, unit: »1}}", "must be text, not 1 (put it in quotes"),
    ('{altitude: {type: FLOAT, unit: »"a\\"b"}}', "1 to 64 printable characters"),
    ("{altitude: {type: FLOAT, identifier: »299}}", "must be at least 300, not 299"),
    ("{altitude: {type: FLOAT, identifier: »1500}}", "must be at most 1499, not 1500"),
    ("{altitude: {type: FLOAT, deadline_ms: »-5}}", "'deadline_ms' of variable 'altitude' must be from 0"),
    ("{altitude: {type: FLOAT, initial: »abc}}", "'initial' of variable 'altitude' does not fit: FLOAT cannot carry"),
    ("{altitude: {type: FLOAT, initial: »1e39}}", "does not fit: FLOAT cannot carry"),
    ("{altitude: {type: UCHAR, initial: »256}}", "does not fit: UCHAR cannot carry 256: it takes 0..255"),
    ("{altitude: {type: UCHAR, initial: »true}}", "does not fit: no data type can carry true"),
    ("{altitude: {type: SHORT2, initial: »[1]}}", "does not fit: SHORT2 cannot carry"),
    ("{altitude: {type: FLOAT, initial: »[1]}}", "does not fit: FLOAT takes one number"),
    ("{altitude: {type: SHORT2, initial: »[1, 0.5]}}", "does not fit: a list may contain only whole numbers"),
    ("{altitude: {type: ACHAR2, initial: »abc}}", "does not fit: ACHAR2 cannot carry"),
    ("{altitude: {type: NODATA, initial: »0}}", "does not fit: NODATA cannot carry"),
    (
        "{altitude: {type: FLOAT, identifier: 322}, b: {type: FLOAT, identifier: »322}}",
        "variable 'b' has the identifier of 'altitude', 322",
    ),
]

MODULES = [
    ("{»driver: {gives: {altitude: 1}}}", "module 'driver' lacks 'cpu', 'ram' and 'rate_hz'"),
    ("{»driver: }", "module 'driver' lacks 'cpu', 'ram' and 'rate_hz'"),
    ("{driver: »[a]}", "module 'driver' must be a map, not a list"),
    (f"{{driver: {{{RUNS}, »gives_: {{}}}}}}", "module 'driver' has no field 'gives_' (did you mean 'gives'?)"),
    (f"{{driver: {{{RUNS}, device: »gsp}}}}", "no device is named 'gsp' (did you mean 'gps'?)"),
    (f"{{driver: {{{RUNS}, runs_on: [»nva]}}}}", "no PE is named 'nva' (did you mean 'nav'?)"),
    (f"{{driver: {{{RUNS}, runs_on: »[]}}}}", "must be a list of 1 or more"),
    *(
        (f"{{driver: {{{RUNS}, checkpoint: »{value}}}}}", f"must say how the state is kept, not {value}")
        for value in ("true", "0.5", "3", "'all'")
    ),
    (f"{{driver: {{{RUNS}, checkpoint: »{{bytes: 8}}}}}}", "(checkpoint) lacks 'hz' and 'max_age_ms'"),
    (
        f"{{driver: {{{RUNS}, checkpoint: {{bytes: »1276, hz: 5, max_age_ms: 100}}}}}}",
        "'checkpoint.bytes' of module 'driver' must be at most 1275, not 1276",
    ),
    (
        f"{{driver: {{{RUNS}, checkpoint: {{bytes: 8, hz: »0, max_age_ms: 100}}}}}}",
        "'checkpoint.hz' of module 'driver' must be more than 0, not 0",
    ),
    (f"{{driver: {{{RUNS}, gives: {{»altitud: 1}}}}}}", "no variable is named 'altitud' (did you mean 'altitude'?)"),
    (
        f"{{driver: {{{RUNS}, gives: {{altitude: »4}}}}}}",
        "version 4 of 'altitude' does not exist ('altitude' has versions 1 to 3)",
    ),
    (
        f"{{driver: {{{RUNS}, gives: {{command: »2}}}}}}",
        "version 2 of 'command' does not exist ('command' has version 1 alone)",
    ),
    (
        f"{{driver: {{{RUNS}, gives: {{altitude: »0}}}}}}",
        "'gives.altitude' of module 'driver' must be at least 1, not 0",
    ),
    (f"{{driver: {{{RUNS}, gives: »[altitude]}}}}", "'gives' of module 'driver' must be a map, not a list"),
    ("{driver: {cpu: 0.1, ram: 1, rate_hz: »0}}", "'rate_hz' of module 'driver' must be more than 0, not 0"),
    ("{driver: {cpu: 0.1, ram: 1, rate_hz: »0.0001}}", "must not be finer than a millihertz"),
    (f"{{driver: {{»cpu: 1, modes: {{a: {{{RUNS}}}}}}}}}", "module 'driver' has both 'modes' and a 'cpu' of its own"),
    ("{»driver: {modes: , cpu: 1}}", "module 'driver' lacks 'ram' and 'rate_hz'"),
    ("{driver: {modes: »{}}}", "module 'driver' lists no mode"),
    ("{driver: {modes: »fast}}", "'modes' of module 'driver' must be a map, not 'fast'"),
    ("{driver: {modes: {»fast: {cpu: 1}}}}", "mode 'fast' of module 'driver' lacks 'ram' and 'rate_hz'"),
    (f"{{driver: {{modes: {{fast: {{{RUNS}, »flash: 1}}}}}}}}", "mode 'fast' of module 'driver' has no field 'flash'"),
]

FUNCTIONS = [
    ("{»f: {}}", "function 'f' lacks 'output'"),
    ("{f: {output: »drive}}", "no module or DEMUX is named 'drive' (did you mean 'driver'?)"),
    (
        "{f: {output: driver, criticality: »F}}",
        "'criticality' of function 'f' must be 'A', 'B', 'C', 'D' or 'E', not 'F'",
    ),
    ("{f: {output: driver, criticality: {default: A, climb: »F}}}", "'criticality.climb' of function 'f' must be"),
    ("{f: {output: driver, criticality: »{climb: A}}}", "'criticality' of function 'f' gives no 'default'"),
    ("{f: {output: driver, criticality: {default: A, »clmb: B}}}", "no phase is named 'clmb' (did you mean 'climb'?)"),
    ("{f: {output: driver, priority: »-1}}", "'priority' of function 'f' must be at least 0, not -1"),
    ("{f: {output: driver, priority: {default: 1, »fly: 2}}}", "no phase is named 'fly' (there is climb and land)"),
    (
        "{f: {output: driver, value: »[3, 2]}}",
        "'value' of function 'f' must have a number per mode of its output: 1, not 2",
    ),
    ("{f: {output: driver, value: [»0.5]}}", "'value' of function 'f' must be a whole number, not 0.5"),
]

PHASES = [
    ("{climb: , »default: }", "a phase cannot be named 'default'"),
    ("{climb: {when: {variable: »speed, above: 1}}}", "no variable is named 'speed'"),
    ("{climb: {»when: {variable: altitude}}}", "'when' of phase 'climb' must have exactly one of 'above' and 'below'"),
    ("{climb: {»when: {variable: altitude, above: 1, below: 2}}}", "exactly one of 'above' and 'below'"),
    (
        "{climb: {when: {variable: altitude, above: »high}}}",
        "'when.above' of phase 'climb' must be a number, not 'high'",
    ),
    ("{climb: {when: {variable: altitude, »abvoe: 3, above: 1}}}", "no field 'abvoe' (did you mean 'above'?)"),
    ("{climb: {when: »{above: 1}}}", "phase 'climb' (when) lacks 'variable'"),
    ("{climb: {when: {variable: altitude, above: 1, hold_ms: »-1}}}", "must be from 0"),
    ("»[climb]", "'phases' must be a map, not a list"),
]

PLACEMENT = [
    ({"separate": "[[driver, »drivr]]"}, "no module is named 'drivr' (did you mean 'driver'?)"),
    ({"together": "[[»a, driver]]"}, "no module is named 'a' (there is driver)"),
    ({"together": "[»[driver]]"}, "must be a list of 2 or more"),
    ({"separate": "[»[driver, driver]]"}, "names 'driver' twice"),
    ({"separate": "[»driver]"}, "must be a list, not 'driver'"),
    ({"contingency": "{phases: [»fly]}"}, "no phase is named 'fly' (there is climb and land)"),
    ({"contingency": "{faults: »-1}"}, "must be at least 0, not -1"),
    ({"contingency": "{faults: »1.5}"}, "must be a whole number, not 1.5"),
]


@pytest.mark.parametrize(
    ("sections", "sentence"),
    [
        *HEADER,
        *MANAGER,
        *PLACEMENT,
        *(({"buses": text}, sentence) for text, sentence in BUSES),
        *(({"pes": text, "devices": "", "modules": "", "functions": ""}, sentence) for text, sentence in PES),
        *(({"devices": text}, sentence) for text, sentence in DEVICES),
        *(({"variables": text}, sentence) for text, sentence in VARIABLES),
        *(({"modules": text}, sentence) for text, sentence in MODULES),
        *(({"functions": text}, sentence) for text, sentence in FUNCTIONS),
        *(({"phases": text}, sentence) for text, sentence in PHASES),
    ],
)
def test_what_makes_no_sense_is_named_with_its_place(sections: dict[str, str], sentence: str) -> None:
    assert sentence in complaint(spec_text(**sections))


@pytest.mark.parametrize("field", ["node_id", "buses", "cpu", "ram", "flash"])
def test_each_field_of_a_pe_that_must_be_given_is_missed(field: str) -> None:
    fields = {"node_id": "92", "buses": "[can0]", "cpu": "1", "ram": "1KiB", "flash": "1KiB"}
    body = ", ".join(f"{name}: {value}" for name, value in fields.items() if name != field)
    assert f"lacks '{field}'" in complaint(spec_text(pes=f"{{»nav: {{{body}}}}}"))


def test_two_buses_between_the_same_pes_are_no_forest() -> None:
    buses = "{can0: {bitrate: 1000}, can1: {bitrate: 1000}}"
    pes = two_pes("node_id: 92, buses: [can0, can1]", "node_id: 93, buses: [can0, »can1]")
    text = spec_text(buses=buses, pes=pes, devices="", modules="", functions="")
    assert "bus 'can1' gives pe 'b' a second route" in complaint(text)


def test_a_ring_of_three_buses_is_no_forest_and_a_chain_of_them_is_one() -> None:
    buses = "{one: {bitrate: 1000}, two: {bitrate: 1000}, three: {bitrate: 1000}}"
    rest = {"buses": buses, "devices": "", "modules": "", "functions": ""}
    third = f"c: {{node_id: 94, buses: [three, {{}}one], {PE}}}"
    chain = two_pes("node_id: 92, buses: [one, two]", "node_id: 93, buses: [two, three]")
    assert complaints(spec_text(pes=chain, **rest)) == []
    ring = chain.removesuffix("}") + ", " + third.replace("{}one", "»one") + "}"
    assert "bus 'one' gives pe 'c' a second route" in complaint(spec_text(pes=ring, **rest))


def test_a_device_elsewhere_than_its_module_may_run() -> None:
    pes = two_pes("node_id: 92, buses: [can0]", "node_id: 93, buses: [can0]")
    modules = f"{{driver: {{device: gps, »runs_on: [b], {RUNS}}}}}"
    text = spec_text(pes=pes, devices="{gps: {kind: sensor, pe: a}}", modules=modules)
    assert "module 'driver' can run nowhere: 'gps' is on pe 'a'" in complaint(text)


def test_a_phase_rule_watches_one_number() -> None:
    text = spec_text(
        variables="{altitude: {type: FLOAT}, axes: {type: SHORT2}}",
        phases="{climb: {when: {variable: »axes, above: 1}}}",
    )
    assert "'axes' is no single number, but of type 'SHORT2'" in complaint(text)


def test_an_output_that_is_a_shorthand_or_could_be_either() -> None:
    shorthand = spec_text(gates="{g: altitude}", functions="{f: {output: »g}}")
    assert "gate 'g' is no DEMUX" in complaint(shorthand)
    either = spec_text(
        gates="{driver: {demux: command}}",
        modules=f"{{driver: {{needs: driver, {RUNS}}}, other: {{needs: driver, {RUNS}}}}}",
        functions="{f: {output: »driver}}",
    )
    assert "'driver' is the name of a module and of a DEMUX" in complaint(either)


def test_independent_mistakes_are_all_reported_at_once() -> None:
    said = complaints(
        spec_text(
            pes="{nav: {node_id: »9, buses: [can0], cpu: »x, ram: 1, flash: 1}}",
            devices="{gps: {kind: sensor, pe: nav}, imu: {kind: sensor, pe: »nva}}",
            variables="{altitude: {type: FLOAT, versions: 3}, command: {»tpye: UCHAR}}",
            modules=f"{{driver: {{device: gps, needs: »altitude@7, {RUNS}}}, »logger: }}",
            functions="{driving: {output: driver, priority: »low}}",
        )
    )
    assert len(said) == 7


def test_a_misspelt_field_is_not_missed_as_well_nor_a_misspelt_section() -> None:
    no_rate = RUNS.replace("rate_hz", "»rate")
    assert "did you mean 'rate_hz'?" in complaint(spec_text(modules=f"{{driver: {{device: gps, {no_rate}}}}}"))
    modes = f"{{driver: {{device: gps, modes: {{fast: {{{no_rate}}}}}}}}}"
    assert "did you mean 'rate_hz'?" in complaint(spec_text(modules=modes))
    phases = "{climb: , cruise: {when: {»variabel: altitude, above: 1}}}"
    assert "did you mean 'variable'?" in complaint(spec_text(phases=phases))
    assert "did you mean 'buses'?" in complaint(spec_text().replace("buses:", "»Buses:", 1))


def test_a_name_is_suggested_whatever_its_letters_case() -> None:
    assert "did you mean 'FLOAT'?" in complaint(spec_text(variables="{altitude: {type: »float}}"))
    assert "there is NODATA, ERROR, FLOAT" in complaint(spec_text(variables="{altitude: {type: »REAL}}"))


def test_a_decimal_comma_and_a_separator_of_thousands_are_recognized() -> None:
    ends = "a comma ends the value here, so"
    assert f"{ends} '5' is no part of the number" in complaint(
        spec_text(devices="{gps: {kind: sensor, pe: nav, rate_per_h: 0,»5}}")
    )
    modules = f"{{driver: {{device: gps, {RUNS.replace('rate_hz: 10', 'rate_hz: 1,»000')}}}}}"
    assert f"{ends} '000' is no part of the number" in complaint(spec_text(modules=modules))
    assert "is not text" in complaint(spec_text(phases="{climb: , »2: }"))


def test_a_broken_element_is_still_there_for_those_that_name_it() -> None:
    """One mistake in a PE, a variable and a module: not one more about the device, gate and function that name them."""
    said = complaints(
        spec_text(
            pes="{nav: {node_id: »9, buses: [can0], cpu: 1, ram: 1, flash: 1}}",
            variables="{altitude: {type: FLOAT, versions: »99}, command: {type: UCHAR}}",
            gates="{out: {demux: altitude}}",
            modules=f"{{a: {{needs: out, {RUNS}}}, b: {{needs: out, {RUNS}, flash: »big}}}}",
            functions="{driving: {output: out, value: [1, 2, 3]}}",
        )
    )
    assert len(said) == 3


def test_an_error_prints_one_line_per_finding_with_file_line_column_and_remedy() -> None:
    text = spec_text(manager="{bus: can1}", variables="{altitude: {type: FLAOT}}")
    with pytest.raises(SpecError) as caught:
        loads(text, "wing.dg.yaml")
    assert str(caught.value).split("\n") == [
        "wing.dg.yaml:5:30: DG117 error: no data type is named 'FLAOT' (did you mean 'FLOAT'?)",
        "wing.dg.yaml:9:16: DG201 error: no bus is named 'can1' (did you mean 'can0'?)",
    ]


@pytest.mark.parametrize("section", [name for name in SOUND if name not in {"dg", "buses"}])
def test_a_section_without_a_value_counts_as_left_out(section: str) -> None:
    dependent = {
        "pes": ["devices", "modules", "functions"],
        "devices": ["modules", "functions"],
        "modules": ["functions"],
    }
    dependent["variables"] = ["modules", "functions"]
    assert complaints(spec_text(**dict.fromkeys([section, *dependent.get(section, [])], ""))) == []


@pytest.mark.parametrize(
    ("keys", "sentence"),
    [
        ('{"spec": "x", "modules": {}, "functions": {}, "objective": {}, "a": 1, "b": 2}', "it is a plan, as"),
        ('{"format": 1, "spec_digest": "x", "node_id": 92, "a": 1}', "it is the table of a PE"),
        ("pcs: 1\nname: g\n", "it is a component graph"),
        ("a: 1\nb: 2\nc: 3\n", "no field of the file is a field of a spec"),
    ],
)
def test_a_file_of_another_kind_is_one_finding(keys: str, sentence: str) -> None:
    with pytest.raises(SpecError) as caught:
        loads(keys, "plan.json")
    (only,) = caught.value.findings
    assert only.code == "DG103"
    assert sentence in only.sentence


def test_a_spec_without_its_first_line_is_still_read() -> None:
    with pytest.raises(SpecError) as caught:
        loads("name: x\nbuses: {can0: {bitrat: 1000000}}\n", "my.dg.yaml")
    assert {"DG103", "DG102"} <= {finding.code for finding in caught.value.findings}
