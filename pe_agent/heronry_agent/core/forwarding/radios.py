"""The radios of a gateway: every frame to a radio is queued first (protocol rule 9).

Each radio has its own queue and its own measurement of the bandwidth (`radio_port`). The measurement uses every frame
that comes from the radio. Each call of the core by its driver ends with a list of actions. `passed` takes the frames to
radios out of this list, and queues them. Then it adds to the list those queued frames that may be sent now.
"""

from heronry_agent.core.forwarding.radio_port import RadioPort
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
        """Time in ns at which to call `passed`, if no event comes before."""
        due_ns = NEVER_NS
        for radio in self.ports.values():
            due_ns = min(due_ns, radio.next_ns)
        return due_ns

    def measure(self, event: Received) -> None:
        """Use a frame from a radio to measure the bandwidth; if the radio was gone, report that it is back."""
        frame, radio = event.frame, self.ports.get(event.port)
        if radio is not None and not (frame.extended or frame.remote or frame.error):
            self._turn.do(*radio.heard(frame, self._turn.now_ns))

    def passed(self, out: list[Action]) -> list[Action]:
        """Take the frames to radios out of the actions and queue them; returns the actions that are to be executed now.

        These include the frames that the queues send now. A frame that waited during a pause of this process is not
        sent late: its time limit in the queue runs from its arrival.
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
