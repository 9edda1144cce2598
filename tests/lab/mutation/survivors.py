"""Why a mutant survived, as far as its flights show it."""

from lab.mutation.trial import Verdict


def reason(verdict: Verdict) -> str:
    """Return the reason as a phrase for the report."""
    if not verdict.flown:
        return "no flight runs it"
    if not verdict.changed:
        return f"every frame of the {verdict.flown} flights that run it is the same"
    return f"frames differ in {verdict.changed} of the {verdict.flown} flights that run it, and every oracle holds"
