"""The status of a manager (`heronry_manager.core.reports.manager_status`) as text: problems first, then what runs."""

from collections.abc import Iterator, Mapping
from typing import Any

from heronry_manager.core.mastership import Mastership
from heronry_tools.reports.troubles import (
    code_troubles,
    element_troubles,
    mended,
    silence_troubles,
    spec_troubles,
    stranger_notes,
    table_troubles,
    waiting_troubles,
)
from heronry_wire.node_cost import NodeCost

_NS_PER_S = 1_000_000_000


def report(status: Mapping[str, Any]) -> Iterator[str]:
    """Write a status document as lines of text."""
    yield from _head(status)
    yield from _script(status["script"])
    yield from _troubles(status)
    yield from _pes(status["pes"])
    if status["manager"]["state"] == Mastership.STANDBY.value:
        yield "only the active manager knows which functions are served"
        return
    yield from _functions(status["functions"])
    yield from _plants(status.get("plants", {}))
    yield from _buses(status["buses"])


def _head(status: Mapping[str, Any]) -> Iterator[str]:
    manager, phase = status["manager"], status["phase"]
    does = "only advises" if manager["advises"] else f"is {manager['state']}"
    proof = "no key: any node on the bus can command the system" if manager["key"] is None else f"key {manager['key']}"
    yield f"{status['spec']}: manager {manager['node']} {does}, term {manager['term']}; {proof}"
    unknown = status["unknown_epoch"]
    none = "no epoch yet" if unknown is None else f"epoch {unknown} runs, which this manager does not know"
    runs = none if status["epoch"] is None else f"epoch {status['epoch']} is {status['stage']}"
    work = "; a plan is being made" if manager["planning"] else ""
    preparing = f"; epoch {status['next']} is being prepared" if status["next"] is not None else ""
    yield f"{'no phases' if phase is None else f'phase {phase}'}; {runs}{work}{preparing}"


def _troubles(status: Mapping[str, Any]) -> Iterator[str]:
    if status["manager"]["journal"] is not None:
        yield f"! the journal cannot be written: {status['manager']['journal']}"
    own = _standstills(status["manager"]["standstills"])
    if own:
        yield f"! the computer of this manager{own}"
    found = (spec_troubles, table_troubles, waiting_troubles, code_troubles, element_troubles, silence_troubles)
    for trouble in (one for troubles in found for one in troubles(status)):
        yield f"! {trouble.says}"
    for note in stranger_notes(status):
        yield f"! {note.says}"
        yield f"  {note.remedy}"
    words = {"operator": "the operator", "module": "a module"}
    for name, changed in status["priorities"].items():
        yield f"! {name} has priority {changed['priority']}, set by {words[changed['by']]}"
    yield from mended(status)


def _script(script: Mapping[str, Any]) -> Iterator[str]:
    words = {
        "asked": "a script of the operator waits for the best plan, which is compared with it",
        "held": "a script of the operator is held: no better plan is sought; 'heronry pcs release' ends it",
        "refused": f"the last script was refused, and changed nothing: {script['why']}",
        "ended": f"the last script is held no longer: {script['why']}",
    }
    if script["state"] in words:
        yield words[script["state"]]


def _pes(pes: Mapping[str, Any]) -> Iterator[str]:
    yield "PEs"
    for name, pe in pes.items():
        held = pe["held_down_for_ns"]
        why = "" if pe["why"] is None else f": {pe['why']}"
        waits = "" if held is None else f"; it joins in {held / _NS_PER_S:.1f} s"
        runs = _runs(pe)
        cost = _computer(pe["standstills"], pe["cost"])
        yield f"  {name:<12} {pe['state']:<10} {runs}{why}{waits}{_held(pe['held'])}{_unproven(pe['authentic'])}{cost}"


def _computer(standstills: Mapping[str, int] | None, cost: Mapping[str, int] | None) -> str:
    """Write how often the computer of a PE has stood still, and what the PE costs it, as far as this is known."""
    late = _standstills(standstills)
    costs = "" if cost is None else f"; {NodeCost(**cost).sentence}"
    return (f"; its computer{late}" if late else "") + costs


def _held(held: Mapping[str, Any] | None) -> str:
    """Write which exclusive outputs a PE holds back, and why."""
    if held is None:
        return ""
    modules = ", ".join(held["modules"]) or "no module"
    return f"; OUTPUTS HELD BACK for {held['for_ns'] / _NS_PER_S:.1f} s ({modules}): {held['why']}"


def _runs(pe: Mapping[str, Any]) -> str:
    """Write what a PE runs; for a PE that is down, what it reported last."""
    if pe["epoch"] is None:
        return str(pe["runs"])
    runs = f"{pe['runs']} in epoch {pe['epoch']}"
    return f"no plan uses it; its last report: {runs}" if pe["state"] == "down" else runs


def _standstills(counts: Mapping[str, int] | None) -> str:
    """Write how often the processes of a computer could not run, and for how long at most.

    The text is empty if this never happened, or if `counts` is None (not known).
    """
    if counts is None or not counts["times"]:
        return ""
    times = "once" if counts["times"] == 1 else f"{counts['times']} times"
    return f" stood still {times}, for up to {counts['longest_ms']} ms"


def _unproven(authentic: Mapping[str, Any] | None) -> str:
    """Write what is wrong with the proofs of one PE; the text is empty if nothing is wrong.

    The text says that the states of the PE carry no valid proof, how many of its states the manager refused,
    how many reports in its name were never proven, and how many commands the PE refused.

    authentic: these facts as the status has them; None: the system has no key, and the text is empty.
    """
    if authentic is None:
        return ""
    said = "" if authentic["is_believed"] else "; its states carry no valid proof"
    states, commands = authentic["refused_states"], authentic["refused_commands"]
    told = f"; {states} of its states were refused" if states else ""
    reports = authentic["unproven_reports"]
    told += f"; {reports} reports in its name were never proven" if reports else ""
    return f"{said}{told}" + (f"; it refused {commands} commands" if commands else "")


def _functions(functions: Mapping[str, Any]) -> Iterator[str]:
    yield "functions, as planned"
    for name, function in functions.items():
        if not function["wanted"]:
            state = "not wanted in this phase"
        elif function["served"] is None:
            state = "not known"
        elif function["served"]:
            state = f"served, {function['mode']}, value {function['value']}"
        else:
            state = f"NOT SERVED: {function['why_not']}"
        yield f"  {name:<16} {function['criticality']}  {state}"
        yield from (f"    but {what}" for what in function.get("shortfalls", ()))


def _plants(plants: Mapping[str, Any]) -> Iterator[str]:
    if plants:
        yield "control loops, as planned"
    for name, plant in plants.items():
        state = "closed" if plant["why"] is None else f"OPEN, because {plant['why']}"
        yield f"  the loop through {name}: {state}"


def _buses(buses: Mapping[str, Any]) -> Iterator[str]:
    if buses:
        yield "buses, as planned"
    for name, bus in buses.items():
        yield f"  {name:<12} {bus['bits_per_s']} bit/s, {100 * bus['load']:.1f} %"
