"""The one stream of events: what the manager saw, decided and did, as versioned JSON lines.

Every line is an object with `v` (1), `t_ns` (the manager's monotonic clock), `event` (a key of KINDS) and the fields
that KINDS lists for this event. The duration of a reconfiguration is always given in four parts: detect, decide,
distribute, activate. Programs that show the system never query the manager: `heronry_tools.watch` builds a snapshot for
them from the lines, live or recorded.

The manager's core writes lines, and `heronry demo` adds lines about what it did to the system (kill, restore).
"""

import json
from collections.abc import Mapping
from typing import Any

VERSION = 1

KINDS: Mapping[str, str] = {
    "manager_started": "spec, spec_digest, node, term, bus, phase, advises, key (fingerprint): "
    "the manager has started, and listens first",
    "second_manager": "node, term: another manager sends LEASE, and this one ends",
    "pe_suspected": "pe, cause, silent_ns: a state frame is late; the manager sends the PE a PING",
    "pe_answered": "pe: a suspected PE is heard again in time",
    "pe_lost": "pe, cause, last_heard_ns: the PE is no longer available; a demo that has not killed it adds `waited`: "
    "who waited for a processor (`who`), for how long (`for_ns`), and the length of the interval in which that was "
    "measured (`of_ns`)",
    "pe_absent": "pe, cause: the PE was not heard in the start-up window",
    "pe_heard_again": "pe, cause: a PE that was lost is heard again; its hold-down begins",
    "pe_joined": "pe, cause: the PE is available from now on",
    "module_restarted": "element, by, times: a module failed, and its PE built it anew; it does not count as failed",
    "module_failed": "element, by, text, heard_ns (when its PE reported it): why a module failed, as its PE gives it "
    "by SDO: exception, message, place",
    "stood_still": "by (a PE, a manager, the demo), for_ns, times: the computer stood still for more than a period",
    "fault_reported": "element, by, detail, code: a module, an agent or the operator reported a fault; it is latched",
    "fault_cleared": "element, by: the element no longer counts as failed",
    "link_limited": "bus, by, share: plans use this share of a radio's bandwidth from now on, as its gateway reports",
    "link_gone": "bus, by: the gateway hears nothing from beyond the radio; all PEs there are lost",
    "link_back": "bus, by: the gateway hears a PE beyond the radio again",
    "channel_lost": "channel, by: a channel of a replicated bus carries nothing for this node; the other channel does",
    "channel_back": "channel, by: the channel carries frames for this node again",
    "phase_changed": "phase, before, by: the operator, a module or a phase's rule has changed the mission phase",
    "suspicion": "element, by, evidence: a module reports a PE or a bus as faulty; evidence: what the manager observes",
    "suspicion_assessed": "element, found: what the manager found out about a suspected PE or bus",
    "unknown_element": "module, by, detail: the module has reported an element that the spec does not have",
    "unknown_output": "module, by: a step gives no value for an output, but one under a similar name (misspelt)",
    "disagreement": "module, by, detail: two inputs of this module differ, and neither is known to be wrong",
    "agreement": "module, by: the inputs of this module agree again",
    "priority_changed": "function, priority ('default': the spec's), before, by: "
    "the operator or a module has set the priority of the function",
    "priority_refused": "function, priority, by, why: a module has requested a priority that it may not set",
    "adopted": "epoch, digest: the PEs run a known configuration already; this mastership takes it over as it is",
    "advice": "plan, moved, started, stopped: what a manager that only advises would do",
    "unknown_epoch": "epoch: the PEs run an epoch that this manager, which only advises, does not know",
    "plan_requested": "request, down, limits, phase, causes: the planner is asked for a plan for this situation",
    "plan_ready": "request, plan, decide_ns: the plan as 'heronry plan --json' prints it",
    "plan_failed": "request, reason: the planner could not answer; the present configuration goes on",
    "plan_unchanged": "request: the new plan is what runs already",
    "plan_kept": "request: the optimal plan is not better at levels 1 to 3, so the running configuration stays",
    "epoch_prepared": "epoch, digest, contingency (its number; 0: none), pes, bytes: PREPARE and slices are sent",
    "epoch_abandoned": "epoch, reason: the epoch was given up before ACTIVATE",
    "epoch_step": "epoch, step, waiting_for: ACTIVATE with this step was sent",
    "pe_refused": "pe, epoch, reason: a PE cannot stage its slice",
    "another_table": "pe, why: the PE stages nothing, since its table is not the one that this manager compiles for it",
    "commands_refused": "pe, unproven, other: how many commands a PE with a key has refused so far",
    "states_unproven": "pe: the PE is heard, but proves nothing when asked: another key, no key, or a failed receiver",
    "states_doubted": "pe, refused (number of states so far): "
    "many states of the PE had a wrong tag; from now on a state counts only if the one before it was proven, too",
    "attacked": "bus, percent, frames_per_s: forged frames take a tenth of the manager's bus or more",
    "outputs_held": "pe, modules, cause: a PE holds exclusive outputs back for longer than T_lease",
    "outputs_free": "pe, for_ns: the PE no longer holds exclusive outputs back; it held them back for this time",
    "reconfigured": "epoch, causes, times_ns {detect, decide, distribute, activate}, moved, started, stopped: "
    "this epoch runs now",
    "control_paths": "epoch, plants {name: on_path, open, unmoved (no module drives its actuators) or "
    "unseen (none reads its sensors)}: which control loops this epoch closes",
    "script_taken": "reason: a script of the operator is accepted: its configuration is deployed, and held",
    "script_refused": "reason: a script of the operator was refused; what runs stays",
    "script_ended": "reason: the script that was held has ended",
    "journal_failed": "problem: the journal cannot be written; what is not in it is lost at a restart",
    "journal_kept": "before (the problem until now): the disk keeps the whole journal again",
    "standing_by": "node, term: another manager is active; this one follows it, and can take over",
    "refused": "term: most PEs report that they hear no LEASE, though it is sent; the manager begins a new term",
    "hears_nobody": "term: no PE is heard any more; the manager is silent until it hears one, then begins a new term",
    "stepped_down": "node, term: another manager is active with a higher term; this one stands by from now on",
    "taken_over": "term, before, silent_ns, phase: the PEs hear the previous manager no more; this one is active now",
    "stopped": "reason: the manager ends",
    "bus": "name, interface, channel, models: which bus this is, and what it does not model",
    "bus_trouble": "sentence: the manager's bus is lost, back, or full of errors",
    "planned_ahead": "sentence: the demo makes plans for single faults while it flies; the next demo uses them",
    "page": "address: where a browser on this computer finds the page of the demo",
    "orders": "flags: with these flags the operator's commands reach the manager of the demo",
    "process": "pe, pid, what (started, killed, restored): what the demo did to a PE's process",
    "heartbeat": "late_ns, period_ns, of_spec_ns: how late processes run here, and the period that the demo flies with",
    "logs": "folder, kept: where the demo's processes write their logs, and whether they stay there",
    "outage": "function, from_ns, to_ns (null: not back yet), gathered (true: `outages` sums this outage up): "
    "the outputs of this function were not heard on the bus",
    "outages": "functions, times (how many outages), over (false: not back yet), shortest_ns, longest_ns: "
    "a summary of the gathered `outage` events just before",
    "overtime": "awaited, at_most_s: the time of the demo is up, but it still awaits these effects",
    "summary": "served, unserved (planned, but not heard on the bus), never (of these, those never heard at all), "
    "waited (for each of these, which process waited for a processor, as in `pe_lost`), "
    "rivals (branches of one DEMUX that drove alternately), pending (what the manager had not finished; null: "
    "nothing): the end of the demo: what the plan serves, and what was heard of it",
}


def event(kind: str, now_ns: int, **data: Any) -> dict[str, Any]:
    """Build one event; raises KeyError for a kind that is not in KINDS."""
    _ = KINDS[kind]
    return {"v": VERSION, "t_ns": now_ns, "event": kind, **data}


def to_line(one: Mapping[str, Any]) -> str:
    """Encode an event as one line of JSON, without its line break."""
    return json.dumps(one, separators=(",", ":"), sort_keys=False)
