"""How the planner keeps each semantics rule and each level, one story at a time, on specs of a few modules."""

from collections.abc import Iterable

import pytest

from heronry_dg.loader import load, loads
from heronry_dg.model import Spec
from heronry_dg.objective import Placement, placement
from heronry_dg.plan import Plan
from heronry_dg.shipped import shipped_spec_path
from heronry_dg.situation import situation
from heronry_dg.verify import verify
from heronry_manager.planner.exact import plan

TWO_PES = """
dg: 1
name: test
buses: {can0: {bitrate: 125000}}
pes:
  left: {node_id: 92, buses: [can0], cpu: 1, ram: 10KiB, flash: 10KiB}
  right: {node_id: 93, buses: [can0], cpu: 1, ram: 10KiB, flash: 10KiB}
"""

A_CHAIN = """
dg: 1
name: test
buses:
  near: {bitrate: 125000}
  far: {bitrate: 10000, kind: wireless}
manager: {bus: near}
pes:
  left: {node_id: 92, buses: [near], cpu: 1, ram: 10KiB, flash: 10KiB}
  gateway: {node_id: 93, buses: [near, far], cpu: 1, ram: 10KiB, flash: 10KiB}
  right: {node_id: 94, buses: [far], cpu: 1, ram: 10KiB, flash: 10KiB}
"""


def planned(
    spec: Spec,
    down: Iterable[str] = (),
    limits: Iterable[str] = (),
    phase: str | None = None,
    running: Placement | None = None,
) -> Plan:
    now = situation(spec, down, limits, phase)
    found = plan(spec, now, running)
    assert found.optimal
    assert verify(spec, now, found.configuration) == []
    return found


def places(found: Plan) -> dict[str, str]:
    return {name: running.pe for name, running in found.configuration.modules.items()}


def modes(found: Plan) -> dict[str, str]:
    return {name: running.mode for name, running in found.configuration.modules.items()}


def served(found: Plan) -> set[str]:
    return {name for name, report in found.functions.items() if report.served}


def test_a_class_a_function_goes_before_any_number_of_others() -> None:
    spec = loads(
        TWO_PES
        + """
variables: {}
modules:
  vital: {runs_on: [left], cpu: 0.8, ram: 1KiB, rate_hz: 10}
  nice_1: {runs_on: [left], cpu: 0.5, ram: 1KiB, rate_hz: 10}
  nice_2: {runs_on: [left], cpu: 0.5, ram: 1KiB, rate_hz: 10}
functions:
  vital: {output: vital, criticality: A, priority: 1}
  nice_1: {output: nice_1, criticality: B, priority: 1000}
  nice_2: {output: nice_2, priority: 1000}
""",
        "test",
    )
    assert served(planned(spec)) == {"vital"}


@pytest.mark.parametrize(("priority", "wanted"), [(3, {"good": "full"}), (5, {"good": "half", "other": "only"})])
def test_within_a_class_the_greater_utility_wins(priority: int, wanted: dict[str, str]) -> None:
    """Full alone is worth 1000; half and the other one 600, and a hundred times its priority."""
    spec = loads(
        TWO_PES
        + f"""
variables: {{}}
modules:
  good:
    runs_on: [left]
    modes: {{full: {{cpu: 0.7, ram: 1KiB, rate_hz: 10}}, half: {{cpu: 0.4, ram: 1KiB, rate_hz: 10}}}}
  other: {{runs_on: [left], cpu: 0.5, ram: 1KiB, rate_hz: 10}}
functions:
  good: {{output: good, priority: 10, value: [100, 60]}}
  other: {{output: other, priority: {priority}}}
""",
        "test",
    )
    assert modes(planned(spec)) == wanted


VOTER = """
variables: {height: {type: FLOAT, versions: 3}, verdict: {type: UCHAR}}
modules:
  gps: {gives: {height: 1}, cpu: 0.1, ram: 1KiB, rate_hz: 10}
  baro_1: {gives: {height: 2}, cpu: 0.1, ram: 1KiB, rate_hz: 10}
  baro_2: {gives: {height: 3}, cpu: 0.1, ram: 1KiB, rate_hz: 10}
  voter:
    {needs: {or: {k: 2, of: [height@1, height@2, height@3]}}, gives: {verdict: 1}, cpu: 0.1, ram: 1KiB, rate_hz: 10}
functions: {vote: {output: voter, criticality: A}}
"""


