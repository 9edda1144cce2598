"""Brings a bundle to a PE by SDO, in parts that go on where the last attempt was cut off, and starts it there.

    asked       does the PE run this bundle (2030h sub 3), or how much of it has it already (2030h sub 2)?
    sending     one part after the other (2030h sub 1), by block transfer; its segments take a tenth of the slowest
                bus on the way, whatever runs there: this is for a PE at rest
    checked     the PE's loader works on the whole bundle (1F57h); then it says what is wrong, or the bundle is ready
    started     1F51h is written; the code is in use

A part that is lost, or that the PE does not take because it is locked, is sent again for PATIENCE_S. If the PE restarts
meanwhile it has forgotten the last parts, and this program ends; started anew it sends what the PE lacks. Whatever ends
this program leaves the PE with the code before.
"""

import hashlib
import queue
import time
from collections.abc import Callable, Iterator
from typing import Any, TypeVar

import canopen
from canopen.sdo.exceptions import SdoAbortedError, SdoError

from heronry_dg.model import Spec
from heronry_dg.situation import Situation, survivors
from heronry_manager.core.sdo_client import BlockDownload, Outcome
from heronry_tools.console.errors import UserError
from heronry_tools.runtime.canopen_log import keep_off_the_terminal
from heronry_wire.bundle import Bundle
from heronry_wire.bus_opening import open_bus
from heronry_wire.canopen_objects import PROGRAM_CONTROL, PROGRAM_STATUS, PROGRAM_TRANSFER
from heronry_wire.identifiers import sdo_request_id, sdo_response_id
from heronry_wire.part_transfer import Part, Received, Transfer
from heronry_wire.sdo import MESSAGE_BYTES, Abort, read_number
from heronry_wire.timing import worst_bits

PART_BYTES = 7000
PATIENCE_S = 10.0
_SHARE = 10  # of the bus: a tenth
_LOOK_S = 0.1
_WORK_S = 70.0  # longer than a keeper may take
_START = b"\x01"
_REMEDY = "this bus must be the manager's or the uplink of this node, and with a key it must be unlocked (--unlock)"
_REMEDIES = {
    1: "it has no code to start: send the bundle again",
    3: "it does not take the bundle, or not yet: its log says why",
    5: "its disk does not take the bundle: its log says why",
    6: "the bundle is too large for it: leave files out",
    7: "the bundle is not for it: wrong signature, version or Python, or code of it runs; its log says why",
}

_T = TypeVar("_T")


