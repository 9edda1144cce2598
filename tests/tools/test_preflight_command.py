"""`heronry preflight` without processes: what is silent on a bus, and what a status tells beside its troubles."""

from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

import pytest

from heronry_dg.configuration import Configuration
from heronry_dg.loader import load
from heronry_dg.model import Spec
from heronry_dg.situation import Situation, survivors
from heronry_dg.traffic import hops, identifiers
from heronry_manager.planner.exact import plan
from heronry_tools.cli import main
from heronry_tools.preflight.inputs import WiredInputs
from heronry_tools.preflight.told import (
    assess_contingencies,
    assess_key,
    assess_spec,
    files_of,
    journal_folder,
    silent_data,
)
from heronry_tools.reports.findings import Finding
from heronry_wire.authentication import Key
from heronry_wire.canaerospace import DataType, Datum, encode_data
from heronry_wire.frame import Frame
from heronry_wire.identifiers import actuator_echo_id

BIG_BLUE = load(Path("dg_specs/big_blue.dg.yaml"))
ALL_UP = Situation(phase="glide")
MS = 1_000_000
BUSES = ("can0", "radio")


@pytest.fixture(scope="module")
def running() -> Configuration:
    return plan(BIG_BLUE, ALL_UP, None).configuration


def data_frames(
    spec: Spec, running: Configuration, silent: Collection[tuple[str, str]], end_ms: int
) -> Iterator[tuple[str, int, Frame]]:
    """All data of a configuration in their periods, without those of some producers and variables."""
    given = identifiers(spec)
    for hop in hops(survivors(spec, ALL_UP), running):
        if (hop.producer, hop.variable) in silent:
            continue
        period_ns = 10**12 // spec.modules[hop.producer].modes[hop.mode].rate_mhz
        node = spec.pes[running.modules[hop.producer].pe].node_id
        frame = Frame(given[hop.producer, hop.variable], bytes((node, DataType.ULONG, 0, 0, 0, 0, 0, 0)))
        yield from ((hop.bus, t_ns, frame) for t_ns in range(0, end_ms * MS, period_ns))


def echoes(spec: Spec, running: Configuration, end_ms: int) -> Iterator[tuple[str, int, Frame]]:
    """The output of each module that runs, ten times a second."""
    positions = list(spec.modules)
    for name, one in running.modules.items():
        module, node = spec.modules[name], spec.pes[one.pe].node_id
        datum = Datum(node, DataType.ULONG, 0, 7, positions.index(name))
        if module.device is not None:
            datum = Datum(node, DataType.FLOAT, list(spec.devices).index(module.device), 7, 1.0)
        frame = encode_data(actuator_echo_id(node), datum)
        yield from (("can0", t_ns, frame) for t_ns in range(0, end_ms * MS, 100 * MS))


def found(
    running: Configuration,
    *,
    silent: Collection[tuple[str, str]] = (),
    mute: Collection[str] = (),
    buses: Collection[str] = BUSES,
) -> list[Finding]:
    """What is found after listening for as long as it takes."""
    inputs = WiredInputs(BIG_BLUE, running, ALL_UP, buses, 0)
    end_ms = inputs.patience_ns // MS + 500
    heard = Configuration({name: one for name, one in running.modules.items() if name not in mute})
    frames = [*data_frames(BIG_BLUE, running, silent, end_ms), *echoes(BIG_BLUE, heard, end_ms)]
    for bus, t_ns, frame in sorted(frames, key=lambda one: one[1]):
        if bus in buses:
            inputs.take(bus, t_ns, frame)
    return list(inputs.findings(end_ms * MS))


def test_fresh_data_and_all_functions_are_right(running: Configuration) -> None:
    data, functions = found(running)
    assert data.is_right
    assert data.says.startswith("fresh data come on ")
    assert functions.is_right


def wrong_of(findings: Collection[Finding]) -> list[str]:
    return [one.says for one in findings if not one.is_right]


def test_of_silent_data_the_cause_alone_is_named(running: Configuration) -> None:
    """And nothing that is computed from it, directly or not."""
    chain = ("attitude_filter", "guidance", "elevator_control")
    silent = [datum for datum in identifiers(BIG_BLUE) if datum[0] in chain]
    first, *_ = wrong = wrong_of(found(running, silent=silent))
    assert first.startswith("attitude_filter on nav gives no ")
    assert "due every 25 ms), which goes to elevator_control, " in first
    assert sum(" gives " in one for one in wrong) == 1, wrong
    assert any("which follows from the above" in one for one in wrong)


def test_what_is_on_no_bus_is_named_where_its_reader_reports_it(running: Configuration) -> None:
    inputs = WiredInputs(BIG_BLUE, running, ALL_UP, BUSES, 0)
    end_ms = inputs.patience_ns // MS + 500
    silent = [datum for datum in identifiers(BIG_BLUE) if datum[0] == "air_data"]
    frames = [*data_frames(BIG_BLUE, running, silent, end_ms), *echoes(BIG_BLUE, running, end_ms)]
    for bus, t_ns, frame in sorted(frames, key=lambda one: one[1]):
        inputs.take(bus, t_ns, frame)
    status = {
        "silences": [
            {"module": "air_data", "by": "air", "variable": "differential_pressure", "producer": "pitot_driver"},
            {"module": "horizon_attitude", "by": "air", "variable": "pitch_angle", "producer": None},
        ]
    }
    cause, more = (one for one in inputs.findings(end_ms * MS, silent_data(status)) if not one.is_right)
    assert cause.says == (
        "pitot_driver on air gives no differential_pressure (as its readers report), which goes to air_data"
    )
    assert cause.remedy == "look at device:pitot, and into the log of the agent of air"
    assert more.says == "2 more data are silent, which follows from the above"


