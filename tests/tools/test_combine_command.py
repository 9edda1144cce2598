"""`heronry combine`: two vehicles' specs become one.

The judge of a combination is the model: each vehicle's elements are looked up in the combined spec under the names that
they have there, and must be what they were. That a lost radio leaves each vehicle its own plan is tried on random
vehicles, whose names clash wherever they can.
"""

import random
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from heronry_dg.gates import leaves
from heronry_dg.loader import load, loads
from heronry_dg.model import Spec
from heronry_dg.shipped import shipped_spec_path
from heronry_dg.situation import Situation, hosts_when_all_is_up
from heronry_manager.planner.exact import plan
from heronry_tools.analysis.combine.combining import joined
from heronry_tools.analysis.combine.joining import Choices, CombineError
from heronry_tools.analysis.combine.spec_text import Document
from heronry_tools.cli import main
from thoroughness import part_of

FLIGHTS = Path(shipped_spec_path("eav")).parent
UAV, ROVER = FLIGHTS / "uav.dg.yaml", FLIGHTS / "rover.dg.yaml"
OVER = Choices(("radio", "radio"))
HOME = """\
dg: 1
name: home
buses: {can0: {bitrate: 500000}, radio: {bitrate: 100000, kind: wireless, heartbeat_ms: 200, misses: 4}}
pes:
  gate: {node_id: 92, buses: [can0, radio], cpu: 1, ram: 64KiB, flash: 64KiB}
devices: {eye: {kind: sensor, pe: gate}, light: {kind: actuator, pe: gate}}
variables:
  view: {type: FLOAT, unit: m, identifier: 322}
  order: {type: UCHAR}
modules:
  eye_driver: {device: eye, gives: {view: 1}, cpu: 0.1, ram: 1KiB, rate_hz: 10}
  light_driver: {device: light, needs: {or: {k: 1, of: [view, order]}}, cpu: 0.1, ram: 1KiB, rate_hz: 10}
functions: {lighting: {output: light_driver, criticality: B}}
"""
GUEST = """\
# What the guest is.
dg: 1
name: guest
buses:
    can0:
        bitrate: 500000
    radio: {bitrate: 100000, kind: wireless, heartbeat_ms: 200, misses: 4}
pes:
    gate:   # of the guest
        node_id: 100
        buses: [can0, radio]
        cpu: 1
        ram: 64KiB
        flash: 64KiB
devices:
    eye: {kind: sensor, pe: gate}
variables: {"view": {type: FLOAT, unit: m, identifier: 322}, order: {type: UCHAR}, best: {type: FLOAT, identifier: 326}}
gates:
    seen: {and: ["view@1"]}
modules:
    # It looks.
    eye_driver:
        device: eye
        gives: {view: 1}
        cpu: 0.1
        ram: 1KiB
        rate_hz: 10
    judge:
        needs: seen
        requires: [ ]
        gives:
            order: 1
            best: 1
        cpu: 0.1
        ram: 1KiB
        rate_hz: 10
functions:
    judging: {output: judge, criticality: C}
separate: [[eye_driver, judge]]
common_cause: [{elements: ["pe:gate", 'device:eye'], beta: 0.1}]
"""
GUEST = GUEST.replace("separate: [[eye_driver, judge]]\n", "together: [[eye_driver, judge]]\n")


def text_of(first: str, second: str, choices: Choices = OVER) -> str:
    return joined((first.encode(), "first.dg.yaml"), (second.encode(), "second.dg.yaml"), choices)[0]


def spec_of(first: str, second: str, choices: Choices = OVER) -> Spec:
    return loads(text_of(first, second, choices), "both.dg.yaml")


