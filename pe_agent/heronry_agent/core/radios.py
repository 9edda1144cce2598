"""The radios of a gateway: every action that sends to one of them waits for its turn (rule 9).

Each has a queue and a meter of its own (`radio_port`). What comes from a radio is measured before it is taken; what the
parts want to send to one is taken out of the actions of the turn, and what has its turn now takes its place.
"""

from heronry_agent.core.radio_port import RadioPort
from heronry_agent.core.table_index import TableIndex
from heronry_agent.core.turn import Turn
from heronry_agent.core.vocabulary import Action
from heronry_wire.sansio import NEVER_NS, Received, Send, Withdraw


class Radios:
    """The radios of one PE; most have none."""

    def __init__(self, turn: Turn, index: TableIndex) -> None:
        self._turn = turn
        self.ports = {
            port: RadioPort(port, index, turn.now_ns)
            for port, entry in enumerate(index.table.ports)
            if entry.link_id is not None
        }

    @property
    def next_ns(self) -> int:
        """When `passed` has something to send, if nothing comes before."""
        return min((radio.next_ns for radio in self.ports.values()), default=NEVER_NS)

    def measure(self, event: Received) -> None:
        """Take note of a frame from a radio; reports that the radio is back, if it was gone."""
        frame, radio = event.frame, self.ports.get(event.port)
        if radio is not None and not (frame.extended or frame.remote or frame.error):
            self._turn.out += radio.heard(frame, self._turn.now_ns)

    def passed(self, out: list[Action]) -> list[Action]:
        """Let what goes to a radio wait for its turn, and whatever has its turn now go; gives what remains to be done.

        What is passed on is as old as it is: after a pause of this process nothing stale goes by radio.
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
