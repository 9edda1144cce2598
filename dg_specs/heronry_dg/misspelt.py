"""A name that is declared nowhere is one mistake, however many elements use it.

Two uses of the same unknown name are not two slips: what is wrong is the declaration. Where an element of a name close
to it is declared, and nothing uses that one, its declaration is misspelt, and one finding there stands for those
of all the users. Where no name is close, the declaration is missing, and one finding stands at the section that lacks
it. Where a name is close and in use, it is not known which of the two was meant, and the findings stand at the users.

A single use of an unknown name is a slip, and the finding stands at its user; unless a declaration that nothing names
is close, and its words are found nowhere else in the file while those of the use are: a `gsp` is declared, and a
`gps_altitude`.
"""

from collections import Counter
from collections.abc import Mapping
from difflib import SequenceMatcher
from typing import Final

from heronry_dg import yaml_source
from heronry_dg.draft import Draft
from heronry_dg.findings import Findings, Place, Use, listed, shown
from heronry_dg.rules import graph as rules

_SECTIONS: Final[Mapping[str, str]] = {  # where an element is declared, by the kind that its users expect
    "bus": "buses",
    "pe": "pes",
    "device": "devices",
    "variable": "variables",
    "variable or gate": "variables",
    "module": "modules",
    "module or DEMUX": "modules",
    "phase": "phases",
}
_MOST_LINES_SHOWN: Final = 6
_ALIKE: Final = 0.85  # names that are less alike are rather two names than one and a slip


def blame_declarations(draft: Draft, findings: Findings) -> None:
    """Put one finding at a misspelt or missing declaration in place of those at its users."""
    if not findings.unknown_names:
        return
    named = _named(draft.root)
    words = _words(named)
    for name, uses in findings.unknown_names.items():
        closest = uses[0].closest
        if closest is not None and named[closest] == 1:
            if len(uses) > 1 or _is_rather_meant(name, closest, words):
                _misspelt(draft, findings, name, uses, closest)
        elif len(uses) > 1 and (closest is None or _likeness(name, closest) < _ALIKE):
            _missing(draft, findings, name, uses)


def _is_rather_meant(name: str, other: str, words: Counter[str]) -> bool:
    """Tell whether the words in which two names differ are found elsewhere for the one, and not for the other."""
    one, two = set(name.split("_")), set(other.split("_"))
    return all(words[word] > 1 for word in one - two) and all(words[word] == 1 for word in two - one)


def _likeness(name: str, other: str) -> float:
    return SequenceMatcher(None, name, other).ratio()


def _misspelt(draft: Draft, findings: Findings, name: str, uses: list[Use], declared: str) -> None:
    place = _declared(draft, declared)
    if place is not None:
        times = f"{len(uses)} times" if len(uses) > 1 else "once"
        sentence = f"nothing names {shown(declared)}, and {times} {shown(name)} is named, which does not exist"
        hint = f"rename it to {name}, or fix {_lines(uses)}"
        _one_for_all(findings, uses, place, sentence, hint)


def _missing(draft: Draft, findings: Findings, name: str, uses: list[Use]) -> None:
    section = next((_SECTIONS[use.kind] for use in uses if use.kind in _SECTIONS), None)
    if section is not None and isinstance(draft.root, yaml_source.Mapping) and section in draft.root.entries:
        closest = uses[0].closest
        sentence = f"'{section}' has no {shown(name)}, which is named {len(uses)} times"
        suggestion = f": did you mean '{closest}'?" if closest is not None else ""
        hint = f"declare it here, or fix {_lines(uses)}{suggestion}"
        _one_for_all(findings, uses, draft.root.entries[section].place, sentence, hint)


def _lines(uses: list[Use]) -> str:
    """Write `line 3`, `lines 3 and 7`."""
    numbers = [str(line) for line in sorted({use.place.line for use in uses})]
    more = [f"{len(numbers) - _MOST_LINES_SHOWN} more"] if len(numbers) > _MOST_LINES_SHOWN else []
    return f"line{'s' if len(numbers) > 1 else ''} {listed([*numbers[:_MOST_LINES_SHOWN], *more])}"


def _one_for_all(findings: Findings, uses: list[Use], place: Place, sentence: str, hint: str) -> None:
    for use in uses:
        findings.withdraw(use.place)
    findings.add(rules.UNKNOWN_NAME, place, sentence, hint)


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


def _words(named: Counter[str]) -> Counter[str]:
    """How often each word stands in the names of a file."""
    words: Counter[str] = Counter()
    for name, times in named.items():
        for word in name.split("_"):
            words[word] += times
    return words
