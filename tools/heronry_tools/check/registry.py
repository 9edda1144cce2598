"""All families of rules, and who looks for those that the loader does not.

The loader itself finds DG0xx, DG1xx and the part of DG2xx without which a spec means nothing. Everything else is looked
for by a function `check(subject, findings)`, one per family, in a spec that loads. A family that solves keeps its rules
and its check in one file of this folder, and imports the planner inside its functions: to list a rule nobody needs a
solver.

To add a family: write its file, name its FAMILY in `FAMILIES` and its `check` in `CHECKS`.
"""

from collections.abc import Callable, Mapping

from heronry_dg.check.subject import Subject
from heronry_dg.findings import Findings
from heronry_dg.rules.rule import Family, Rule

Check = Callable[[Subject, Findings], None]

FAMILIES: tuple[Family, ...] = ()
CHECKS: Mapping[str, Check] = {}
RULES: Mapping[str, Rule] = {code: rule for family in FAMILIES for code, rule in sorted(family.rules.items())}
