"""`heronry table`: the table that a PE's agent is given."""

import argparse
import sys
from pathlib import Path
from typing import Any

_EPILOG = """\
examples:
  heronry table big_blue nav -o nav.table
  pe-agent --table nav.table -i socketcan -c can0
  heronry table big_blue --all tables/           one file per PE, named PE.table
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parser of `heronry table`."""
    parser = subparsers.add_parser(
        "table",
        help="compile the table that a PE's agent needs",
        description="Compile what one PE needs to know of a spec: modules, modes, identifiers, ports.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("spec", metavar="SPEC", help="a *.dg.yaml file, or a shipped spec")
    parser.add_argument("pe", metavar="PE", nargs="?", help="name of the PE")
    parser.add_argument("-o", "--output", metavar="FILE", type=Path, help="write here instead of to standard output")
    parser.add_argument("--all", metavar="DIR", type=Path, help="write the tables of all PEs into this folder")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Write one table, or all; returns the exit code."""
    from heronry_manager.compilation import Compiler  # noqa: PLC0415 - loads pydantic
    from heronry_tools.errors import UserError  # noqa: PLC0415
    from heronry_tools.spec_argument import load_spec  # noqa: PLC0415

    spec = load_spec(arguments.spec)
    if (arguments.pe is None) == (arguments.all is None):
        raise UserError("name one PE, or write --all DIR")
    if arguments.all is not None:
        write_tables(Compiler(spec), tuple(spec.pes), arguments.all)
        return 0
    if arguments.pe not in spec.pes:
        raise UserError(f"no pe is named '{arguments.pe}'; there is {', '.join(spec.pes)}")
    text = Compiler(spec).table(arguments.pe).to_json() + "\n"
    if arguments.output is None:
        sys.stdout.write(text)
    else:
        arguments.output.write_text(text)
    return 0


def write_tables(compiler: Any, pes: tuple[str, ...], folder: Path) -> dict[str, Path]:
    """Write one table per PE into a folder, which is made if need be; gives the files by PE."""
    folder.mkdir(parents=True, exist_ok=True)
    files = {pe: folder / f"{pe}.table" for pe in pes}
    for pe, file in files.items():
        file.write_text(compiler.table(pe).to_json() + "\n")
    return files
