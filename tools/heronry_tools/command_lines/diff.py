"""The command line of `heronry diff`: arguments, their help, and examples."""

from typing import Any

from heronry_tools.console.output import JSON, add_output

_EPILOG = """\
The second line tells whether the digest changes, and what follows from that. A function depends on an element (its
single point of failure) if the loss of that element alone loses the function. Critical functions, classes A to D, are
examined in each phase that wants them. 'changed in flight' tells which running modules would go on untouched, and
which would stop, start, move or change, in the first phase of NEW with nothing down. The output ends with the
findings of 'heronry check' that only NEW has, and those that only OLD has.

OLD and NEW are each a *.dg.yaml, a shipped spec, REV:PATH in git (:PATH is what is staged), or - for standard input.

examples:
  heronry diff big_blue my.dg.yaml                          what is different, and what follows from it
  heronry diff HEAD:my.dg.yaml my.dg.yaml                   what was changed since the last commit
  heronry diff main:specs/my.dg.yaml HEAD:specs/my.dg.yaml  what a branch changes
  heronry diff my.dg.yaml <(sed 's/cpu: 0.20/cpu: 0.60/' my.dg.yaml)      what if
  heronry diff old.dg.yaml new.dg.yaml --json               the same for a program
  heronry diff old.dg.yaml new.dg.yaml --format mermaid     what changed as a picture, for a pull request
  heronry diff HEAD:my.dg.yaml my.dg.yaml --exit-code       ends with 1 if anything changed, for CI
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parser of `heronry diff`."""
    parser = subparsers.add_parser(
        "diff",
        description="Compare two specs: elements, functions served, single points of failure, bus and CPU load.",
        epilog=_EPILOG,
    )
    parser.add_argument(
        "old", metavar="OLD", help="a *.dg.yaml, a shipped spec, REV:PATH in git, or - (standard input)"
    )
    parser.add_argument("new", metavar="NEW", help="the changed spec")
    parser.add_argument(
        "--exit-code", action="store_true", help="end with exit code 1 if the specs differ, as git diff does"
    )
    add_output(parser, forms={"text": (), "json": JSON, "mermaid": (".mmd", ".mermaid")})
