"""The rule PCS001: a file is no component graph, since its text, a field, a value or a name is not allowed."""

from typing import Final

from heronry_dg.rules.rule import Rule, Severity

BAD_FILE: Final = Rule(
    code="PCS001",
    name="bad-graph-file",
    severity=Severity.ERROR,
    what="The file is no component graph: its text, a field, a value or a name is not what the format allows.",
    why="Nothing is guessed: what one program skips and another one reads would be two graphs.",
    fix="Look at the place shown; docs/polymorphic.md has the format.",
    bad="pcs: 1\ncomponents: {A: {ports: [a]}}\nedges: [A.a -> B.b]\n",
    good="pcs: 1\ncomponents: {A: {ports: [a]}, B: {ports: [b]}}\nedges: [A.a -> B.b]\n",
    stops=True,
)
RULES: Final = {BAD_FILE.code: BAD_FILE}
