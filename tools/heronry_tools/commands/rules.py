"""`heronry rules`, `heronry explain` and `heronry schema`: the rules of specs, for people and for editors."""

import argparse
import json
import sys
from typing import Any

from heronry_tools.console.errors import UserError

_SCHEMA_EPILOG = """\
An editor with the YAML language server completes and checks specs that begin with this line:
  # yaml-language-server: $schema=dg.schema.json
examples:
  heronry schema >dg.schema.json
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parsers of the three commands."""
    rules = subparsers.add_parser(
        "rules", help="list all rules of heronry check", description="List all rules of heronry check."
    )
    form = rules.add_mutually_exclusive_group()
    form.add_argument("--json", action="store_true", help="write the rules, examples included, as JSON")
    form.add_argument("--docs", action="store_true", help="write docs/rules.md")
    rules.set_defaults(run=run_rules)

    explain = subparsers.add_parser(
        "explain", help="explain a finding, and how to fix it", description="Explain a code, as DG203."
    )
    explain.add_argument("code", metavar="CODE", help="a code, or the name of its rule")
    explain.set_defaults(run=run_explain)

    schema = subparsers.add_parser(
        "schema",
        help="write the JSON schema of specs, for editors",
        description="Write the JSON schema (draft 7) of a spec.",
        epilog=_SCHEMA_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    schema.set_defaults(run=run_schema)


def run_rules(arguments: argparse.Namespace) -> int:
    """List the rules; returns the exit code."""
    from heronry_dg.check.rules_page import page, table  # noqa: PLC0415 - pydantic is slow to import
    from heronry_tools.analysis.check.registry import FAMILIES, RULES  # noqa: PLC0415

    if arguments.docs:
        sys.stdout.write(page(FAMILIES))
    elif arguments.json:
        fields = ("code", "name", "severity", "stops", "what", "why", "fix", "bad", "good")
        rules = [{field: getattr(rule, field) for field in fields} for rule in RULES.values()]
        sys.stdout.write(json.dumps(rules, indent=2) + "\n")
    else:
        sys.stdout.write(table(RULES.values()))
    return 0


def run_explain(arguments: argparse.Namespace) -> int:
    """Explain one code; returns the exit code."""
    from heronry_dg.check.rules_page import explained  # noqa: PLC0415
    from heronry_tools.analysis.check.registry import RULES  # noqa: PLC0415

    wanted = arguments.code.strip()
    rule = RULES.get(wanted.upper()) or next((rule for rule in RULES.values() if rule.name == wanted.lower()), None)
    if rule is None:
        raise UserError(f"there is no code '{wanted}'; heronry rules lists all codes")
    sys.stdout.write(explained(rule))
    return 0


def run_schema(_arguments: argparse.Namespace) -> int:
    """Write the schema; returns the exit code."""
    from heronry_dg.check.json_schema import schema_text  # noqa: PLC0415

    sys.stdout.write(schema_text())
    return 0
