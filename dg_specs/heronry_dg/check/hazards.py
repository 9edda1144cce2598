"""The checks of DG250 to DG252: the keys that say how likely elements fail make sense together."""

from fractions import Fraction

from heronry_dg.check.subject import Subject
from heronry_dg.findings import Findings
from heronry_dg.model.fallible import Fallible
from heronry_dg.rules import hazards as rules


def check_hazards(subject: Subject, findings: Findings) -> None:
    """Add a finding for each element that fails in two ways, and for each common cause without a meaning."""
    fallible = _fallible(subject)
    for element, its in fallible.items():
        if its.rate_per_h is not None and its.probability is not None:
            section, name = _SECTIONS[element.partition(":")[0]], element.partition(":")[2]
            place = subject.place(section, name, "probability")
            sentence = f"{element} has a 'rate_per_h' and a 'probability'"
            findings.add(rules.RATE_AND_PROBABILITY, place, sentence, "leave one of them out")
    shares: dict[str, Fraction] = {}
    for number, cause in enumerate(subject.spec.common_cause):
        group = [fallible[element] for element in cause.elements if element in fallible]
        place = subject.place("common_cause", number, "elements")
        if any(one.rate_per_h is None for one in group) and any(one.probability is None for one in group):
            sentence = f"the elements of the common cause {', '.join(cause.elements)} have no 'rate_per_h' each, "
            sentence += "and no 'probability' each"
            findings.add(rules.MIXED_CAUSE, place, sentence, "write what is missing")
        for element in cause.elements:
            before = shares.get(element, Fraction(0))
            shares[element] = before + Fraction(cause.beta)
            if before <= 1 < shares[element]:
                sentence = f"the shares 'beta' of the common causes of {element} add up to {float(shares[element]):g}"
                place = subject.place("common_cause", number, "beta")
                findings.add(rules.SHARES_ABOVE_ONE, place, sentence, "lower them to 1 or less together")


_SECTIONS = {"pe": "pes", "device": "devices", "module": "modules", "bus": "buses"}


def _fallible(subject: Subject) -> dict[str, Fallible]:
    """Return the elements that may have a rate or a probability."""
    return {
        f"{kind}:{name}": element
        for kind, section in _SECTIONS.items()
        for name, element in getattr(subject.spec, section).items()
    }