def test_a_voter_gets_all_votes_there_are_and_does_not_run_on_one() -> None:
    spec = loads(TWO_PES + VOTER, "test")
    assert set(modes(planned(spec))) == {"gps", "baro_1", "baro_2", "voter"}
    assert set(modes(planned(spec, down=["module:gps"]))) == {"baro_1", "baro_2", "voter"}
    assert modes(planned(spec, down=["module:gps", "module:baro_1"])) == {}


def test_an_optional_input_is_left_out_when_its_source_has_no_room() -> None:
    spec = loads(
        TWO_PES
        + """
variables: {wind: {type: FLOAT}}
modules:
  wind_model: {gives: {wind: 1}, cpu: 0.8, ram: 1KiB, rate_hz: 10}
  pilot: {needs: {or: {k: 0, of: [wind]}}, runs_on: [left], cpu: 0.3, ram: 1KiB, rate_hz: 10}
functions: {fly: {output: pilot, criticality: A}}
""",
        "test",
    )
    assert places(planned(spec)) == {"wind_model": "right", "pilot": "left"}
    assert planned(spec).objective.inputs == 1
    assert places(planned(spec, down=["pe:right"])) == {"pilot": "left"}
    assert places(planned(spec, limits=["pe:right=50%"])) == {"pilot": "left"}


FEEDBACK = """
variables: {a: {type: FLOAT, initial: 0}, b: {type: FLOAT}, out: {type: FLOAT}}
modules:
  observer: {needs: {or: {k: 0, of: [b]}}, gives: {a: 1}, cpu: 0.1, ram: 1KiB, rate_hz: 10}
  model: {needs: a, gives: {b: 1}, cpu: 0.1, ram: 1KiB, rate_hz: 10}
  controller: {needs: NEEDS, cpu: 0.1, ram: 1KiB, rate_hz: 10}
functions: {control: {output: controller, criticality: A}}
"""


def test_two_modules_that_feed_only_each_other_do_not_run() -> None:
    spec = loads(TWO_PES + FEEDBACK.replace("NEEDS", "{or: {k: 0, of: [out]}}"), "test")
    assert set(modes(planned(spec))) == {"controller"}


def test_a_loop_that_a_choice_has_passed_over_does_not_run_for_its_own_inputs() -> None:
    text = FEEDBACK.replace("NEEDS", "{xor: [{var: a, worth: [1]}, {var: better, worth: [9]}]}")
    text = text.replace("b: {type", "better: {type: FLOAT}, b: {type")
    source = "  source: {gives: {better: 1}, cpu: 0.1, ram: 1KiB, rate_hz: 10}\nfunctions:"
    spec = loads(TWO_PES + text.replace("functions:", source), "test")
    assert set(modes(planned(spec))) == {"controller", "source"}
    assert set(modes(planned(spec, down=["module:source"]))) == {"controller", "observer", "model"}


def test_a_loop_runs_as_soon_as_one_of_its_modules_serves() -> None:
    spec = loads(TWO_PES + FEEDBACK.replace("NEEDS", "a"), "test")
    found = planned(spec)
    assert set(modes(found)) == {"observer", "model", "controller"}
    assert found.objective.inputs == 1  # the feedback, which is optional


def test_a_module_may_feed_itself_but_does_not_serve_by_that() -> None:
    spec = loads(
        TWO_PES
        + """
variables: {state: {type: FLOAT, initial: 0}}
modules:
  filter: {needs: {or: {k: 0, of: [state]}}, gives: {state: 1}, cpu: 0.1, ram: 1KiB, rate_hz: 10}
  other: {cpu: 0.1, ram: 1KiB, rate_hz: 10}
  reader: {needs: state, cpu: 0.1, ram: 1KiB, rate_hz: 10}
functions: {read: {output: reader, priority: {default: 0, late: 1}}, other: {output: other}}
phases: {early: {}, late: {}}
""",
        "test",
    )
    assert set(modes(planned(spec, phase="early"))) == {"other"}
    late = planned(spec, phase="late")
    assert set(modes(late)) == {"filter", "reader", "other"}
    assert late.configuration.modules["filter"].inputs["0"].producer == "filter"


