"""Every scenario file of this folder holds in the simulator, with the decisions of its golden trace.

After an intended change of a decision run `heronry scenario tests/scenarios/*.scenario --rewrite`, and read the diff.
"""

from pathlib import Path

import pytest

from heronry_tools.sim.scenario.in_simulator import fly
from heronry_tools.sim.scenario.report import text_report
from heronry_tools.sim.scenario.script import read_script
from heronry_tools.sim.scenario.trace import golden_file
from thoroughness import mostly_soak

FILES = sorted(Path(__file__).parent.glob("*.scenario"))
# Long flights of big_blue, each with a sibling that flies in every run.
LONG = {
    "given_back_what_another_still_drives",  # a_replaced_driver_returns_to_a_manager_that_begins
    "one_frame_in_a_thousand_is_lost",  # one_frame_in_ten_is_lost_while_a_pe_dies
    "the_receiver_of_the_standby_failed_and_its_manager_dies",  # the_receiver_of_the_standby_fails_again_and_again
    "a_keyed_standby_takes_over",  # the_standby_takes_over, a_keyed_standby_came_too_late_to_know_the_pes
    "a_phase_in_flight_and_a_lost_computer",  # a_keyed_takeover_in_another_phase, big_blue_loses_its_flight_computer
    "a_takeover_in_another_phase",  # a_keyed_takeover_in_another_phase, the_standby_takes_over
    "both_channels_are_lost",  # tests/live/test_replicated_bus.py pulls both wires of real processes
    "big_blue_loses_two",  # big_blue_loses_its_flight_computer, a_loss_without_a_contingency
    "forged_commands_silence_no_output",  # forged_states_silence_no_output, forged_requests_end_no_session
    "a_held_script_ends_when_its_computer_dies",  # a_script_ends_with_its_manager, a_kill_while_a_script_is_prepared
}
ALWAYS = [file for file in FILES if file.stem not in LONG]


@pytest.mark.parametrize("file", mostly_soak(FILES, ALWAYS), ids=lambda file: file.stem)
def test_it_holds(file: Path) -> None:
    flown = fly(read_script(file))
    assert flown.holds, "\n".join(text_report(flown))


def test_there_are_enough_each_with_its_golden_trace_and_each_golden_trace_with_its_scenario() -> None:
    assert len(FILES) >= 30
    assert sorted(Path(__file__).parent.glob("*.golden")) == [golden_file(file) for file in FILES]


def test_every_long_one_is_there() -> None:
    assert {file.stem for file in FILES} >= LONG


def test_each_exists_for_a_reason_of_its_own() -> None:
    reasons = [read_script(file).why for file in FILES]
    assert len(set(reasons)) == len(reasons)
    assert all(len(reason.split()) >= 8 for reason in reasons)
