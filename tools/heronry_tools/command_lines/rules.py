"""The command lines of `heronry rules`, `heronry explain` and `heronry schema`: arguments, their help, and examples."""

from typing import Any

from heronry_tools.console.output import JSON, add_output, add_output_file

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
    rules.set_defaults(run="run_rules")

    explain = subparsers.add_parser(
        "explain",
        description="Explain a code: what it finds, why that matters, how to mend it, and a spec before and after.",
        epilog=_EXPLAIN_EPILOG,
    )
    explain.add_argument("code", metavar="CODE", help="a code, or the name of its rule")
    add_output(explain, "write the rule as JSON")
    explain.set_defaults(run="run_explain")

    schema = subparsers.add_parser(
        "schema",
        description="Write the JSON schema of a spec, of a component graph, or of a line of events.",
        epilog=_SCHEMA_EPILOG,
    )
    schema.add_argument("format", nargs="?", choices=("dg", "pcs", "events"), default="dg", help="default: dg, a spec")
    add_output_file(schema, "JSON", ".json")
    schema.set_defaults(run="run_schema")
