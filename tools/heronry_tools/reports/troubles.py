"""What is not as it should be in a manager's status (`core.reports.manager_status`), each with a remedy.

`heronry status` shows the sentences, and ends with 1 on `--exit-code` if there is any; `heronry preflight` shows the
remedies, too. A PE is judged by `standing_troubles`, to which `preflight` adds what it hears itself.
"""

from collections.abc import Collection, Iterator, Mapping
from typing import Any

from heronry_dg.situation import module_of
from heronry_manager.core.epochs import Stage
from heronry_manager.core.mastership import Mastership
from heronry_manager.core.membership import Standing
from heronry_manager.core.situation import HELD_CODE, OPERATOR_CODE
from heronry_tools.reports.findings import Finding
from heronry_wire.management import FaultCode
from heronry_wire.node_offer import adopts, hardware
from heronry_wire.state_frames import PeState

_NS_PER_S = 1_000_000_000
_AGAIN = "repeat it in a moment"

_FAULTS = {  # in words, by the name of the code
    FaultCode.MODULE_EXCEPTION.name: "its code raised an exception",
    FaultCode.MODULE_OVERRUN.name: "it does not end in its time",
    FaultCode.REPORTED.name: "a module there reports that it has failed",
    FaultCode.PARTITION_ENDED.name: "its process ended",
    FaultCode.MODULE_MISSING.name: "its code cannot be run there",
    FaultCode.STALE.name: "it left out an output although its inputs were there, and its spec says `silent: fails`",
    HELD_CODE: "another manager announces it",
}


def troubles(status: Mapping[str, Any]) -> Iterator[Finding]:
    """Yield every trouble that a status document tells; none if the system is fit."""
    yield from manager_troubles(status)
    yield from spec_troubles(status)
    for name in status["pes"]:
        yield from standing_troubles(status, name)
    yield from waiting_troubles(status)
    yield from code_troubles(status)
    yield from element_troubles(status)
    yield from silence_troubles(status)
    yield from function_troubles(status)


_WAIT = "wait for it; if it does not come, its agent needs --code-dir, and its log says why"
_BRING = "heronry manager --bundles DIR"


def manager_troubles(status: Mapping[str, Any]) -> Iterator[Finding]:
    """Yield the troubles of the manager itself, of its journal, and of an epoch that is not everywhere yet."""
    manager = status["manager"]
    if manager["state"] == Mastership.STANDBY.value:
        yield Finding("manager", "this manager stands by: another one is active", "ask the active one, with --of NAME")
        return
    if manager["advises"]:
        yield Finding("manager", "this manager only advises", "ask the active one, with --of NAME")
    elif manager["state"] != Mastership.ACTIVE.value:
        yield Finding("manager", "this manager is not active yet", _AGAIN)
    elif status["unknown_epoch"] is not None:
        says = f"epoch {status['unknown_epoch']} runs, which this manager does not know"
        yield Finding("epoch", says, "wait for the next epoch, which this manager makes")
    elif status["epoch"] is None:
        yield Finding("epoch", "nothing runs yet", _AGAIN)
    elif status["stage"] != Stage.DONE.value or status["next"] is not None or manager["planning"]:
        yield Finding("epoch", "a reconfiguration is under way, or a plan is being made", _AGAIN)
    if manager["journal"] is not None:
        says = f"the journal cannot be written: {manager['journal']}"
        yield Finding("journal", says, "df -h; mount   (make room on the disk, or make it writable again)")


def spec_troubles(status: Mapping[str, Any]) -> Iterator[Finding]:
    """Yield that a standby manager lacks the spec that flies."""
    flies = status.get("reload", {}).get("flies")  # an older manager tells none
    if flies is not None:
        give = "heronry reload SPEC --standby"
        says = f"another spec flies (digest {flies}...): this manager does not take over until it has it, by '{give}'"
        yield Finding("spec", says, give)


