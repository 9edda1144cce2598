"""`heronry send-table`: give a PE that waits for it its table, over the bus."""

import argparse
from typing import Any

_ANSWER_WITHIN_S = 5.0
_CHUNK = 7000  # whole segments: the client can send no other but the last
_EPILOG = """\
examples:
  pe-agent --node 92 -i socketcan -c can0                        on the PE: it waits
  heronry send-table big_blue flight -i socketcan -c can0        on any other node of that bus

The table goes by SDO block transfer into object 2020h. A PE that has its table takes no other: restart it first.
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parser of `heronry send-table`."""
    from can.cli import add_bus_arguments  # noqa: PLC0415 - keeps `heronry plan` quick

    from heronry_tools.table_command import add_contingencies_argument  # noqa: PLC0415

    parser = subparsers.add_parser(
        "send-table",
        help="send a PE that waits for it its table, over the bus",
        description="Compile the table of a PE and write it into the PE by SDO.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("spec", metavar="SPEC", help="a *.dg.yaml file, or a shipped spec")
    parser.add_argument("pe", metavar="PE", help="name of the PE")
    add_contingencies_argument(parser)
    add_bus_arguments(parser, group_title="a bus that the PE has as its uplink")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Send the table; returns the exit code."""
    from heronry_tools.errors import UserError  # noqa: PLC0415
    from heronry_tools.spec_argument import load_spec  # noqa: PLC0415
    from heronry_tools.table_command import table_texts  # noqa: PLC0415
    from heronry_wire.bus_arguments import flagged_bus  # noqa: PLC0415

    spec = load_spec(arguments.spec)
    if arguments.pe not in spec.pes:
        raise UserError(f"no pe is named '{arguments.pe}'; there is {', '.join(spec.pes)}")
    text = table_texts(spec, [arguments.pe], arguments.contingencies)[arguments.pe].encode()
    flags = {key: value for key, value in flagged_bus(arguments).items() if value is not None}
    node = spec.pes[arguments.pe].node_id
    _send(flags, node, text)
    print(f"{arguments.pe}, node {node}, has its table: {len(text)} bytes")
    return 0


def _send(flags: dict[str, Any], node: int, text: bytes) -> None:
    import canopen  # noqa: PLC0415 - slow to import
    from canopen.sdo.exceptions import SdoError  # noqa: PLC0415

    from heronry_tools.errors import UserError  # noqa: PLC0415
    from heronry_wire.canopen_objects import TABLE  # noqa: PLC0415
    from heronry_wire.link import open_bus  # noqa: PLC0415

    bus, _ = open_bus(flags)
    with canopen.Network(bus) as network:
        network.connect()
        sdo: Any = network.add_node(node, canopen.ObjectDictionary()).sdo  # type: ignore[no-untyped-call]
        sdo.RESPONSE_TIMEOUT = _ANSWER_WITHIN_S
        try:
            with sdo.open(TABLE, 0, "wb", size=len(text), block_transfer=True, buffering=_CHUNK) as stream:
                stream.write(text)
        except SdoError as error:
            remedy = "it must wait for its table (pe-agent --node), and this bus must be its uplink"
            raise UserError(f"node {node} did not take the table ({error}); {remedy}") from error