def send(
    flags: dict[str, Any], node: int, bundle: Bundle, *, bitrate: int, unlock: Callable[[], None] | None, start: bool
) -> float:
    """Bring a bundle to a node; returns the seconds from the first part until the code is in use.

    flags: of the bus, as python-can takes them.
    bitrate: of the slowest bus on the way, in bit/s, by which the segments are paced.
    unlock: lets the manager unlock the PE; None: it has no key.
    start: whether to start the code.
    Raises UserError where the PE does not take it.
    """
    keep_off_the_terminal()
    with canopen.Network(open_bus(flags).bus) as network:
        network.connect()
        pe = _Pe(network, node, _SHARE * worst_bits(MESSAGE_BYTES) * 1_000_000_000 // bitrate, unlock)
        began_s = time.monotonic()
        if pe.read(PROGRAM_TRANSFER, 3) != bytes.fromhex(bundle.digest):
            for part in _parts(bundle.content, pe.received):
                pe.write_part(part)
            pe.wait()
        if start:
            pe.start()
        return time.monotonic() - began_s


def slowest_bitrate(spec: Spec, pe: str) -> int:
    """Return the bit rate of the slowest bus on the way from the manager's bus to a PE, in bit/s."""
    way = survivors(spec, Situation()).way(spec.manager.bus, pe)
    return min(spec.buses[bus].bitrate for bus in way or spec.pes[pe].buses)


def _parts(content: bytes, received: Callable[[], Received | None]) -> Iterator[Part]:
    """Yield the parts of a bundle from where the node has them."""
    transfer = Transfer(hashlib.sha256(content).digest(), len(content))
    known = received()
    at = known.length if known is not None and known.digest == transfer.digest else 0
    while at < len(content):
        yield Part(transfer, at, content[at : at + PART_BYTES])
        at += PART_BYTES


class _Pe:
    """The loader of one node, as its SDO server shows it."""

    def __init__(self, network: canopen.Network, node: int, segment_ns: int, unlock: Callable[[], None] | None) -> None:
        self._network, self._node, self._segment_ns, self._unlock = network, node, segment_ns, unlock
        self._sdo: Any = network.add_node(node, canopen.ObjectDictionary()).sdo  # type: ignore[no-untyped-call]
        self._sdo.RESPONSE_TIMEOUT = 1.0
        self._answers: queue.Queue[bytes] = queue.Queue()
        network.subscribe(sdo_response_id(node), lambda _id, data, _at: self._answers.put(bytes(data)))

    def read(self, index: int, sub_index: int) -> bytes:
        """Read an object; raises UserError where the node does not answer."""
        return self._tried(lambda: bytes(self._sdo.upload(index, sub_index)))

    def received(self) -> Received | None:
        """Return how far a transfer has come."""
        return Received.decode(self.read(PROGRAM_TRANSFER, 2))

    def start(self) -> None:
        """Start the code that waits."""
        self._tried(lambda: self._sdo.download(PROGRAM_CONTROL, 1, _START))
        self.wait()

    def wait(self) -> None:
        """Wait until the loader is not at work any more; raises UserError where it has failed."""
        give_up_s = time.monotonic() + _WORK_S
        while (status := self._status()) & 1:
            if time.monotonic() > give_up_s:
                raise UserError(f"node {self._node} is at work on the bundle for more than {_WORK_S:g} s: see its log")
            time.sleep(_LOOK_S)
        if status >> 1:
            why = _REMEDIES.get(status >> 1, f"it gives the error {status >> 1} of 1F57h: its log says why")
            raise UserError(f"node {self._node} does not use the bundle: {why}")

    def _status(self) -> int:
        status = read_number(self.read(PROGRAM_STATUS, 1))
        if status is None:
            raise UserError(f"node {self._node} does not answer as a loader: its 1F57h is no number; {_REMEDY}")
        return status

    def write_part(self, part: Part) -> None:
        """Write one part by a paced block transfer, again and again for a while."""
        give_up_s = time.monotonic() + PATIENCE_S
        while True:
            if self._unlock is not None:
                self._unlock()
            transfer = self._transferred(part)
            if transfer.outcome is Outcome.TAKEN:
                return
            known = self.received()
            if known is not None and known == Received(part.transfer.digest, part.at + len(part.data)):
                return  # the answer was lost
            if time.monotonic() > give_up_s:
                raise UserError(f"node {self._node} does not take the bundle: {transfer.why}; {_REMEDY}")
            time.sleep(_LOOK_S)

    def _transferred(self, part: Part) -> BlockDownload:
        while not self._answers.empty():
            self._answers.get()
        transfer = BlockDownload(PROGRAM_TRANSFER, part.encode(), self._segment_ns, self._say, sub_index=1)
        transfer.begin(time.monotonic_ns())
        while transfer.outcome is Outcome.UNDER_WAY:
            left_s = (transfer.next_ns - time.monotonic_ns()) / 1e9
            try:
                transfer.heard(self._answers.get(timeout=max(0.0, left_s)), time.monotonic_ns())
            except queue.Empty:
                transfer.tick(time.monotonic_ns())
        return transfer

    def _say(self, message: bytes) -> None:
        self._network.send_message(sdo_request_id(self._node), message)

    def _tried(self, access: Callable[[], _T]) -> _T:
        give_up_s = time.monotonic() + PATIENCE_S
        while True:
            try:
                return access()
            except SdoError as error:
                if isinstance(error, SdoAbortedError) and error.code == Abort.UNSUPPORTED.value:
                    raise UserError(f"node {self._node} takes no code: start its pe-agent with --code-dir") from error
                is_locked = isinstance(error, SdoAbortedError) and error.code == Abort.DEVICE_STATE.value
                if time.monotonic() > give_up_s or (isinstance(error, SdoAbortedError) and not is_locked):
                    raise UserError(f"node {self._node} does not answer as a loader ({error}); {_REMEDY}") from error
                if is_locked and self._unlock is not None:
                    self._unlock()
            time.sleep(_LOOK_S)