def standing_troubles(status: Mapping[str, Any], name: str) -> Iterator[Finding]:
    """Yield the trouble of one PE, if there is any, as far as the manager knows it."""
    pe, start = status["pes"][name], f"start pe-agent on {name}, or look into its log"
    why = "" if pe["why"] is None else f": {pe['why']}"
    if pe["authentic"] is not None and not pe["authentic"]["is_believed"]:
        says = f"{name} is not believed: its states carry no valid proof"
        yield Finding("key", says, "pe-agent --key FILE   (the key file of the manager)")
    elif name in status["other_tables"]:
        yield from (one for one in table_troubles(status) if one.says.startswith(f"{name} "))
    elif pe["state"] == Standing.RETURNING.value:
        says = f"{name} joins in {pe['held_down_for_ns'] / _NS_PER_S:.1f} s{why}"
        yield Finding("PE", says, f"wait for it, or: heronry clear pe:{name}")
    elif pe["state"] not in (Standing.UP.value, Standing.SUSPECT.value):
        yield Finding("PE", f"{name} is {pe['state']}{why}", start)
    elif pe["held"] is not None:
        says = f"{name} holds its exclusive outputs back: {pe['held']['why']}"
        yield Finding("PE", says, f"heronry status   (and look into the log of the agent of {name})")
    elif status["epoch"] is not None and (pe["epoch"], pe["runs"]) != (status["epoch"], PeState.ACTIVE.name):
        says = f"{name} does not run epoch {status['epoch']} (it is {pe['runs']})"
        yield Finding("PE", says, f"heronry table SPEC {name} -o {name}.table   (copy it there, and restart its agent)")


def table_troubles(status: Mapping[str, Any]) -> Iterator[Finding]:
    """Yield the PEs that stage nothing, because they have another table than the manager has compiled."""
    for pe, why in status["other_tables"].items():
        remedy = f"heronry table SPEC {pe} -o {pe}.table   (copy it there, and restart its agent)"
        yield Finding("tables", f"{pe} stages nothing: {why}", remedy)


def waiting_troubles(status: Mapping[str, Any]) -> Iterator[Finding]:
    """Yield the PEs that wait for a table."""
    for pe, says in status.get("tables", {}).items():
        yield Finding("tables", f"{pe} waits for its table: {says}", "wait for it; if it does not come, see its log")


def stranger_notes(status: Mapping[str, Any]) -> Iterator[Finding]:
    """Yield the nodes that the spec does not have, with what they offer; the system may be fit beside them."""
    for one in status.get("unknown_nodes", ()):
        says = f"node {one['node']} is not in the spec: it {one['says']}"
        if one.get("offer") is None:
            remedy = f"give it a PE in the spec ({{node_id: {one['node']}, ...}}), or another node-ID"
        else:
            says += f" ({hardware(one['offer'])})"
            remedy = adopts(status["spec"], one["node"])
        yield Finding("nodes", says, remedy)


def code_troubles(status: Mapping[str, Any]) -> Iterator[Finding]:
    """Yield the PEs to which a manager brings code, as its loader says; not those of which a latched fault says it."""
    told = {one["by"] for one in status["latched"] if one["code"] == FaultCode.MODULE_MISSING.name}
    for pe, says in status.get("code", {}).items():  # an older manager tells none
        if pe not in told:
            yield Finding("code", f"{pe} lacks code: {says}", _WAIT)


def element_troubles(status: Mapping[str, Any]) -> Iterator[Finding]:
    """Yield what is told of faults, modules, radios, channels and phases."""
    reasons = {(failure["element"], failure["by"]): failure for failure in status["failures"]}
    for fault in status["latched"]:
        reason = reasons.pop((module_of(fault["element"]), fault["by"]), None)
        coming = status.get("code", {}).get(fault["by"])
        yield _latched(fault, None if reason is None else reason["text"], coming)
    for failure in reasons.values():
        if not _is_over(failure):
            yield Finding("module", _failed(failure), f"heronry traceback {failure['element']}")
    for bus, link in status["links"].items():
        if link["state"] == "gone":
            yield Finding("radio", f"bus:{bus} is gone: no frame comes from beyond it", "switch on what is beyond it")
        elif link["limit"] < 1000:
            says = f"bus:{bus} has {link['limit'] / 10:g} % of its bandwidth; {link['delivered']} % of frames arrive"
            yield Finding("radio", says, "check the antennas and the distance, and that nobody else sends there")
    for channel, lacking in status["channels"].items():
        if lacking:
            says = f"channel:{channel} carries nothing, as {', '.join(lacking)} report; the other channel works"
            yield Finding("channels", says, "check the wire of that channel, and the stub of each node named")
    for told in status["disagreements"]:
        says = f"two inputs of module:{told['module']} disagree, reported by {told['by']} (detail {told['detail']})"
        yield Finding("disagreement", says, "compare the two: heronry top")
    yield from _not_kept(status)
    for phase in status["unwatched"]:
        says = f"no running module gives the variable that requests phase {phase}"
        yield Finding("phases", says, f"enter it yourself when it is time: heronry phase {phase}")