SENDER = """
variables: {data: {type: FLOAT, versions: 2}}
modules:
  sender:
    runs_on: [left]
    modes:
      fast: {gives: {data: 1}, cpu: 0.1, ram: 1KiB, rate_hz: 50}
      slow: {gives: {data: 2}, cpu: 0.1, ram: 1KiB, rate_hz: 5}
  reader:
    runs_on: [right, gateway]
    modes:
      live: {needs: "data@1", cpu: 0.1, ram: 1KiB, rate_hz: 50}
      late: {needs: data, cpu: 0.1, ram: 1KiB, rate_hz: 5}
functions: {read: {output: reader, criticality: A, value: [100, 40]}}
"""


def test_data_that_does_not_fit_through_a_gateway_is_read_before_it() -> None:
    # 135 bits 50 times a second are 6750 bit/s, and 7000 are for data; a tenth less, and the reader stays near.
    spec = loads(A_CHAIN + SENDER, "test")
    assert places(planned(spec))["reader"] == "gateway"  # fits both, and takes one bus less there
    far_only = loads(A_CHAIN + SENDER.replace("[right, gateway]", "[right]"), "test")
    assert modes(planned(far_only)) == {"sender": "fast", "reader": "live"}
    assert planned(far_only).objective.bus_bits_per_s == 2 * 6750
    shrunk = planned(far_only, limits=["bus:far=90%"])
    assert modes(shrunk) == {"sender": "slow", "reader": "late"}
    assert shrunk.buses["far"].bits_per_s == 675
    assert served(planned(far_only, limits=["bus:far=0%"])) == set()


def test_one_reader_more_on_a_bus_costs_nothing() -> None:
    spec = loads(
        A_CHAIN
        + """
variables: {data: {type: FLOAT}}
modules:
  sender: {runs_on: [left], gives: {data: 1}, cpu: 0.1, ram: 1KiB, rate_hz: 50}
  reader_1: {needs: data, runs_on: [right], cpu: 0.1, ram: 1KiB, rate_hz: 5}
  reader_2: {needs: data, runs_on: [right], cpu: 0.1, ram: 1KiB, rate_hz: 5}
functions: {one: {output: reader_1}, two: {output: reader_2}}
""",
        "test",
    )
    assert planned(spec).objective.bus_bits_per_s == 2 * 6750


DEADLINES = """
variables:
  urgent: {type: FLOAT, identifier: 300}
  patient: {type: FLOAT, identifier: 301, deadline_ms: DEADLINE}
modules:
  sender_1: {runs_on: [left], gives: {urgent: 1}, cpu: 0.1, ram: 1KiB, rate_hz: 10}
  sender_2: {runs_on: [left], gives: {patient: 1}, cpu: 0.1, ram: 1KiB, rate_hz: 10}
  reader_1: {needs: urgent, runs_on: [right], cpu: 0.1, ram: 1KiB, rate_hz: 10}
  reader_2: {needs: patient, runs_on: [right], cpu: 0.1, ram: 1KiB, rate_hz: 10}
functions: {one: {output: reader_1, priority: 2}, two: {output: reader_2, priority: 1}}
"""


@pytest.mark.parametrize(
    ("deadline_ms", "expected"),
    [
        # Blocking, four frames of management, the urgent datum, the patient one: 7 frames of 135 bits at 125 kbit/s.
        ("7.56", {"one", "two"}),
        ("7.55", {"one"}),  # together they are late, so the better one is served
        ("6.47", {"one"}),  # late even alone
    ],
)
def test_messages_that_make_each_other_late_are_not_sent_together(deadline_ms: str, expected: set[str]) -> None:
    spec = loads(TWO_PES + DEADLINES.replace("DEADLINE", deadline_ms), "test")
    assert served(planned(spec)) == expected


