"""An unmodified `canopen` client on the core of one PE, in the time of the test."""

import io
import queue
from collections import deque
from collections.abc import Callable
from typing import Any

import canopen
from canopen import SdoAbortedError
from canopen.sdo.client import SdoClient

from agent.one_pe import NODE, OnePe, sent
from heronry_agent.core.vocabulary import Action
from heronry_wire.eds import FILE_NAME, eds_text
from heronry_wire.frame import Frame
from heronry_wire.identifiers import heartbeat_id, sdo_request_id, sdo_response_id

NS_PER_S = 1_000_000_000


def objects(node: int = NODE) -> Any:
    """The object dictionary that the EDS describes."""
    file = io.StringIO(eds_text())
    file.name = FILE_NAME
    return canopen.import_od(file, node)


def refusal(access: Callable[[], Any]) -> int:
    """The abort code of an access that is refused.

    The exception is not kept: a failed stream of the client closes itself once more when it is finalized, which
    sends frames, and that must happen here rather than in the middle of a later transfer.
    """
    try:
        access()
    except SdoAbortedError as refused:
        return int(refused.code)
    raise AssertionError("it was not refused")


class Master:
    """Reads and writes a PE; while it waits for an answer, the time of the PE passes."""

    def __init__(self, pe: OnePe) -> None:
        self.pe = pe
        self.heard: deque[bytes] = deque()
        self.sdo: Any = SdoClient(sdo_request_id(NODE), sdo_response_id(NODE), objects())
        self.sdo.network = self
        self.sdo.responses = self

    def send_message(self, can_id: int, data: bytes) -> None:
        """Send a frame of the client to the PE, in place of its bus."""
        self._listen(self.pe.hear(Frame(can_id, bytes(data))))

    def get(self, *, block: bool, timeout: float) -> bytes:
        """Return the next answer, in place of the client's queue."""
        assert block
        end_ns = self.pe.now_ns + round(timeout * NS_PER_S)
        while not self.heard and self.pe.core.next_deadline_ns() <= end_ns:
            self._listen(self.pe.pass_time(max(0, self.pe.core.next_deadline_ns() - self.pe.now_ns)))
        if not self.heard:
            raise queue.Empty
        return self.heard.popleft()

    def empty(self) -> bool:
        self.heard.clear()
        return True

    def nmt(self, command: int, node: int = NODE) -> list[Action]:
        return self.pe.hear(Frame(0, bytes((command, node))))

    def heartbeats(self, actions: list[Action]) -> list[int]:
        return [frame.data[0] for frame in sent(actions, heartbeat_id(NODE))]

    def _listen(self, actions: list[Action]) -> None:
        self.heard += [frame.data for frame in sent(actions, sdo_response_id(NODE))]
