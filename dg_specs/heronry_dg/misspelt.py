"""A name that is misspelt where it is declared is one mistake, though everybody who uses it names what is not there.

Where an unknown name is used at least twice, an element of a name close to it is declared, and that one is used by
nobody, the declaration is what to mend: one finding there stands for those of all the users. Where the name is used
once, nobody can tell which of the two is misspelt, and the user is told.
"""

from collections import Counter
from collections.abc import Mapping

from heronry_dg import yaml_source
from heronry_dg.draft import Draft
from heronry_dg.findings import Findings, Place, shown
from heronry_dg.rules import graph as rules


def blame_declarations(draft: Draft, findings: Findings) -> None:
    """Put one finding at a misspelt declaration in place of those at its users."""
    uses_of = {name: uses for name, uses in findings.unknown_names.items() if len(uses) > 1}
    if not uses_of:
        return
    named = _named(draft.root)
    for name, uses in uses_of.items():
        closest = uses[0].closest
        place = _declared(draft, closest) if closest is not None and named[closest] == 1 else None
        if place is None:
            continue
        for use in uses:
            findings.withdraw(use.place)
        sentence = f"nobody names {shown(closest)}, and {len(uses)} times {shown(name)} is named, which there is not"
        findings.add(rules.UNKNOWN_NAME, place, sentence, f"rename it to {name}, or mend those who name it")


def _declared(draft: Draft, name: str) -> Place | None:
    """Place of the only element of a name."""
    sections: tuple[Mapping[str, object], ...] = (
        *(draft.buses, draft.pes, draft.devices, draft.variables, draft.demuxes, draft.shorthands),
        *(draft.modules, draft.functions, draft.phases),
    )
    places = [getattr(section[name], "place", None) for section in sections if name in section]
    return places[0] if len(places) == 1 else None


def _named(root: yaml_source.Node) -> Counter[str]:
    """How often each name is written in a file, declarations included."""
    found: Counter[str] = Counter()
    waiting = [root]
    while waiting:
        match waiting.pop():
            case yaml_source.Scalar(value=str() as text):
                found[text.partition("@")[0]] += 1
            case yaml_source.Sequence(items=items):
                waiting += items
            case yaml_source.Mapping(entries=entries):
                found.update(entries.keys())
                waiting += [entry.node for entry in entries.values()]
    return found
