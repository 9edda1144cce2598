"""`heronry adopt`: asks a node that the spec does not have what it offers, and writes the lines of the spec for it.

The command reads object 2025h of the node by SDO, and changes nothing, neither on the node nor in the spec. SDO proves
nothing, so the answer may come from any node: read the lines before you paste them.
"""

import argparse
import json
from typing import Any

import canopen
from canopen.sdo.exceptions import SdoError

from heronry_dg.model import Spec
from heronry_tools.console.errors import UserError
from heronry_tools.console.progress import Working
from heronry_tools.console.spec_files import load_spec
from heronry_tools.runtime.canopen_log import keep_off_the_terminal
from heronry_wire import node_offer
from heronry_wire.bus_arguments import flagged_bus
from heronry_wire.bus_opening import open_bus
from heronry_wire.canopen_objects import OFFER

_ANSWER_WITHIN_S = 3.0


def run(arguments: argparse.Namespace) -> int:
    """Print the lines of the spec, or the offer as JSON; returns the exit code."""
    spec, node = load_spec(arguments.spec), arguments.node
    taken = next((pe.name for pe in spec.pes.values() if pe.node_id == node), None)
    if taken is not None:
        raise UserError(f"node {node} is {taken} in {spec.name} already: there is nothing to adopt")
    flags = {name: value for name, value in flagged_bus(arguments).items() if value is not None}
    with Working(f"asking node {node}"):
        offer = read_offer(_asked(flags, node), node)
    print(json.dumps({"node": node, **offer}) if arguments.json else "\n".join(spec_lines(spec, node, offer)))
    return 0


def read_offer(text: str, node: int) -> dict[str, Any]:
    """Read the offer of a node; raises UserError if the text is none."""
    found = node_offer.read_offer(text)
    if found is None:
        raise UserError(f"node {node} offers nothing: start its agent with --node, and wait until it waits for a table")
    return found


def spec_lines(spec: Spec, node: int, offer: dict[str, Any]) -> list[str]:
    """Return the lines for `pes` of the spec, with a comment on what else the node offers."""
    known = {module.image for module in spec.modules.values()}
    here = sorted(known.intersection(offer["images"]))
    has = f"cpu: {offer['cores']}, ram: {offer['ram_kib']}KiB, flash: {offer['disk_kib']}KiB"
    about = f"{offer['machine']}, Python {offer['python']}, heronry {offer['version']}"
    return [
        f"  # {about}",
        f"  # images of {spec.name} on it: {', '.join(here) or 'none'}",
        f"  node_{node}: {{node_id: {node}, buses: [{spec.manager.bus}], {has}}}",
    ]


def _asked(flags: dict[str, Any], node: int) -> str:
    """Read object 2025h of a node; raises UserError if the node does not answer."""
    keep_off_the_terminal()
    with canopen.Network(open_bus(flags).bus) as network:
        network.connect()
        sdo: Any = network.add_node(node, canopen.ObjectDictionary()).sdo  # type: ignore[no-untyped-call]
        sdo.RESPONSE_TIMEOUT = _ANSWER_WITHIN_S
        try:
            answer: bytes = sdo.upload(OFFER, 0)
        except SdoError as error:
            remedy = "its agent must run on this bus, started with --node"
            raise UserError(f"node {node} does not tell what it offers ({error}); {remedy}") from error
    return answer.decode("ascii", "replace")
