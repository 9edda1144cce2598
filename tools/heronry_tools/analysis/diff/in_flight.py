"""What a change of the spec would do in flight, as lines for people: modules by their fate, gateways, identifiers."""

from collections.abc import Iterator

from heronry_dg.model import Spec
from heronry_dg.spec_change import ModuleChange, SpecChange

_ALONE = {"started": "starts", "stopped": "stops", "moved": "moves", "changed": "changes", "rewired": "is rewired"}


def in_flight_lines(new: Spec, found: SpecChange) -> Iterator[str]:
    """Yield the lines; the first one is the title, and tells how many modules go on untouched."""
    phase = new.initial_phase()
    untouched = len(found.with_fate("unchanged"))
    where = f" in phase {phase}" if phase is not None else ""
    yield f"changed in flight{where}: {untouched} of {len(found.modules)} modules go on untouched"
    for fate, verb in _ALONE.items():
        yield from (f"  {one.module} {verb}{_how(one)}" for one in found.modules if one.fate == fate)
    for hardware in found.hardware:
        if hardware.element.startswith("gateway:"):
            yield f"  {hardware.element} {hardware.change}"
    for one in found.passing:
        if one.is_driven:
            yield f"  identifier {one.identifier} passes from {'.'.join(one.old)} to {'.'.join(one.new)}"


def _how(one: ModuleChange) -> str:
    """Tell where a module runs, from where it comes, and which parts of its definition differ."""
    before, after = one.before, one.after
    if before is None or after is None:
        runs = after or before
        return f" on {runs.pe}" if runs is not None else ""
    parts = list(one.differs)
    if before.mode != after.mode:
        parts.insert(0, f"{before.mode} -> {after.mode}")
    told = f" ({', '.join(parts)})" if parts else ""
    return f" from {before.pe} to {after.pe}{told}" if before.pe != after.pe else told
