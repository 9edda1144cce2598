"""The rounds in which the states of the modules on this PE are saved and sent.

    waiting    the module runs; its next state is due at a multiple of the period after its start. When it is due, the
               state is saved after the next step
    asked      the order to save was given. An answer to an earlier order is dropped
    sending    the state is saved, and its frames are handed over, one each `gap_ns` from then on, to the ports through
               which other possible PEs are reached on which the manager counts. If there is none, nothing is sent.
               After a pause, the frames that are due are handed over at once, if their buses may still be in time

If the state cannot be saved, the next try comes after RETRY_NS at the earliest. So a `save` that hangs, and is stopped
after some milliseconds, takes little of the time of its module.
"""

from collections import deque
from collections.abc import Collection
from dataclasses import dataclass, field

from heronry_wire.checkpoint_frames import ROUNDS
from heronry_wire.frame import Frame
from heronry_wire.pe_table import CheckpointEntry
from heronry_wire.sansio import NEVER_NS

RETRY_NS = 1_000_000_000


@dataclass(slots=True)
class Sender:
    """The rounds of one module from its start to its stop."""

    entry: CheckpointEntry
    due_ns: int  # when to save the next state
    round: int  # of the last order to save
    asked_ns: int | None = None  # when that order was given; None: it was answered, or there was none
    frames: deque[Frame] = field(default_factory=deque)  # still to be handed over
    next_ns: int = NEVER_NS  # when to hand over the next frame
    ideal_ns: int = NEVER_NS  # when it would be handed over if nothing was late since `save` was called
    is_failing: bool = False  # the last state could not be saved

    def ask(self, now_ns: int) -> int:
        """Begin the next round, and return its number; the state after it is due one period later, or more."""
        self.due_ns += self.entry.period_ns * (1 + (now_ns - self.due_ns) // self.entry.period_ns)
        self.asked_ns = now_ns
        return self.next_round()

    def next_round(self) -> int:
        """Return the number of a new round."""
        self.round = (self.round + 1) % ROUNDS
        return self.round

    def send(self, frames: Collection[Frame], now_ns: int, saved_ns: int) -> None:
        """Hand over these frames of a state saved at `saved_ns` from now on, and no more frames of the round before."""
        self.frames, self.ideal_ns = deque(frames), saved_ns
        self.next_ns = now_ns if self.frames else NEVER_NS

    def cut_off(self) -> None:
        """Hand over no more frames of the present round."""
        self.frames.clear()
        self.next_ns = NEVER_NS

    def next_frame(self) -> tuple[Frame, int]:
        """Return the frame that is to be handed over now, with the time `ideal_ns` from which it may wait."""
        frame, ideal_ns = self.frames.popleft(), self.ideal_ns
        self.next_ns = self.next_ns + self.entry.gap_ns if self.frames else NEVER_NS
        self.ideal_ns += self.entry.gap_ns
        return frame, ideal_ns

    def failed(self, now_ns: int) -> None:
        """Note that the state cannot be saved."""
        self.is_failing, self.asked_ns = True, None
        self.due_ns = max(self.due_ns, now_ns + RETRY_NS)

    def ports(self, alive: Collection[int]) -> tuple[int, ...]:
        """Return the ports that lead to other possible PEs among the node-IDs in `alive`."""
        return tuple(port for port, nodes in enumerate(self.entry.towards) if any(node in alive for node in nodes))
