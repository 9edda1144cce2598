"""The EAV in the simulator: every datum through modules, frames and plans."""

import json
import subprocess
import sys

import pytest

from heronry_dg.loader import load
from heronry_dg.shipped import shipped_spec_path
from heronry_tools.cli import main
from heronry_tools.fly.campaign import Drawn, drawn_blow, summary
from heronry_tools.fly.flight import EavFlight
from heronry_tools.fly.mission import Blow, Mission

SPEC = load(shipped_spec_path("eav"))


def flown(**mission):
    return EavFlight(SPEC, Mission(**mission)).fly()


def test_with_the_rover_it_lands():
    """The monitor finds the lost corrections, the plan moves to the filter, and no oracle has an objection."""
    landing, record = flown(seed=1, judged=True)
    assert landing.causes == ()
    assert landing.violations == ()
    assert landing.worst_height_error_m < 1.5
    filters = [stretch for stretch in record.stretches if stretch.subject == "tracked_position"]
    assert filters
    assert 2.0 < filters[0].start_s < 3.0
    kinds = [mark.kind for mark in record.marks if mark.kind != "note"]
    assert kinds == ["reconfigured", "reconfigured", "touchdown"]
    stages = [stretch.label for stretch in record.stretches if stretch.kind == "mode"]
    assert stages == ["approach", "glide slope", "transition", "flare"]


def test_without_the_rover_the_landing_is_refused():
    landing, record = flown(seed=1, has_rover=False, corrections_lost_s=4.0)
    assert landing.went_around
    refused = next(mark for mark in record.marks if mark.kind == "refused")
    assert 4.0 < refused.time_s < 4.6, "the monitor finds the loss, and finds none before"
    assert landing.touchdown is None
    assert landing.mode == "waiting"


def test_a_dead_pe_moves_what_it_ran():
    landing, record = flown(seed=2, blows=(Blow("pe:nav_a", at_s=3.0),), longest_s=6.0)
    assert 0.0 < landing.reconfigured_after_s < 0.5
    last = [stretch.label for stretch in record.stretches if stretch.subject == "flight_management"][-1]
    assert "nav_a" not in last


def digest_in_another_process():
    code = (
        "from heronry_dg.loader import load; from heronry_dg.shipped import shipped_spec_path;"
        "from heronry_tools.fly.flight import EavFlight; from heronry_tools.fly.mission import Mission;"
        "print(EavFlight(load(shipped_spec_path('eav')), Mission(seed=7, longest_s=2.5)).fly()[0].digest)"
    )
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip()


def test_one_seed_is_one_flight():
    """Twice in this process, whose planner has met the situations before, with oracles too, and in another process."""
    digests = {flown(seed=7, longest_s=2.5, judged=judged)[0].digest for judged in (False, True)}
    digests.add(digest_in_another_process())
    assert len(digests) == 1
    assert flown(seed=8, longest_s=1.0)[0].digest not in digests


def test_the_command_tells_how_it_ended_and_draws_it(capsys, tmp_path):
    page = tmp_path / "flight.html"
    words = ["--without-rover", "--corrections-lost", "6", "--report", str(page), "--json"]
    assert main(["fly", "eav", *words]) == 0
    assert "<svg" in page.read_text()
    flight, figures = map(json.loads, capsys.readouterr().out.splitlines())
    assert flight["went_around"]
    assert flight["causes"] == ["not landed"]
    assert (figures["runs"], figures["acceptable"], figures["causes"]) == (1, 0, {"not landed": 1})
    assert figures["interval"][0] == 0.0


@pytest.mark.parametrize(
    ("option", "value", "said"),
    [
        ("--kill", "pe:nobody@3", "--kill pe:nobody@3: no PE is named 'nobody'; there is nav_a, "),
        (
            "--kill",
            "pe:nav_a=stuck@3",
            "'=stuck' can stand only after a device; leave '=stuck' out",
        ),
        ("--kill", "pe:nav_a@soon", "is not a number"),
        ("--kill", "pe:nav_a@-2m", "is not between"),
        ("--kill", "nav_a@3", "write pe:NAME@WHEN"),
        ("--kill", "pe:flght@3", "no PE is named 'flght'; did you mean 'flight'?"),
        (
            "--kill",
            "device:elevator_1=stuk@3",
            "a device cannot fail in the way 'stuk'; write one of dead, stuck, bias, loose",
        ),
        ("--kill", "pe:nav_a@100001", "is not between 0 and 100000"),  # a flight of big_blue has 5 400 s and 20 000 m
        ("--report", "landing.pdf", "landing.pdf: this command writes no PDF; what it writes ends in .html"),
        ("--report", "my.dg.yaml", "no command writes specs"),
        ("--record", "nosuch/landing.json", "nosuch is not a folder"),
        ("--wind", "99", "the flight model is made for"),
        ("--corrections-lost", "early", "is not a number"),
    ],
)
def test_what_cannot_be_flown_is_said(option, value, said, capsys):
    assert main(["fly", "eav", option, value]) == 2
    assert said in capsys.readouterr().err


def test_a_fault_is_written_as_it_is_read():
    assert str(Blow("device:elevator_1", at_s=20.0, how="stuck")) == "device:elevator_1=stuck@20"
    assert str(Blow("bus:radio", below_m=10.0)) == "bus:radio@10m"


def test_each_seed_draws_one_fault_and_the_same_one_again():
    drawn = Drawn(Mission(), one_fault=True)
    blows = [drawn.of(SPEC, seed).blows for seed in range(60)]
    assert all(len(blow) == 1 for blow in blows)
    assert {blow[0].element.partition(":")[0] for blow in blows} == {"pe", "bus", "device"}
    assert [drawn_blow(SPEC, seed) for seed in range(60)] == [blow[0] for blow in blows]


def test_the_figures_of_nothing():
    assert summary([])["interval"] == [0.0, 1.0]
