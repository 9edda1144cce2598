"""The manager's status, as plain data for `heronry status`: what the manager knows, not what it plans.

`status` only reads the parts of the core, and changes nothing. The document is versioned; a later version adds keys
and changes none.

    v, spec, spec_digest, phase, epoch, stage
    manager         node, term, state, advises, planning, journal (what is wrong with it, or null), key (its fingerprint
                    or null), standstills (times, long_times, last_long_ms, longest_ms), heartbeat_ns (of its bus),
                    contingencies (plans: how many, on_board: how many by PE; null: none were made ahead)
    next            epoch that is being prepared, or null
    unknown_epoch   newest epoch that PEs run, if this manager does not know its configuration; then `epoch` is null. In
                    all other cases `unknown_epoch` is null, also while the manager stands by
    pes             by name:
                    state, why, epoch, runs (as in the PE's state frames), losses, held_down_for_ns
                    authentic     null without a key; otherwise is_believed, refused_states, unproven_reports (EMCYs in
                                  the name of the PE that were never proven), refused_commands (as the PE reports them)
                    standstills   as last read from the PE; null: not read yet
                    cost          wake_ups_per_s, agent_per_mille, modules_per_mille (processor time, of one core),
                                  longest_turn_us, as last read from the PE; null: not read yet
                    held          exclusive outputs that the PE has held back for longer than T_lease: modules, why,
                                  for_ns; null: there are none
    priorities      changed priorities, by function: priority, by ("operator" or "module")
    latched         list of element, by, code, detail, for_ns
    failures        last failure of each module, as its PE reports it: list of element, by, text, for_ns, is_over (its
                    fault was cleared, or its restart has lasted)
    links           by name of the radio: state, limit (per mille of its bit rate, with which the manager plans), usable
                    (per mille of its bit rate, as reported last), delivered (per cent), queued, dropped
    channels        channels of replicated buses, by name (can0.1): the nodes that hear nothing on the channel
    silences        list of module, by, what ("input" or "output"), variable, producer (of an input; else null), for_ns
    disagreements   list of module (a comparator), by, detail
    checkpoints     of modules with a checkpoint, how each has started last: list of module, by, age_ms (of the state
                    from which it has started; null: without a state), why (it has started without; else null), for_ns
                    (since then), not_saved (why its state cannot be saved now, or null)
    functions       by name: wanted, criticality, priority, served, mode, value, why_not, shortfalls (what is less than
                    the best in its output module and upstream of it); the last five are those of the epoch's plan. If
                    the plan is not known, served, mode and value are null
    script          state (none, asked, held, refused, ended) and why
    buses           by name: bits_per_s and load, as planned
    other_tables    why a PE stages nothing, and what to do, by the PE's name
    code            code that is on its way to a PE that lacks it, or why it is not, by the PE's name
    tables          PEs that wait for their table, by name: how much of it has come, or why it is not taken
    transfers       of what is on its way in `code` and `tables`: list of pe, bytes (that it has), of (how many)
    unknown_nodes   nodes with a node-ID of a PE that the spec does not have: list of node, says (what it does), for_ns
                    (since it was heard), offer (`heronry_wire.node_offer`; null: none has come)
    reload          to (digest of the spec to which a change leads), state, given_up (why the last change was), at_hand
                    (digest of the spec that a standby manager has ready), flies (the first four digits of the digest of
                    the spec that flies, if this standby manager lacks it); each null if there is none
    unwatched       phases whose rule no PE watches now, because no module that gives its variable runs

The driver adds:

    files           paths of the spec, and of the journal; null where there is none
    plants          for a spec with plants: by name, the path of control through each
"""

from collections.abc import Iterator, Mapping
from typing import Any

from heronry_dg.model import Function, Spec
from heronry_dg.plan import Plan
from heronry_dg.shortfalls import shortfalls_of
from heronry_dg.situation import Situation
from heronry_manager.core.authentication import Authenticity
from heronry_manager.core.epochs import Deployment, HeldOutputs, Silences
from heronry_manager.core.membership import Health
from heronry_manager.core.memory import PriorityChanged
from heronry_manager.core.reports.pe_details import PeDetails
from heronry_manager.core.situation import KnownSituation, LinkRecord

VERSION = 1


