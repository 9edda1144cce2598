"""Why a mutant survived: what its flights tell of it, and what a reviewer has found out about its place."""

from lab.mutation.trial import Verdict


def reason(verdict: Verdict) -> str:
    """Say why."""
    if not verdict.flown:
        return "no flight runs it"
    if not verdict.changed:
        return f"every frame of the {verdict.flown} flights that run it is the same"
    return f"frames differ in {verdict.changed} of the {verdict.flown} flights that run it, and all judges are content"
