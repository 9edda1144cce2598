"""The golden traces of an earlier commit become those of this one by a table of sentences, and by nothing else."""

from lab.words.rewrite_traces import read_changes, rewritten_traces

_TABLE = (
    "{bus} is gone, says {by}\t{bus} is gone, reported by {by}\n"
    "epoch {epoch} is given up: {reason}\tepoch {epoch} is abandoned: {reason}\n"
    "epoch {epoch} is abandoned: {pe} is deaf\tepoch {epoch} is abandoned: {pe} hears no LEASE\n"
    "a_deaf_pe.scenario.golden\ta_pe_hears_no_lease.scenario.golden\n"
)


def test_a_trace_is_rewritten_line_by_line_and_under_its_new_name() -> None:
    before = {
        "a_deaf_pe.scenario.golden": "--- at 2s deaf pe:left\nepoch 3 is given up: pe:left is deaf\nepoch 4: GO_ALL\n",
        "a_radio.scenario.golden": "radio is gone, says comms\nground is lost: bus:radio is gone, says comms\n",
    }
    assert rewritten_traces(before, read_changes(_TABLE)) == {
        "a_pe_hears_no_lease.scenario.golden": (
            "--- at 2s deaf pe:left\nepoch 3 is abandoned: pe:left hears no LEASE\nepoch 4: GO_ALL\n"
        ),
        "a_radio.scenario.golden": "radio is gone, reported by comms\nground is lost: bus:radio is gone, says comms\n",
    }
