"""The radios of a gateway: every action that sends to one of them waits for its turn (protocol rule 9).

Each radio has a queue and a meter of its own (`radio_port`). A frame from a radio is measured before any part takes it.
Frames that the parts send to a radio are taken out of the actions of this call and queued; the frames whose turn it is
now take their place.
"""

from heronry_agent.core.radio_port import RadioPort
from heronry_agent.core.table_index import TableIndex
from heronry_agent.core.turn import Turn
from heronry_agent.core.vocabulary import Action
from heronry_wire.sansio import NEVER_NS, Received, Send, Withdraw


class Radios:
    """The radios of one PE; most PEs have none."""

    def __init__(self, turn: Turn, index: TableIndex) -> None:
        self._turn = turn
        self.ports = {
            port: RadioPort(port, index, turn.now_ns)
            for port, entry in enumerate(index.table.ports)
            if entry.link_id is not None
        }

    @property
    def next_ns(self) -> int:
        """Time in ns at which `passed` has something to send, if no event comes before."""
        due_ns = NEVER_NS
        for radio in self.ports.values():
            due_ns = min(due_ns, radio.next_ns)
        return due_ns

    def measure(self, event: Received) -> None:
        """Take note of a frame from a radio; reports that the radio is back, if it was gone."""
        frame, radio = event.frame, self.ports.get(event.port)
        if radio is not None and not (frame.extended or frame.remote or frame.error):
            self._turn.out += radio.heard(frame, self._turn.now_ns)

    def passed(self, out: list[Action]) -> list[Action]:
        """Queue the frames to radios, and add those whose turn it is; gives the actions that remain to be done.

        A forwarded frame keeps its age: after a pause of this process no stale frame goes by radio.
        """
        now_ns, passed = self._turn.now_ns, []
        for action in out:
            if type(action) is Send and action.port in self.ports:
                self.ports[action.port].send(action.frame, action.until_ns, self._turn.arrived_ns)
                continue
            if isinstance(action, Withdraw):
                for radio in self.ports.values():
                    radio.withdraw(action.identifiers)
            passed.append(action)
        for radio in self.ports.values():
            passed += radio.step(now_ns)
        return passed
