"""`heronry rules`, `heronry explain` and `heronry schema`: the rules of specs, for people and for editors."""

import argparse
import json
import sys

from heronry_dg.check import json_schema as of_specs
from heronry_dg.check.rules_page import explained, page, table
from heronry_dg.rules.rule import Rule
from heronry_manager.events import schema as of_events
from heronry_pcs import json_schema as of_graphs
from heronry_pcs.file_rules import RULES as GRAPH_RULES
from heronry_tools.analysis.check.registry import FAMILIES, RULES
from heronry_tools.console.errors import UserError
from heronry_wire.spelling import meant

_FIELDS = ("code", "name", "severity", "stops", "what", "why", "fix", "bad", "good")


def run_rules(arguments: argparse.Namespace) -> int:
    """List the rules; returns the exit code."""
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
    wanted = arguments.code.strip()
    rules = {**RULES, **GRAPH_RULES}
    rule = rules.get(wanted.upper()) or next((rule for rule in rules.values() if rule.name == wanted.lower()), None)
    if rule is None:
        remedy = meant(wanted.lower(), [rule.name for rule in RULES.values()], "'heronry rules' lists all codes")
        raise UserError(f"there is no code '{wanted}'; {remedy}")
    sys.stdout.write(json.dumps(_fields(rule), indent=2) + "\n" if arguments.json else explained(rule))
    return 0


def _fields(rule: Rule) -> dict[str, object]:
    return {field: getattr(rule, field) for field in _FIELDS}


def run_schema(arguments: argparse.Namespace) -> int:
    """Write the JSON schema of a spec, a component graph or a line of events; returns the exit code."""
    texts = {"dg": of_specs.schema_text, "pcs": of_graphs.schema_text, "events": of_events.schema_text}
    sys.stdout.write(texts[arguments.format]())
    return 0