def test_the_papers_aircraft_and_rover_become_what_was_written_by_hand(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    file = tmp_path / "both.dg.yaml"
    words = ["combine", str(UAV), str(ROVER), "--over", "radio", "--roams", "tracked_position", "-o", str(file)]
    assert main(words) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert out.splitlines()[:3] == [
        "Over radio: comms (uav) and rover (rover).",
        "The manager is on can0.",
        "rover gives uav image_angles, image_age.",
    ]
    both, by_hand = load(file), load(shipped_spec_path("eav"))
    for section in ("buses", "pes", "devices", "variables", "demuxes", "modules", "functions", "phases"):
        assert getattr(both, section) == getattr(by_hand, section), section
    assert both.manager == by_hand.manager


def test_what_clashes_is_two_things_and_what_one_gives_is_one() -> None:
    both = spec_of(HOME, GUEST)
    assert list(both.buses) == ["can0", "radio", "guest_can0"]
    assert {pe.name: (pe.node_id, pe.buses) for pe in both.pes.values()} == {
        "gate": (92, ("can0", "radio")),
        "guest_gate": (100, ("guest_can0", "radio")),
    }
    assert both.devices["guest_eye"].pe == "guest_gate"
    assert list(both.variables) == ["view", "order", "guest_view", "best"]
    assert both.variables["guest_view"].identifier is None
    assert both.variables["best"].identifier == 326
    assert both.modules["guest_eye_driver"].image == "eye_driver"
    assert [leaf.variable for _, leaf in leaves(next(iter(both.modules["judge"].modes.values())).needs)] == [
        "guest_view"
    ]
    assert both.together == (("guest_eye_driver", "judge"),)
    assert both.common_cause[0].elements == ("pe:guest_gate", "device:guest_eye")
    assert both.modules["judge"].requires == {"guest"}
    assert hosts_when_all_is_up(both, both.modules["judge"]) == ("guest_gate",)
    assert both.manager.bus == "can0"


def test_comments_stay_and_the_head_tells_what_was_decided() -> None:
    text = text_of(HOME, GUEST)
    assert "# What the guest is.\n" in text
    assert "  guest_gate:   # of the guest\n      features: [guest]\n      node_id: 100\n" in text
    assert "  # ---- guest ----\n  # It looks.\n  guest_eye_driver:\n      image: eye_driver\n" in text
    head = text.partition("dg: 1\n")[0]
    assert "# guest gives home order.\n" in head
    assert "Renamed, with the prefix guest_: module eye_driver.\n" in head
    assert "The code of image eye_driver must learn the new names, where it names view." in head


def test_a_module_that_roams_may_run_on_both_vehicles() -> None:
    both = spec_of(HOME, GUEST.replace("together: [[eye_driver, judge]]\n", ""), replace(OVER, roams=("judge",)))
    assert hosts_when_all_is_up(both, both.modules["judge"]) == ("gate", "guest_gate")


def test_node_ids_that_clash_are_renumbered_on_request() -> None:
    guest = GUEST.replace("node_id: 100", "node_id: 92")
    both = spec_of(HOME, guest, replace(OVER, renumber=True))
    assert both.pes["guest_gate"].node_id != 92
    assert both.pes["gate"].node_id == 92


def test_a_bus_that_each_spec_names_in_its_way_is_one() -> None:
    guest = GUEST.replace("    radio: {", "    link: {").replace("[can0, radio]", "[can0, link]")
    both = spec_of(HOME, guest, over := Choices(("radio", "link")))
    assert list(both.buses) == ["can0", "radio", "guest_can0"]
    assert both.pes["guest_gate"].buses == ("guest_can0", "radio")
    assert "guest_: bus can0.\n" in text_of(HOME, guest, over)
    three = guest.replace("    can0:\n        bitrate", "    radio:\n        bitrate").replace("[can0,", "[radio,")
    assert list(spec_of(HOME, three, over).buses) == ["can0", "radio", "guest_radio"]


def test_marks_of_a_document_go_and_a_comment_at_its_end_stays() -> None:
    text = text_of(f"---\n{HOME}# of home\n...\n", f"# of nobody\n---\n{GUEST}plants: {{}}\n\n# of the guest\n...\n")
    assert not [line for line in text.splitlines() if line in ("---", "...")]
    assert list(loads(text, "both.dg.yaml").pes) == ["gate", "guest_gate"]
    assert "# of nobody\n" in text
    both = text_of(HOME, GUEST.partition("together")[0] + "    # of its end\n...\n")
    assert "# of its end\n" in both


def test_a_name_with_escapes_is_renamed_too() -> None:
    guest = GUEST.replace('"view@1"', '"v\\x69ew@1"').replace('"pe:gate"', '"pe:\\u0067ate"')
    assert loads(text_of(HOME, guest), "both.dg.yaml") == loads(text_of(HOME, GUEST), "both.dg.yaml")


PHASES = "phases: {climb: {}, land: {}}\n"


@pytest.mark.parametrize(("first", "second"), [(PHASES, ""), ("", PHASES), (PHASES, "phases:\n    land:\n")])
def test_phases_of_one_are_those_of_both(first: str, second: str) -> None:
    assert list(spec_of(HOME + first, GUEST + second).phases) == ["climb", "land"]


@pytest.mark.parametrize(
    ("first", "second", "hours"),
    [("mission_h: 2\n", "mission_h: 3\n", 3), ("mission_h: 2\n", "", 2), ("", "mission_h:\n", None)],
)
def test_the_longer_mission_and_the_greater_number_of_faults_count(first: str, second: str, hours: int | None) -> None:
    both = spec_of(
        HOME + first + "contingency: {faults: 2}\n", GUEST + second + "contingency: {faults: 1, phases: []}\n"
    )
    assert (both.mission_h, both.contingency.faults, both.contingency.phases) == (hours, 2, None)


@pytest.mark.parametrize(
    ("first", "second", "choices", "sentence"),
    [
        (HOME, GUEST, Choices(("ether", "ether")), "home has no bus 'ether'"),
        (HOME, GUEST.replace("[can0, radio]", "[can0]"), OVER, "no PE of guest is on bus 'radio'"),
        (HOME, GUEST.replace("misses: 4", "misses: 5"), OVER, "differ in misses"),
        (HOME, GUEST.replace("node_id: 100", "node_id: 92"), OVER, "--renumber"),
        (
            HOME,
            GUEST.replace("order: {type: UCHAR}", "order: {type: FLOAT}"),
            OVER,
            "variable 'order' crosses the link",
        ),
        (HOME + PHASES, GUEST + "phases: {sail: {}}\n", OVER, "contradict each other"),
        (
            HOME + "phases: {land: {when: {variable: view, below: 1}}, roll: {}}\n",
            GUEST + "phases: {land: {}}\n",
            OVER,
            "entered by different rules",
        ),
        (HOME + "manager: {bus: can0}\n", GUEST + "manager: {bus: can0}\n", OVER, "--manager home or --manager guest"),
        (HOME, GUEST + "manager: {without_manager: safe_mode}\n", OVER, "one manager remains"),
        (HOME, GUEST.replace("name: guest", "name: home"), OVER, "--prefix NAME"),
        (HOME, GUEST + "plants: {guest_eye: {seen_by: [eye]}}\n", replace(OVER, manager="nobody"), "--manager nobody"),
        (HOME, GUEST, replace(OVER, roams=("nothing",)), "no module is named 'nothing'"),
        (HOME, GUEST, replace(OVER, roams=("eye_driver",)), "its device binds module"),
        (HOME.replace("flash: 64KiB", "flash: 64KiB, features: [guest]"), GUEST, OVER, "has the feature 'guest'"),
        (
            HOME,
            GUEST.replace("eye:", "guest_eye: {kind: sensor, pe: gate}\n    eye:"),
            OVER,
            "'guest_eye' is taken, too",
        ),
    ],
)
def test_what_cannot_be_combined_is_one_sentence(first: str, second: str, choices: Choices, sentence: str) -> None:
    with pytest.raises(CombineError) as caught:
        text_of(first, second, choices)
    assert sentence in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_chosen_manager_remains() -> None:
    first, second = HOME + "manager: {bus: can0}\n", GUEST + "manager: {bus: can0, without_manager: safe_mode}\n"
    assert spec_of(first, second, replace(OVER, manager="home")).manager.bus == "can0"
    chosen = spec_of(first, second, replace(OVER, manager="guest")).manager
    assert (chosen.bus, chosen.without_manager) == ("guest_can0", "safe_mode")


def test_a_persons_file_stays(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    file = tmp_path / "mine.dg.yaml"
    file.write_text(HOME)
    words = ["combine", str(UAV), str(ROVER), "--over", "radio", "-o", str(file)]
    assert main(words) == 2
    assert "was not written by 'heronry combine', and stays" in capsys.readouterr().err
    assert file.read_text() == HOME


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["-", "-", "--over", "radio"], "standard input"),
        (["eav", "eav", "--over", "=radio"], "--over =radio"),
        (["eav", "eav", "--over", "radio", "--prefix", "1"], "--prefix 1"),
        (["eav", "eav", "--over", "radio", "-o", "both.txt"], "ends in .dg.yaml"),
    ],
)
def test_a_wrong_option_is_one_sentence(capsys: pytest.CaptureFixture[str], words: list[str], sentence: str) -> None:
    assert main(["combine", *words]) == 2
    assert sentence in capsys.readouterr().err


