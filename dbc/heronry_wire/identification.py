"""Identification (IDS), the one CANaerospace node service that every node must answer (protocol rule 12).

Node n answers a request to itself immediately, and a request to all nodes after (n - 92) ms, so that the answers do not
all start together. Other services, other channels and malformed requests are not answered.
"""

from heronry_wire.frame import Frame, Malformed
from heronry_wire.node_services import (
    BROADCAST,
    Identification,
    Service,
    answer_delay_ns,
    answer_identification,
    decode_service,
    encode_service,
    service_id,
)
from heronry_wire.sansio import NEVER_NS, Send

IDENTIFICATION = Identification(hardware_revision=0, software_revision=1)
REQUEST_ID = service_id(0, is_answer=False)


class IdentificationService:
    """Answers the IDS requests to one node; `next_ns` is the time at which to call `tick` next."""

    def __init__(self, node: int) -> None:
        self._node = node
        self._due: list[tuple[int, Send]] = []
        self.next_ns = NEVER_NS

    def asked(self, port: int, frame: Frame, now_ns: int) -> bool:
        """Take a frame that has the identifier of requests; schedule an answer to an IDS request.

        Only a request to this node or to all nodes gets an answer. Returns False where the frame is malformed, and True
        for any other frame, also if it gets no answer.

        port: position of the bus on which the frame came; the answer goes out on the same bus.
        """
        request = decode_service(frame)
        if isinstance(request, Malformed):
            return False
        datum = request.datum
        if datum.service_code != Service.IDS or datum.node_id not in (BROADCAST, self._node):
            return True
        answer = encode_service(answer_identification(request, self._node, IDENTIFICATION))
        at_ns = now_ns + answer_delay_ns(request, self._node)
        if all(send.port != port or send.frame != answer for _, send in self._due):
            self._due.append((at_ns, Send(port, answer)))
            self.next_ns = min(self.next_ns, at_ns)
        return True

    def tick(self, now_ns: int) -> list[Send]:
        """Return the answers that are due at `now_ns`."""
        due = [send for at_ns, send in self._due if at_ns <= now_ns]
        self._due = [(at_ns, send) for at_ns, send in self._due if at_ns > now_ns]
        self.next_ns = min((at_ns for at_ns, _ in self._due), default=NEVER_NS)
        return due