def test_every_datum_on_a_bus_is_missed_alone(running: Configuration) -> None:
    for datum in {(hop.producer, hop.variable) for hop in hops(survivors(BIG_BLUE, ALL_UP), running)}:
        (wrong,) = wrong_of(found(running, silent=[datum]))
        assert wrong.startswith(f"{datum[0]} on {running.modules[datum[0]].pe} gives no {datum[1]} ("), datum


def test_data_of_another_node_under_the_same_identifier_do_not_count(running: Configuration) -> None:
    inputs = WiredInputs(BIG_BLUE, running, ALL_UP, BUSES, 0)
    end_ns = inputs.patience_ns + 500 * MS
    for bus, t_ns, frame in data_frames(BIG_BLUE, running, (), end_ns // MS):
        inputs.take(bus, t_ns, Frame(frame.can_id, bytes((125,)) + frame.data[1:]))
    assert all(not one.is_right for one in inputs.findings(end_ns))


def test_a_gap_counts_as_a_silence(running: Configuration) -> None:
    hop = next(hop for hop in hops(survivors(BIG_BLUE, ALL_UP), running) if hop.bus == "can0")
    inputs = WiredInputs(BIG_BLUE, running, ALL_UP, BUSES, 0)
    end_ms = inputs.patience_ns // MS + 500
    of_hop = identifiers(BIG_BLUE)[hop.producer, hop.variable]
    for bus, t_ns, frame in data_frames(BIG_BLUE, running, (), end_ms):
        if frame.can_id != of_hop or not 500 * MS < t_ns < end_ms * MS - 300 * MS:
            inputs.take(bus, t_ns, frame)
    wrong = [one.says for one in inputs.findings(end_ms * MS) if one.check == "inputs" and not one.is_right]
    assert any(f"{hop.producer} on " in one and f"gives {hop.variable} with gaps" in one for one in wrong), wrong


def test_a_function_whose_output_is_not_heard_is_named_with_its_pe(running: Configuration) -> None:
    outputs = [name for name in BIG_BLUE.functions["elevator"].outputs if name in running.modules]
    (wrong,) = (one for one in found(running, mute=outputs) if not one.is_right)
    pe = running.modules[outputs[0]].pe
    assert wrong.says == f"elevator is served as planned, but no output of {outputs[0]} on {pe} is heard"


def test_a_bus_that_is_not_heard_is_no_silence(running: Configuration) -> None:
    data, functions = found(running, buses=["can0"])
    assert data.is_right
    assert data.says.endswith("; the others are on no bus that is heard here")
    assert functions.is_right


# What the status tells beside its troubles


def told(**manager: Any) -> dict[str, Any]:
    return {
        "spec": BIG_BLUE.name,
        "spec_digest": BIG_BLUE.digest,
        "manager": {"key": None, "contingencies": None, **manager},
        "files": {"spec": "/a/b.dg.yaml", "journal": "/var/lib/x/manager-126.journal"},
    }


def test_the_spec_that_flies_is_the_one_that_is_named() -> None:
    assert assess_spec(told(), BIG_BLUE, "big_blue").is_right
    other = assess_spec({**told(), "spec_digest": "cd" * 32}, BIG_BLUE, "big_blue")
    assert "cdcdcdcd" in other.says
    assert other.remedy is not None
    assert other.remedy.startswith("heronry manager big_blue")


def test_a_key_that_is_expected_must_be_the_managers() -> None:
    key = Key(bytes(range(32)))
    assert assess_key(told(), None).is_right
    assert assess_key(told(key=key.fingerprint), key).is_right
    assert assess_key(told(key=key.fingerprint), None).is_right
    assert "has no key" in assess_key(told(), key).says
    assert not assess_key(told(), key).is_right
    assert not assess_key(told(key="another"), key).is_right


def test_plans_made_ahead_are_asked_for_by_the_spec() -> None:
    made = {"plans": 40, "on_board": {"flight": 40, "air": 12}}
    assert assess_contingencies(told(contingencies=made), BIG_BLUE, "big_blue").says == (
        "40 plans were made ahead, of which a PE has 12 or more on board"
    )
    missing = assess_contingencies(told(), BIG_BLUE, "big_blue")
    assert missing.remedy is not None
    assert missing.remedy.startswith("heronry contingencies big_blue -o FILE")


def test_the_files_of_the_manager() -> None:
    assert [str(file) for file in files_of(told())] == ["/a/b.dg.yaml", "/var/lib/x/manager-126.journal"]
    assert str(journal_folder(told())) == "/var/lib/x"
    assert journal_folder({**told(), "files": {"spec": "x", "journal": None}}) is None


# The command line


def test_without_a_manager_nothing_can_be_judged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    assert main(["preflight", "big_blue"]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert "start one with 'heronry manager SPEC'" in printed.err


def test_a_bus_that_the_spec_does_not_have_and_a_strange_time_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    socket = ["--socket", str(tmp_path / "none.sock")]
    assert main(["preflight", "big_blue", "--bus", "can7=softbus:x", *socket]) == 2
    assert "spec big_blue has no such bus" in capsys.readouterr().err
    assert main(["preflight", "big_blue", "--seconds", "0", *socket]) == 2
    assert "--seconds 0: listen for more than 0" in capsys.readouterr().err
