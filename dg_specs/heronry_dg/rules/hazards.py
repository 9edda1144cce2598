"""DG250 to DG252: rules of the family DG2 (graph.py) about how likely elements fail. Only analysis reads these keys."""

from heronry_dg.rules.graph import FAMILY


def _two_buses(first: str, second: str, more: str = "") -> str:
    """Write a spec with two buses that have these keys, and more sections."""
    return (
        f"buses: {{can0: {{bitrate: 1000000, {first}}}, can1: {{bitrate: 1000000, {second}}}}}\n"
        f"manager: {{bus: can0}}\n{more}"
    )


def _causes(first: str, second: str) -> str:
    """Write a spec with two common causes of the same buses, with these shares."""
    group = "elements: [bus:can0, bus:can1]"
    causes = f"common_cause: [{{{group}, beta: {first}}}, {{{group}, beta: {second}}}]\n"
    return _two_buses("rate_per_h: 0.001", "rate_per_h: 0.001", causes)


_ONE_CAUSE = "common_cause: [{elements: [bus:can0, bus:can1], beta: 0.1}]\n"

RATE_AND_PROBABILITY = FAMILY.error(
    "DG250",
    "rate-and-probability",
    what="An element has a `rate_per_h` and a `probability`.",
    why="Each of them alone says how likely the element fails: by the hour, or whatever the time.",
    fix="Leave one of them out.",
    bad=_two_buses("rate_per_h: 0.001, probability: 0.01", "rate_per_h: 0.001"),
    good=_two_buses("rate_per_h: 0.001", "rate_per_h: 0.001"),
)
MIXED_CAUSE = FAMILY.error(
    "DG251",
    "common-cause-mixed",
    what="The elements of a common cause do not all have a `rate_per_h`, or all a `probability`.",
    why="The cause has a share of the lowest rate of its group, or of the lowest probability. There is no lowest of "
    "rates and probabilities, or of what is not known.",
    fix="Write a `rate_per_h` for each element of the group, or a `probability` for each.",
    bad=_two_buses("rate_per_h: 0.001", "probability: 0.01", _ONE_CAUSE),
    good=_two_buses("rate_per_h: 0.001", "rate_per_h: 0.002", _ONE_CAUSE),
)
SHARES_ABOVE_ONE = FAMILY.error(
    "DG252",
    "common-cause-shares",
    what="The shares `beta` of the common causes of one element add up to more than 1.",
    why="Each cause takes its share of the element's own rate, and no more than the whole rate can be taken.",
    fix="Lower `beta` of the causes that name the element.",
    bad=_causes("0.6", "0.5"),
    good=_causes("0.5", "0.5"),
)
