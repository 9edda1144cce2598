"""All families of rules, and the functions `check` of those families that the loader does not check completely.

The loader checks DG0xx, DG1xx, and those rules of DG2xx whose violation stops a spec from being loaded. Every other
rule is checked by the function `check(subject, findings)` of its family. `check` is called only with a spec that loads.

A *slow* family needs a solver, or runs foreign code. Its rules and its `check` are in files of this folder:

- The file of the rules imports the planner only inside functions, so that rules can be listed without a solver.
- The file of `check` is imported only when `check` is called, so that `heronry check --fast` is fast.

To add a family: write its files, name its FAMILY in `FAMILIES` and its `check` in `CHECKS`.
"""

from collections.abc import Mapping
from importlib import import_module
from typing import Final

from heronry_dg.check import graph as graph_check
from heronry_dg.check import wire as wire_check
from heronry_dg.check.assess import Check
from heronry_dg.check.subject import Subject
from heronry_dg.findings import Findings
from heronry_dg.rules import file, graph, schema, wire
from heronry_dg.rules.rule import Family, Rule
from heronry_tools.analysis.check import dependability_rules, driver_rules, image_rules, resource_rules


def _slow(module: str) -> Check:
    """Return the check of a slow family of rules; the file of the check is imported only when the check is called."""

    def check(subject: Subject, findings: Findings) -> None:
        import_module(f"heronry_tools.analysis.check.{module}").check(subject, findings)

    return check


FAMILIES: Final[tuple[Family, ...]] = (
    file.FAMILY,
    schema.FAMILY,
    graph.FAMILY,
    resource_rules.FAMILY,
    dependability_rules.FAMILY,
    wire.FAMILY,
    image_rules.FAMILY,
    driver_rules.FAMILY,
)
CHECKS: Final[Mapping[str, Check]] = {
    graph.FAMILY.prefix: graph_check.check,
    resource_rules.FAMILY.prefix: _slow("resources"),
    dependability_rules.FAMILY.prefix: _slow("dependability"),
    wire.FAMILY.prefix: wire_check.check,
    image_rules.FAMILY.prefix: _slow("images"),
    driver_rules.FAMILY.prefix: _slow("drivers"),
}
RULES: Final[Mapping[str, Rule]] = {code: rule for family in FAMILIES for code, rule in sorted(family.rules.items())}


def checks_of(*, fast: bool) -> dict[str, Check]:
    """Return the checks by the prefix of their codes; with `fast`, only checks without solver and foreign code."""
    slow = {family.prefix for family in FAMILIES if not family.fast}
    return {prefix: check for prefix, check in CHECKS.items() if not (fast and prefix in slow)}