def _not_kept(status: Mapping[str, Any]) -> Iterator[Finding]:
    for kept in status.get("checkpoints", ()):  # an older manager tells none
        if kept["not_saved"] is not None:
            says = f"the state of module:{kept['module']} on {kept['by']} is not kept: {kept['not_saved']}"
            yield Finding("checkpoint", says, "see the log of the PE's agent; then: heronry module try IMAGE")


def mended(status: Mapping[str, Any]) -> Iterator[str]:
    """Yield a sentence for the last failure of each module that is mended; it is no trouble any more."""
    for failure in status["failures"]:
        if _is_over(failure):
            yield f"mended: {_failed(failure)}"


def _is_over(failure: Mapping[str, Any]) -> bool:
    return bool(failure.get("is_over", False))  # an older manager does not tell it


def _failed(failure: Mapping[str, Any]) -> str:
    ago = failure["for_ns"] // _NS_PER_S
    return f"{failure['element']} failed on {failure['by']}, {ago} s ago: {failure['text']}"


def silence_troubles(status: Mapping[str, Any], named: Collection[tuple[str, str]] = ()) -> Iterator[Finding]:
    """Yield what PEs report as silent, but no datum of `named` (producer and variable)."""
    yield from (_silent(one) for one in status["silences"] if silent_datum(one) not in named)


def silent_datum(silence: Mapping[str, Any]) -> tuple[str, str]:
    """Return producer and variable of a silence that a PE reports; of an output, the module itself is the producer."""
    return silence["producer"] or silence["module"], silence["variable"]


def _silent(silence: Mapping[str, Any]) -> Finding:
    who, variable = f"module:{silence['module']} on {silence['by']}", silence["variable"]
    since = f"reported {silence['for_ns'] // _NS_PER_S} s ago"
    if silence["what"] == "output":
        says = f"{who} gives no {variable}, although its inputs are there ({since})"
        return Finding("data", says, f"check the device and the code of {silence['module']}")
    says = f"{who} gets no {variable} from {silence['producer']} ({since})"
    return Finding("data", says, f"check what {silence['producer']} gives, and the way to {silence['by']}")


def function_troubles(status: Mapping[str, Any]) -> Iterator[Finding]:
    """Yield a finding for each function that is wanted and not served."""
    if status["manager"]["state"] == Mastership.STANDBY.value:
        return
    for name, function in status["functions"].items():
        if function["wanted"] and function["served"] is not True:
            why = "" if function["served"] is None else f": {function['why_not']}"
            yield Finding("functions", f"{name} is wanted, and not served{why}", f"heronry why SPEC {name}")


def _latched(fault: Mapping[str, Any], reason: str | None, coming: str | None) -> Finding:
    """Write a latched fault.

    reason: why the module failed, as its PE gives it; None: no reason is known.
    coming: what the manager's loader says of the PE that has reported the fault; None: it brings nothing there.
    """
    element, ago = fault["element"], f"{fault['for_ns'] // _NS_PER_S} s ago"
    clear = f"heronry clear {element}   (when it is mended)"
    if fault["code"] == OPERATOR_CODE:
        return Finding("fault", f"{element} counts as failed, reported by {fault['by']} ({ago})", clear)
    what = _FAULTS.get(fault["code"], fault["code"])
    detail = f", detail {fault['detail']}" if fault["detail"] else ""
    why = "" if reason is None else f": {reason}"
    says = f"{element} counts as failed, reported by {fault['by']}, {ago}: {what}{detail}{why}"
    if fault["code"] == FaultCode.MODULE_MISSING.name:
        if coming is not None:
            return Finding("code", f"{says}; {coming}", _WAIT)
        return Finding(
            "images", says, f"install the code of {element} on {fault['by']}, and restart its agent; or: {_BRING}"
        )
    return Finding("fault", says, clear)