def status(
    spec: Spec,
    now_ns: int,
    *,
    manager: Mapping[str, Any],
    health: Health,
    situation: KnownSituation,
    deployment: Deployment,
    script: Mapping[str, Any],
    unknown_epoch: int | None,
    authenticity: Authenticity | None = None,
    details: PeDetails,
    held: HeldOutputs,
    silences: Silences,
    code: Mapping[str, str],
    tables: Mapping[str, str],
    transfers: list[dict[str, Any]],
    unknown_nodes: list[dict[str, Any]],
    reload: Mapping[str, Any],
) -> dict[str, Any]:
    """Build the status document; `manager` and `script` are the values of its keys with these names."""
    current, plan, now = deployment.current, deployment.plan, situation.now()
    return {
        "v": VERSION,
        "spec": spec.name,
        "spec_digest": spec.digest,
        "manager": dict(manager),
        "phase": now.phase,
        "priorities": {one.function: _priority(one) for one in situation.priorities.all()},
        "epoch": None if current is None else current.epoch,
        "stage": None if current is None else current.stage.value,
        "next": None if deployment.next is None else deployment.next.epoch,
        "unknown_epoch": unknown_epoch,
        "pes": {
            pe: {
                **_pe(pe, now_ns, health, deployment, authenticity),
                "standstills": details.standstills(pe),
                "cost": details.cost(pe),
                "held": held.status(pe),
            }
            for pe in spec.pes
        },
        "latched": [
            {"element": f.element, "by": f.by, "code": f.code, "detail": f.detail, "for_ns": now_ns - f.since_ns}
            for f in situation.failed.all()
        ],
        "failures": details.failures(situation.failed.elements),
        "links": {record.radio.bus: _link(record) for record in situation.links.records.values()},
        "channels": situation.channels.lost_by(),
        "silences": silences.all(),
        "disagreements": [{"module": m, "by": pe, "detail": d} for m, pe, d in situation.disagreements.all()],
        "checkpoints": situation.checkpoints.status(now_ns),
        "functions": {f.name: _function(spec, f, now, plan, unknown_epoch) for f in spec.functions.values()},
        "script": dict(script),
        "buses": {} if plan is None else plan.document()["buses"],
        "other_tables": details.other_tables(),
        "code": dict(code),
        "tables": dict(tables),
        "transfers": transfers,
        "unknown_nodes": unknown_nodes,
        "reload": dict(reload),
        "unwatched": list(_unwatched(spec, plan)),
    }


def _pe(
    pe: str, now_ns: int, health: Health, deployment: Deployment, authenticity: Authenticity | None
) -> dict[str, Any]:
    seen = deployment.observed.of[pe]
    return {
        "state": health.standing(pe).value,
        "why": health.cause(pe),
        "epoch": seen.epoch or None,
        "runs": seen.state.name,
        "losses": health.losses(pe),
        "held_down_for_ns": health.held_down_for_ns(pe, now_ns),
        "authentic": None if authenticity is None else authenticity.status(pe),
    }


def _link(record: LinkRecord) -> dict[str, Any]:
    report = record.report
    if report is None:
        return {"state": "unheard", "limit": record.step, "usable": None, "delivered": None, "queued": 0, "dropped": 0}
    return {
        "state": report.state.name.lower(),
        "limit": record.step,
        "usable": report.usable,
        "delivered": report.delivered,
        "queued": report.queued,
        "dropped": report.dropped,
    }


def _function(
    spec: Spec, function: Function, now: Situation, plan: Plan | None, unknown_epoch: int | None
) -> dict[str, Any]:
    report = plan.functions[function.name] if plan is not None else None
    known, why_not = True, "nothing runs yet"
    if unknown_epoch is not None:
        known, why_not = False, f"epoch {unknown_epoch} runs, which this manager does not know"
    return {
        "wanted": now.priority_of(function) > 0,
        "criticality": function.criticality_in(now.phase),
        "priority": now.priority_of(function),
        "served": (report is not None and report.served) if known else None,
        "mode": None if report is None else report.mode,
        "value": (0 if report is None else report.value) if known else None,
        "why_not": why_not if report is None else report.why_not,
        "shortfalls": [] if plan is None else list(shortfalls_of(spec, plan, function)),
    }


def _priority(one: PriorityChanged) -> dict[str, Any]:
    return {"priority": one.priority, "by": "operator" if one.by_operator else "module"}


def _unwatched(spec: Spec, plan: Plan | None) -> Iterator[str]:
    if plan is None:
        return
    running = plan.configuration
    given = {variable for module in running.modules for variable in running.mode(spec, module).gives}
    for phase in spec.phases.values():
        if phase.when is not None and phase.when.variable not in given:
            yield phase.name