TWO_WAYS = """
dg: 1
name: test
buses:
  near: {bitrate: 20000, heartbeat_ms: 200}
  far: {bitrate: 20000, heartbeat_ms: 200}
manager: {bus: near}
pes:
  left: {node_id: 92, buses: [near], cpu: 1, ram: 10KiB, flash: 10KiB}
  gateway: {node_id: 93, buses: [near, far], cpu: 1, ram: 10KiB, flash: 10KiB}
  right: {node_id: 94, buses: [far], cpu: 1, ram: 10KiB, flash: 10KiB}
  next_to_it: {node_id: 95, buses: [far], cpu: 1, ram: 10KiB, flash: 10KiB}
variables:
  jittery: {type: FLOAT, identifier: 300, deadline_ms: 300}
  tight: {type: FLOAT, identifier: 301, deadline_ms: 60}
modules:
  sender: {runs_on: [left, right], gives: {jittery: 1}, cpu: 0.1, ram: 1KiB, rate_hz: 12.5}
  reader: {needs: jittery, runs_on: [left, right], cpu: 0.1, ram: 1KiB, rate_hz: 10}
  sensor: {runs_on: [right], gives: {tight: 1}, cpu: 0.1, ram: 1KiB, rate_hz: 10}
  loop: {needs: tight, runs_on: [next_to_it], cpu: 0.1, ram: 1KiB, rate_hz: 10}
functions: {report: {output: reader}, control: {output: loop}}
separate: [[sender, reader]]
"""


def test_a_message_that_makes_another_one_late_by_one_way_may_take_the_other() -> None:
    """Coming from `near` it brings jitter to `far`; beginning there it does not, and crosses to `near` all the same."""
    spec = loads(TWO_WAYS, "test")
    running = {
        "sender": ("only", "left"),
        "reader": ("only", "right"),
        "sensor": ("only", "right"),
        "loop": ("only", "next_to_it"),
    }
    alone = planned(spec, down=["module:loop"], running=running)
    assert (places(alone)["sender"], places(alone)["reader"]) == ("left", "right")
    both = planned(spec, running=running)
    assert served(both) == {"report", "control"}
    assert (places(both)["sender"], places(both)["reader"]) == ("right", "left")


def test_separate_modules_share_no_pe_and_one_of_them_yields_when_only_one_is_left() -> None:
    spec = loads(
        TWO_PES
        + """
variables: {}
modules:
  first: {cpu: 0.1, ram: 1KiB, rate_hz: 10}
  second: {cpu: 0.1, ram: 1KiB, rate_hz: 10}
functions: {one: {output: first, priority: 2}, two: {output: second}}
separate: [[first, second]]
""",
        "test",
    )
    assert set(places(planned(spec)).values()) == {"left", "right"}
    assert served(planned(spec, down=["pe:left"])) == {"one"}


def test_modules_kept_together_share_a_pe_if_both_run() -> None:
    text = (
        TWO_PES
        + """
variables: {}
modules:
  first: {cpu: 0.6, ram: 1KiB, rate_hz: 10, runs_on: [left]}
  second: {cpu: CPU, ram: 1KiB, rate_hz: 10}
functions: {one: {output: first, priority: 2}, two: {output: second}}
together: [[first, second]]
"""
    )
    assert places(planned(loads(text.replace("CPU", "0.4"), "test"))) == {"first": "left", "second": "left"}
    crowded = loads(text.replace("CPU", "0.5"), "test")
    assert served(planned(crowded)) == {"one"}
    assert served(planned(crowded, down=["module:first"])) == {"two"}


def test_of_equal_plans_the_one_with_the_fewest_changes_is_taken_and_empty_is_not_unknown() -> None:
    spec = loads(
        TWO_PES
        + """
variables: {}
modules:
  first: {cpu: 0.1, ram: 1KiB, rate_hz: 10}
  second: {cpu: 0.1, ram: 1KiB, rate_hz: 10}
functions: {one: {output: first}, two: {output: second}}
""",
        "test",
    )
    for first in ("left", "right"):
        for second in ("left", "right"):
            kept = planned(spec, running={"first": ("only", first), "second": ("only", second)})
            assert places(kept) == {"first": first, "second": second}
            assert kept.objective.changes == 0
    assert planned(spec, running={}).objective.changes == 2
    assert planned(spec, running=None).objective.changes == 0
    moved = planned(spec, down=["pe:left"], running={"first": ("only", "left"), "second": ("only", "right")})
    assert moved.objective.changes == 1


