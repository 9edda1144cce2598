"""Reports an undeclared name as one mistake, however many elements use the name.

If several elements use the same unknown name, the mistake is probably in its declaration. There are three cases:

- An element with a similar name is declared, and nothing uses that element. Then the declaration is misspelt: one
  finding at the declaration replaces the findings at the uses.
- No similar name is declared. Then the declaration is missing: one finding is placed at the section that lacks it.
- A similar name is declared and used. Then it is unclear which name the author meant: the findings stay at the uses.

If only one element uses an unknown name, the use counts as misspelt, and the finding stays there. The declaration
counts as misspelt instead if all of these conditions hold (the words of a name are its parts between underscores):

- An element with a similar name is declared, and nothing uses that element.
- Take the words of the declared name that the used name lacks: none of them occurs elsewhere in the file.
- Take the words of the used name that the declared name lacks: each of them occurs elsewhere in the file.

For example, `gsp` is declared, `gps` is used once, and `gps_altitude` is declared as well. Then `gsp` is misspelt.
"""

from collections import Counter
from collections.abc import Mapping
from difflib import SequenceMatcher
from typing import Final

from heronry_dg import yaml_source
from heronry_dg.draft import Draft
from heronry_dg.findings import Findings, Place, Use, listed, shown
from heronry_dg.rules import graph as rules

_SECTIONS: Final[Mapping[str, str]] = {  # section in which an element is declared, by the kind that its users expect
    "bus": "buses",
    "pe": "pes",
    "device": "devices",
    "variable": "variables",
    "variable or gate": "variables",
    "module": "modules",
    "module or DEMUX": "modules",
    "phase": "phases",
    "plant": "plants",
}
_MOST_LINES_SHOWN: Final = 6
_ALIKE: Final = 0.85  # less similar names are taken for two different names


def blame_declarations(draft: Draft, findings: Findings) -> None:
    """Report undeclared names at the declarations that are to blame, by the rules in the head of this file.

    One finding, at the misspelt declaration or at the section that lacks the declaration, replaces the
    findings at the uses of the name. If no declaration is to blame, the findings at the uses stay.
    """
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
    """Tell whether `name`, rather than `other`, is the name that the author meant."""
    one, two = set(name.split("_")), set(other.split("_"))
    # the words that only `name` has stand elsewhere in the file, and those that only `other` has do not
    return all(words[word] > 1 for word in one - two) and all(words[word] == 1 for word in two - one)


def _likeness(name: str, other: str) -> float:
    return SequenceMatcher(None, name, other).ratio()


def _misspelt(draft: Draft, findings: Findings, name: str, uses: list[Use], declared: str) -> None:
    place = _declared(draft, declared)
    if place is not None:
        times = f"{len(uses)} times" if len(uses) > 1 else "once"
        sentence = f"nothing uses {shown(declared)}, and {shown(name)}, which does not exist, is used {times}"
        hint = f"rename it to {name}, or fix {_lines(uses)}"
        _one_for_all(findings, uses, place, sentence, hint)


def _missing(draft: Draft, findings: Findings, name: str, uses: list[Use]) -> None:
    section = next((_SECTIONS[use.kind] for use in uses if use.kind in _SECTIONS), None)
    if section is not None and isinstance(draft.root, yaml_source.Mapping) and section in draft.root.entries:
        closest = uses[0].closest
        sentence = f"'{section}' has no {shown(name)}, which is used {len(uses)} times"
        suggestion = f": did you mean '{closest}'?" if closest is not None else ""
        hint = f"declare it here, or fix {_lines(uses)}{suggestion}"
        _one_for_all(findings, uses, draft.root.entries[section].place, sentence, hint)


def _lines(uses: list[Use]) -> str:
    """Write the lines of the uses in words, for example `line 3` or `lines 3 and 7`."""
    numbers = [str(line) for line in sorted({use.place.line for use in uses})]
    more = [f"{len(numbers) - _MOST_LINES_SHOWN} more"] if len(numbers) > _MOST_LINES_SHOWN else []
    return f"line{'s' if len(numbers) > 1 else ''} {listed([*numbers[:_MOST_LINES_SHOWN], *more])}"


def _one_for_all(findings: Findings, uses: list[Use], place: Place, sentence: str, hint: str) -> None:
    for use in uses:
        findings.withdraw(use.place)
    findings.add(rules.UNKNOWN_NAME, place, sentence, hint)


def _declared(draft: Draft, name: str) -> Place | None:
    """Place of the element with this name; None where no element, or more than one, has the name."""
    sections: tuple[Mapping[str, object], ...] = (
        *(draft.buses, draft.pes, draft.devices, draft.variables, draft.demuxes, draft.shorthands),
        *(draft.modules, draft.functions, draft.phases, draft.plants),
    )
    places = [getattr(section[name], "place", None) for section in sections if name in section]
    return places[0] if len(places) == 1 else None


def _named(root: yaml_source.Node) -> Counter[str]:
    """Count how often each name occurs in a file, including declarations."""
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
    """Count how often each word occurs in the names of a file; a name consists of words joined by `_`.

    named: how often each name occurs in the file.
    """
    words: Counter[str] = Counter()
    for name, times in named.items():
        for word in name.split("_"):
            words[word] += times
    return words
