"""`heronry rules`, `heronry explain` and `heronry schema`: the rules of specs, for people and for editors."""

import argparse
import json
import sys
from typing import TYPE_CHECKING, Any

from heronry_tools.console.errors import UserError
from heronry_tools.console.output import JSON, add_output, add_output_file
from heronry_wire.spelling import meant

if TYPE_CHECKING:
    from heronry_dg.rules.rule import Rule

_RULES_EPILOG = """\
examples:
  heronry rules                                  a line for each code
  heronry rules DG4                              the family of dependability
  heronry rules --json | jq '.[] | select(.severity == "error") | .code'
  heronry rules --format markdown -o rules.md    all of them explained, with examples
"""
_EXPLAIN_EPILOG = """\
examples:
  heronry explain DG201                          a name that refers to nothing
  heronry explain dg401                          a code in lower case
  heronry explain unknown-variable               the name of a rule does as well
  heronry explain DG401 --json | jq -r .fix
"""
_FIELDS = ("code", "name", "severity", "stops", "what", "why", "fix", "bad", "good")
_SCHEMA_EPILOG = """\
An editor with the YAML language server completes and checks specs that begin with this line:
  # yaml-language-server: $schema=dg.schema.json
examples:
  heronry schema -o dg.schema.json
  heronry schema pcs -o pcs.schema.json
  heronry schema events -o events.schema.json
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parsers of `heronry rules`, `heronry explain` and `heronry schema`."""
    rules = subparsers.add_parser(
        "rules",
        description="List the rules of heronry check: code, severity, name, and what each finds. "
        "heronry explain says more about one code.",
        epilog=_RULES_EPILOG,
    )
    rules.add_argument("codes", metavar="CODE", nargs="*", help="codes, or beginnings of codes (default: all rules)")
    add_output(
        rules,
        "write the rules, examples included, as JSON",
        {"text": (), "json": JSON, "markdown": (".md",)},
    )
    rules.set_defaults(run=run_rules)

    explain = subparsers.add_parser(
        "explain",
        description="Explain a code: what it finds, why that matters, how to mend it, and a spec before and after.",
        epilog=_EXPLAIN_EPILOG,
    )
    explain.add_argument("code", metavar="CODE", help="a code, or the name of its rule")
    add_output(explain, "write the rule as JSON")
    explain.set_defaults(run=run_explain)

    schema = subparsers.add_parser(
        "schema",
        description="Write the JSON schema of a spec, of a component graph, or of a line of events.",
        epilog=_SCHEMA_EPILOG,
    )
    schema.add_argument("format", nargs="?", choices=("dg", "pcs", "events"), default="dg", help="default: dg, a spec")
    add_output_file(schema, "JSON", ".json")
    schema.set_defaults(run=run_schema)


def run_rules(arguments: argparse.Namespace) -> int:
    """List the rules; returns the exit code."""
    from heronry_dg.check.rules_page import page, table  # noqa: PLC0415 - pydantic is slow to import
    from heronry_tools.analysis.check.registry import FAMILIES, RULES  # noqa: PLC0415

    for typed in arguments.codes:
        if not any(code.startswith(typed.upper()) for code in RULES):
            raise UserError(f"no code of 'heronry check' begins with '{typed}'; 'heronry rules' lists all codes")
    prefixes = tuple(typed.upper() for typed in arguments.codes)
    chosen = [rule for code, rule in RULES.items() if not prefixes or code.startswith(prefixes)]
    if arguments.format == "markdown":
        if prefixes:
            raise UserError("the page in Markdown always has all rules; leave the codes out")
        sys.stdout.write(page(FAMILIES))
    elif arguments.json:
        sys.stdout.write(json.dumps([_fields(rule) for rule in chosen], indent=2) + "\n")
    else:
        sys.stdout.write(table(chosen))
        if len(chosen) == 1:
            print(f"\n'heronry explain {chosen[0].code}' has more: why it matters, how to mend it, and an example")
    return 0


def run_explain(arguments: argparse.Namespace) -> int:
    """Explain the rule with the code or name that the user gives; returns the exit code of the program."""
    from heronry_dg.check.rules_page import explained  # noqa: PLC0415
    from heronry_pcs.file_rules import RULES as GRAPH_RULES  # noqa: PLC0415
    from heronry_tools.analysis.check.registry import RULES  # noqa: PLC0415

    wanted = arguments.code.strip()
    rules = {**RULES, **GRAPH_RULES}
    rule = rules.get(wanted.upper()) or next((rule for rule in rules.values() if rule.name == wanted.lower()), None)
    if rule is None:
        remedy = meant(wanted.lower(), [rule.name for rule in RULES.values()], "'heronry rules' lists all codes")
        raise UserError(f"there is no code '{wanted}'; {remedy}")
    sys.stdout.write(json.dumps(_fields(rule), indent=2) + "\n" if arguments.json else explained(rule))
    return 0


def _fields(rule: "Rule") -> dict[str, object]:
    return {field: getattr(rule, field) for field in _FIELDS}


def run_schema(arguments: argparse.Namespace) -> int:
    """Write the JSON schema of a spec, a component graph or a line of events; returns the exit code."""
    from heronry_dg.check import json_schema as of_specs  # noqa: PLC0415
    from heronry_manager.events import schema as of_events  # noqa: PLC0415
    from heronry_pcs import json_schema as of_graphs  # noqa: PLC0415

    texts = {"dg": of_specs.schema_text, "pcs": of_graphs.schema_text, "events": of_events.schema_text}
    sys.stdout.write(texts[arguments.format]())
    return 0
