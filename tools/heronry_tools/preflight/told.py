"""What a manager's status shows beside its troubles, compared with the spec and the key that are to fly."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from heronry_dg.model import Spec
from heronry_tools.reports.findings import Finding
from heronry_tools.reports.troubles import silent_datum
from heronry_wire.authentication import Key


def assess_spec(status: Mapping[str, Any], spec: Spec, named: str) -> Finding:
    """Return the finding about the spec of the manager; `named`: the spec as the user named it."""
    if status["spec_digest"] == spec.digest:
        return Finding("spec", f"the manager flies {spec.name} (digest {spec.digest[:8]}), as {named} has it")
    says = f"the manager flies {status['spec']} (digest {status['spec_digest'][:8]}), and {named} has {spec.digest[:8]}"
    return Finding("spec", says, f"heronry manager {named}   (restart it; and new tables for the PEs: heronry table)")


def assess_key(status: Mapping[str, Any], key: Key | None) -> Finding:
    """Return the finding about the manager's key; `key`: the one that the user expects, None: any, or none."""
    held = status["manager"]["key"]
    if key is not None and held != key.fingerprint:
        says = "the manager has no key" if held is None else f"the manager has another key ({held})"
        return Finding("key", f"{says}, and {key.fingerprint} is expected", "heronry manager SPEC --key FILE")
    if held is None:
        return Finding("key", "no key is in use: any node on the bus can command the system")
    return Finding("key", f"the manager has the key {held}")


def assess_contingencies(status: Mapping[str, Any], spec: Spec, named: str) -> Finding:
    """Return the finding about plans made ahead; a spec asks for them unless its `contingency` has no faults."""
    made = status["manager"].get("contingencies")
    if made is not None and made["plans"]:
        says = f"{made['plans']} plans were made ahead, of which a PE has {min(made['on_board'].values())} or more"
        return Finding("contingencies", f"{says} on board")
    if not spec.contingency.faults:
        return Finding("contingencies", "the spec asks for no plans made ahead")
    remedy = f"heronry contingencies {named} -o FILE   (then: heronry manager {named} --contingencies FILE)"
    return Finding("contingencies", "the manager has no plans made ahead, and the spec asks for them", remedy)


def silent_data(status: Mapping[str, Any]) -> set[tuple[str, str]]:
    """Return the data that PEs report as silent: producer and variable of each."""
    return set(map(silent_datum, status.get("silences", ())))


def files_of(status: Mapping[str, Any]) -> Iterator[Path]:
    """Return the files that the manager uses: its spec, and its journal if it keeps one."""
    files: Mapping[str, str | None] = status.get("files", {})
    yield from (Path(file) for file in files.values() if file is not None)


def journal_folder(status: Mapping[str, Any]) -> Path | None:
    """Return the folder of the manager's journal; None if it keeps none."""
    file = status.get("files", {}).get("journal")
    return None if file is None else Path(file).parent
