"""The command line of `heronry check`: arguments, their help, and examples."""

import argparse
from typing import Any, Final

from heronry_tools.console.output import JSON, Forms, add_output

_FORMATS: Final[Forms] = {
    "full": (),
    "concise": (),
    "json": JSON,
    "github": (),
    "sarif": (".sarif", *JSON),
    "junit": (".xml",),
}
_EPILOG: Final = """\
examples:
  heronry check                                  every *.dg.yaml and *.pcs.yaml below this folder
  heronry check --fast my.dg.yaml                without the rules that need a solver: for editors and hooks
  heronry check specs/ --strict                  warnings fail, too
  heronry check specs/ --quiet                   errors only; warnings are counted
  heronry check --select DG2,DG4 --ignore DG240  two families, without one code
  heronry check --error DG401 my.dg.yaml         this warning counts as an error
  heronry check -o findings.sarif                for a forge that shows SARIF; --format names all forms
  heronry rules                                  all codes; heronry explain DG203 explains one

In a spec:  speed: {type: FLOAT}  # dg: ignore[DG240] read by the ground station
Above it:   # dg: error[DG401]
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parser of `heronry check`."""
    parser = subparsers.add_parser(
        "check",
        description="Check specs against every rule, and read component graphs (*.pcs.yaml, *.pcs.json). "
        "Exit code 0: no errors; 1: errors; 2: wrong usage.",
        epilog=_EPILOG,
    )
    parser.add_argument(
        "paths", metavar="PATH", nargs="*", default=["."], help="a spec, a folder of specs, or - for standard input"
    )
    parser.add_argument("--fast", action="store_true", help="check only the rules that need no solver")
    parser.add_argument(
        "--select",
        metavar="CODES",
        type=_codes,
        default=["DG"],
        help="report only findings with these codes or beginnings of codes, for example DG2,DG401",
    )
    parser.add_argument("--ignore", metavar="CODES", type=_codes, default=[], help="leave out these codes")
    parser.add_argument(
        "--error", metavar="CODES", type=_codes, default=[], help="count warnings with these codes as errors"
    )
    parser.add_argument("--strict", action="store_true", help="count all warnings as errors")
    parser.add_argument("-q", "--quiet", action="store_true", help="report errors only, and the number of warnings")
    add_output(parser, "write the findings as JSON", _FORMATS, "github where GITHUB_ACTIONS is set, full elsewhere")


def _codes(text: str) -> list[str]:
    codes = [code.strip() for code in text.split(",")]
    if not all(codes):
        raise argparse.ArgumentTypeError(
            f"{text!r} leaves a code empty: write codes or beginnings of codes, for example DG2,DG401"
        )
    return codes
