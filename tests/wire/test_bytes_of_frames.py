"""Only the codecs know positions of bytes in a frame: elsewhere a subscript of bytes, or their unpacking, is an error.

The test searches the source of all packages for a subscript of an attribute `data`, of a name that was bound to one, or
of a parameter that is `bytes`; and for `from_bytes` and `unpack`. Files that handle other bytes are listed with what
these are, and a file that does not need its place on the list any more is an error, too.
"""

import ast
from collections.abc import Iterator
from pathlib import Path

import heronry_agent
import heronry_dg
import heronry_manager
import heronry_tools
import heronry_wire

PACKAGES = (heronry_wire, heronry_dg, heronry_agent, heronry_manager, heronry_tools)
CODECS = frozenset(
    f"heronry_wire/{name}.py"
    for name in (
        *("authentication", "canaerospace", "command_tags", "configuration_slice", "contingency_block", "controller"),
        *("checkpoint_frames", "gateway_report", "layout", "management", "nmt", "sdo", "state_frames"),
    )
)
OTHER_BYTES = {
    "heronry_agent/shell/module_states.py": "the state of a module",
    "heronry_agent/shell/partition_states.py": "what an agent and its partition say to each other",
    "heronry_wire/bundle.py": "a file",
    "heronry_wire/part_transfer.py": "the value of an object, which SDO carries",
    "heronry_wire/can_interface.py": "what the kernel tells of an interface (netlink)",
    "heronry_wire/frame_port.py": "what the kernel hands over at a CAN socket",
    "heronry_wire/python_can.py": "what the kernel tells of a socket",
    "heronry_wire/thinning.py": "any content, of which the receiver's mask says what is new",
    "heronry_agent/core/authority/nonces.py": "a digest, of which a nonce is made",
    "heronry_agent/core/canopen/object_dictionary.py": "the value of an object, which SDO carries",
    "heronry_agent/core/canopen/sdo_server.py": "what a transfer carries",
    "heronry_agent/drivers/bmp280.py": "registers of a chip",
    "heronry_agent/drivers/iio_buffer.py": "samples that the kernel keeps",
    "heronry_agent/drivers/ms5611.py": "registers of a chip",
    "heronry_agent/shell/device_processes/shared_block.py": "memory that an agent shares with a process",
    "heronry_agent/shell/partition_messages.py": "what a partition and its agent say to each other",
    "heronry_manager/core/provisioning/served_pe.py": "what a transfer carries",
    "heronry_manager/contingency/file_format.py": "a file",
    "heronry_manager/shell/control_place.py": "who calls (SO_PEERCRED)",
    "heronry_tools/runtime/bundle_sending.py": "a file, which goes out in parts",
    "heronry_tools/aircraft/plant/noise.py": "a digest, of which noise is made",
    "heronry_dg/yaml_source.py": "a file",
    "heronry_tools/fly/live/shared_readings.py": "what the plant process and its devices share",
    "heronry_tools/runtime/softbus/port.py": "who calls (SO_PEERCRED)",
    "heronry_tools/runtime/vcan/streams.py": "what a process writes",
    "heronry_tools/runtime/softbus/protocol.py": "what the hub and its clients say to each other",
    "heronry_tools/sim/faults/forger.py": "a frame that is cut short, whatever it says",
    "heronry_tools/sim/world/inspection/node_services.py": "the value of an object, which SDO carries",
    "heronry_tools/sim/world/inspection/topic.py": "the value of an object, which SDO carries",
    "heronry_tools/sim/oracles/tables.py": "a request of SDO, which an oracle reads by itself",
    "heronry_tools/sim/world/disk.py": "a file",
    "heronry_tools/sim/world/simulated_loader.py": "a file",
    "heronry_tools/sim/world/sdo_talk.py": "what a transfer carries",
}

_UNPACKING = ("from_bytes", "unpack", "unpack_from")


def peeks(tree: ast.AST) -> Iterator[ast.expr]:
    """Every place where positions of bytes are used."""
    for scope in ast.walk(tree):
        if isinstance(scope, ast.FunctionDef | ast.AsyncFunctionDef):
            named = {arg.arg for arg in _arguments(scope.args) if _is_bytes(arg.annotation)}
            named |= {name for node in ast.walk(scope) for name in _bound_to_data(node)}
            for node in ast.walk(scope):
                if isinstance(node, ast.Subscript) and isinstance(node.value, ast.Name) and node.value.id in named:
                    yield node
    for node in ast.walk(tree):
        is_peek = isinstance(node, ast.Subscript) and _is_data(node.value)
        if is_peek or (isinstance(node, ast.Attribute) and node.attr in _UNPACKING):
            yield node


def _arguments(arguments: ast.arguments) -> list[ast.arg]:
    return [*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs]


def _is_bytes(annotation: ast.expr | None) -> bool:
    return isinstance(annotation, ast.Name) and annotation.id == "bytes"


def _is_data(value: ast.expr) -> bool:
    return isinstance(value, ast.Attribute) and value.attr == "data"


def _bound_to_data(node: ast.AST) -> Iterator[str]:
    if not isinstance(node, ast.Assign):
        return
    for target in node.targets:
        pairs = [(target, node.value)]
        if isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple):
            pairs = list(zip(target.elts, node.value.elts, strict=True))
        yield from (name.id for name, value in pairs if isinstance(name, ast.Name) and _is_data(value))


def test_only_codecs_count_the_bytes_of_a_frame() -> None:
    found: dict[str, list[int]] = {}
    for package in PACKAGES:
        root = Path(package.__path__[0])
        for path in sorted(root.rglob("*.py")):
            lines = sorted({node.lineno for node in peeks(ast.parse(path.read_text()))})
            if lines:
                found[f"{root.name}/{path.relative_to(root).as_posix()}"] = lines
    listed = CODECS | OTHER_BYTES.keys()
    assert {path: lines for path, lines in found.items() if path not in listed} == {}, "ask a reader of a codec"
    assert sorted(listed - found.keys()) == [], "take these from the list"


def test_what_is_found() -> None:
    source = """
def f(frame, data: bytes):
    a, said = 1, frame.data
    frame.data[0]
    said[1:]
    data[a]
    int.from_bytes(b"")
    other[0]
    return frame.data
"""
    assert sorted(node.lineno for node in peeks(ast.parse(source))) == [4, 5, 6, 7]