def test_only_a_whole_without_errors_is_written(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    first, second, file = tmp_path / "a.dg.yaml", tmp_path / "b.dg.yaml", tmp_path / "both.dg.yaml"
    first.write_text(HOME)
    second.write_text(GUEST.replace("gives:\n            order: 1\n            best: 1", "gives:\n            best: 1"))
    assert main(["combine", str(first), str(second), "--over", "radio", "-o", str(file)]) == 2
    assert "DG230 module 'light_driver' reads 'order'" in capsys.readouterr().err
    assert not file.exists()
    second.write_text(GUEST.partition("common_cause")[0])
    words = ["combine", str(first), str(second), "--over", "radio", "-o", str(file)]
    assert [main(words), main(words)] == [0, 0]  # a file that combine wrote is replaced
    assert list(load(file).modules) == ["eye_driver", "light_driver", "guest_eye_driver", "judge"]


RADIO_LINK = shipped_spec_path("big_blue").parent / "examples" / "radio_link.dg.yaml"
ON_THE_GROUND = ("ground", "display_screen", "ground_display", "display")


def test_an_aircraft_and_its_ground_station_fly_as_one(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """The example of a radio link is taken apart, and put together again."""
    whole = RADIO_LINK.read_text()
    halves = {}
    for name in ("aircraft", "station"):
        lines, document = whole.splitlines(keepends=True), Document(whole)
        for section in ("buses", "pes", "devices", "modules", "functions"):
            for element, (key, _) in document.elements(section).items():
                ours = element not in ON_THE_GROUND if name == "aircraft" else element in (*ON_THE_GROUND, "radio")
                if not ours:
                    chunk = document.chunks(section)[element]
                    begin = key.start_mark.line
                    lines[begin : begin + chunk.count("\n")] = [""] * chunk.count("\n")
        text = "".join(lines).replace("name: radio_link", f"name: {name}")
        halves[name] = tmp_path / f"{name}.dg.yaml"
        halves[name].write_text(text if name == "aircraft" else text.replace("{bus: can0}", "{bus: radio}"))
    both = tmp_path / "both.dg.yaml"
    words = ["combine", *map(str, halves.values()), "--over", "radio", "-o", str(both)]
    assert main(words) == 2
    assert "--manager aircraft or --manager station" in capsys.readouterr().err
    assert main([*words, "--manager", "aircraft"]) == 0
    assert load(both).modules == load(RADIO_LINK).modules
    assert main(["sim", str(both), "--runs", "2", "--seconds", "1"]) == 0


# Random vehicles


def vehicle(rng: random.Random, name: str, first_node: int, *, reads: str, gives: str) -> str:
    """Draw a vehicle with a gateway to the radio, whose budgets often bind; sections in brackets or without.

    reads: a variable that the other vehicle may give. gives: one that it gives the other.
    """
    pes = [f"p{i}" for i in range(rng.randint(1, 3))]
    hosts = dict.fromkeys(pes, "can0") | {"gate": "can0, radio"}
    sections: dict[str, dict[str, str]] = {
        "buses": {
            "can0": f"{{bitrate: {rng.choice((50000, 500000))}}}",
            "radio": "{bitrate: 100000, kind: wireless, heartbeat_ms: 200, misses: 4}",
        },
        "pes": {
            pe: f"{{node_id: {first_node + i}, buses: [{buses}], cpu: {rng.choice((0.1, 0.3, 1))}, ram: 64KiB, "
            f"flash: 64KiB{rng.choice(('', ', features: [fpu]', ', features: []'))}}}"
            for i, (pe, buses) in enumerate(hosts.items())
        },
        "devices": {
            "eye": f"{{kind: sensor, pe: {rng.choice(list(hosts))}}}",
            "fin": f"{{kind: actuator, pe: {rng.choice(list(hosts))}}}",
        },
        "variables": {
            "view": f"{{type: FLOAT, versions: 2{rng.choice(('', ', identifier: 322'))}}}",
            "demand": "{type: FLOAT}",
            reads: "{type: SHORT}",
            gives: "{type: SHORT}",
        },
        "gates": {"sight": f"{{or: {{k: 1, of: [view, {reads}]}}}}", "fin_out": "{demux: demand}"},
        "modules": {
            "look": "{device: eye, gives: {view: 1}, cpu: 0.05, ram: 1KiB, rate_hz: 20}",
            "guess": f"{{needs: view@1, gives: {{view: 2, {gives}: 1}}, cpu: 0.1, ram: 1KiB, rate_hz: 10"
            f"{rng.choice(('', ', runs_on: [gate]', ', requires: [fpu]'))}}}",
            "steer": f"{{gives: {{demand: 1}}, needs: {rng.choice(('sight', 'view@2', '{and: [view]}'))}, "
            f"cpu: {rng.choice((0.05, 0.2, 0.25))}, ram: 1KiB, rate_hz: 10}}",
            "move_1": "{device: fin, needs: fin_out, cpu: 0.02, ram: 1KiB, rate_hz: 10}",
            "move_2": f"{{device: fin, needs: fin_out, cpu: {rng.choice((0.01, 0.2))}, ram: 1KiB, rate_hz: 5}}",
        },
        "functions": {
            "steering": f"{{output: fin_out, criticality: {rng.choice('ABC')}}}",
            "guessing": f"{{output: guess, criticality: {rng.choice('ABCD')}, priority: {rng.randint(1, 9)}}}",
        },
    }
    lines = ["dg: 1", f"name: {name}"]
    for section, elements in sections.items():
        written = [f"{element}: {text}" for element, text in elements.items()]
        if rng.random() < 0.3:
            lines.append(f"{section}: {{{', '.join(written)}}}")
        else:
            indent = " " * rng.randint(1, 6)
            lines += [f"{section}:  # of {name}", *(f"{indent}{one}" for one in written)]
    return "\n".join(lines) + "\n"


@given(st.randoms(use_true_random=False), st.booleans())
@settings(max_examples=part_of(120), deadline=None)
def test_a_lost_radio_leaves_each_vehicle_its_own_plan(rng: random.Random, swapped: bool) -> None:
    texts = [vehicle(rng, "uav", 92, reads="far", gives="near"), vehicle(rng, "rover", 110, reads="near", gives="far")]
    first, second = reversed(texts) if swapped else texts
    own, both = loads(first, "first.dg.yaml"), spec_of(first, second)
    alone = Situation(frozenset({"bus:radio"}))
    before, after = plan(own, alone), plan(both, alone)
    assert {name: after.functions[name].served for name in own.functions} == {
        name: report.served for name, report in before.functions.items()
    }
    assert after.objective == before.objective
    for name in own.modules:
        assert replace(both.modules[name], requires=frozenset()) == replace(own.modules[name], requires=frozenset())
        assert hosts_when_all_is_up(both, both.modules[name]) == hosts_when_all_is_up(own, own.modules[name])
    guest = loads(second, "second.dg.yaml")
    assert len(both.modules) == len(own.modules) + len(guest.modules)
    for name, module in guest.modules.items():
        there = both.modules[f"{guest.name}_{name}"]
        assert (there.image, list(there.modes), there.device) == (
            module.image,
            list(module.modes),
            module.device and f"{guest.name}_{module.device}",
        )
        assert hosts_when_all_is_up(both, there) == tuple(
            f"{guest.name}_{pe}" if pe in own.pes else pe for pe in hosts_when_all_is_up(guest, module)
        )


@given(st.randoms(use_true_random=False))
@settings(max_examples=part_of(100), deadline=None)
def test_all_chunks_of_a_section_are_the_section(rng: random.Random) -> None:
    document = Document(vehicle(rng, "uav", 92, reads="far", gives="near"))
    for section in ("buses", "pes", "devices", "variables", "gates", "modules", "functions"):
        assert list(document.chunks(section)) == list(document.elements(section))
