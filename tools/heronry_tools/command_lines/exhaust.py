"""The command line of `heronry exhaust`: arguments, their help, and examples."""

from typing import Any

from heronry_tools.console.flight_arguments import add_compiled_argument, add_jobs_argument
from heronry_tools.console.number_arguments import whole_number
from heronry_tools.console.output import add_output
from heronry_tools.console.spec_argument import add_spec_argument

_EPILOG = """\
A story is one event that makes the aircraft reconfigure: its start, each PE's loss, return and reboot, each module that
raises, each sensor that dies, each element that the operator fails and clears, each phase, requested by the operator or
by a module; with --standby also the death of the active manager. Each story is flown once for each fault: one of its
management frames, from the first to the last, is lost, doubled or late, for one node or for all nodes, or a node dies
at that frame. Use a spec with three PEs: it has some 37000 flights, half an hour on one processor.

Exit codes: 0 all is well; 1 an oracle was violated, or a fault of a given case was not injected; 2 the input cannot be
used; 130 and 143 ended by Ctrl-C and by SIGTERM.

examples:
  heronry exhaust dg_specs/examples/demux_actuators.dg.yaml --sample 200      drawn from all of them, by --seed
  heronry exhaust dg_specs/examples/demux_actuators.dg.yaml --jobs 0          all of them
  heronry exhaust dg_specs/examples/demux_actuators.dg.yaml --count           only tell how many there are
  heronry exhaust my.dg.yaml --pairs 5000 --sample 0                          two at a time, drawn
  heronry exhaust my.dg.yaml --case 'crash pe:nav: 17 lost pe:tail, 20 crash manager'
  heronry exhaust my.dg.yaml --standby --keyed --foreseen 1 --sample 500      two managers, a key, plans on board
  heronry exhaust my.dg.yaml --tables --standby --sample 200                  tables over the bus, and retirement
  heronry exhaust my.dg.yaml --reload new.dg.yaml --sample 200                the change to another spec in flight
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parser of `heronry exhaust`."""
    parser = subparsers.add_parser(
        "exhaust",
        description=(
            "Inject every fault at every message of every reconfiguration, one fault in each flight, and check the "
            "flights."
        ),
        epilog=_EPILOG,
    )
    add_spec_argument(parser)
    parser.add_argument("--sample", type=whole_number, metavar="N", help="fly only N single faults, drawn at random")
    parser.add_argument(
        "--pairs",
        type=whole_number,
        default=0,
        metavar="N",
        help="also fly N pairs of faults, drawn at random (default: 0)",
    )
    parser.add_argument(
        "--seed", type=whole_number, default=0, metavar="N", help="seed from which faults are drawn (default: 0)"
    )
    parser.add_argument("--standby", action="store_true", help="fly with two managers")
    parser.add_argument("--keyed", action="store_true", help="give managers and PEs a key")
    parser.add_argument(
        "--tables",
        action="store_true",
        help="other stories: a node without a table takes the place of each PE, and each PE is retired and restored",
    )
    parser.add_argument(
        "--reload",
        metavar="FILE",
        help="another story: the operator orders the change to the spec in this file",
    )
    parser.add_argument(
        "--foreseen",
        type=whole_number,
        metavar="N",
        help="make plans ahead for up to N faults, and put the plans on board (default: no plans are made ahead)",
    )
    parser.add_argument("--count", action="store_true", help="fly nothing: count the single faults of each story")
    parser.add_argument(
        "--case", action="append", default=[], metavar="CASE", help="fly only this case, 'STORY: FAULT, ..'; see below"
    )
    add_jobs_argument(parser)
    add_compiled_argument(parser)
    add_output(parser, "write the flights and their failures, or the counts of --count, as JSON")