def test_a_running_module_that_is_not_wanted_any_more_is_stopped() -> None:
    spec = loads(
        TWO_PES
        + """
variables: {}
modules: {camera: {cpu: 0.1, ram: 1KiB, rate_hz: 10}, log: {cpu: 0.1, ram: 1KiB, rate_hz: 10}}
functions: {camera: {output: camera, priority: {default: 1, landing: 0}}, log: {output: log}}
phases: {cruise: {}, landing: {}}
""",
        "test",
    )
    cruise = planned(spec)
    landing = planned(spec, phase="landing", running=placement(cruise.configuration))
    assert set(modes(landing)) == {"log"}
    assert landing.objective.changes == 1
    assert landing.functions["camera"].why_not == "it is not wanted in phase landing"


def test_flash_is_counted_for_the_modules_that_run_there() -> None:
    spec = loads(
        TWO_PES
        + """
variables: {}
modules:
  first: {flash: 6KiB, cpu: 0.1, ram: 1KiB, rate_hz: 10}
  second: {flash: 6KiB, cpu: 0.1, ram: 1KiB, rate_hz: 10}
  third: {flash: 6KiB, cpu: 0.1, ram: 1KiB, rate_hz: 10}
functions: {one: {output: first, priority: 3}, two: {output: second, priority: 2}, three: {output: third}}
""",
        "test",
    )
    assert served(planned(spec)) == {"one", "two"}


def test_levels_that_are_merged_are_compared_exactly() -> None:
    """The sum of three such classes is greater than what floating point tells apart, and they differ by 1."""
    spec = loads(
        TWO_PES
        + """
variables: {}
modules:
  a: {cpu: 0.1, ram: 1KiB, rate_hz: 10}
  b: {cpu: 0.1, ram: 1KiB, rate_hz: 10}
  first: {runs_on: [left], cpu: 0.6, ram: 1KiB, rate_hz: 10}
  second: {runs_on: [left], cpu: 0.6, ram: 1KiB, rate_hz: 10}
functions:
  a: {output: a, criticality: A, priority: 1000000}
  b: {output: b, criticality: B, priority: 1000000}
  one: {output: first, criticality: C, priority: 999999}
  two: {output: second, criticality: C, priority: 1000000}
""",
        "test",
    )
    assert served(planned(spec)) == {"a", "b", "two"}


def test_a_search_without_effort_gives_a_legal_plan_and_says_how_good_it_could_be() -> None:
    spec = loads(TWO_PES + VOTER, "test")
    found, best = plan(spec, situation(spec), effort=0), plan(spec, situation(spec))
    assert verify(spec, found.now, found.configuration) == []
    assert not found.optimal
    assert not all(level.proven for level in found.levels)
    assert all(level.proven for level in best.levels)
    utility = {level.level: level for level in found.levels}["utility"]
    assert utility.bound is not None
    assert utility.value <= best.objective.utility <= utility.bound


def test_a_search_cut_short_gives_a_legal_plan_and_says_whether_it_is_proven() -> None:
    """Effort is counted in the solver's work, so the same cut gives the same plan on every machine."""
    spec = load(shipped_spec_path("big_blue"))
    now = situation(spec, phase="glide")
    best = plan(spec, now)
    for effort in (0.0001, 0.001, 0.01, 0.1):
        found = plan(spec, now, effort=effort)
        assert verify(spec, now, found.configuration) == []
        assert found.objective.key() <= best.objective.key()
        assert found.objective.key() == best.objective.key() or not found.optimal
        assert found == plan(spec, now, effort=effort)
        first_unproven = next((i for i, level in enumerate(found.levels) if not level.proven), len(found.levels))
        assert found.objective.key()[:first_unproven] == best.objective.key()[:first_unproven]
    assert not plan(spec, now, effort=0.0001).optimal
