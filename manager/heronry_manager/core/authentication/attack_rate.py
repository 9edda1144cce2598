"""Counts the forged frames that a manager with a key receives; if they take a tenth of its bus, reports an attack.

These frames count as forged:

- a state, nonce or command whose tag is wrong;
- an EMCY that no state has proven;
- a TAG that fits no command. It counts as two frames, the TAG and a forged command. The manager does not read all kinds
  of commands, so it has perhaps not seen this command.

A frame that was altered on its way counts as well: a bus that alters a tenth of its frames does the same harm as an
attack.

Once in `_WINDOW_NS` the manager works out the share of its bus that the forged frames took. If the share is a tenth or
more, the manager reports an attack, with the rate of these frames. A smaller share does not harm the aircraft (protocol
rule 11): then only the status shows the counts.
"""

from heronry_manager import events
from heronry_manager.core.turn import Turn

PRICE_PERCENT = 10
_WINDOW_NS = 1_000_000_000
_NS_PER_S = 1_000_000_000
_FRAME_BITS = 125  # of a frame with eight bytes, with some stuffing


class AttackRate:
    """Counts the forged frames on the manager's bus."""

    def __init__(self, turn: Turn, bus: str, bitrate: int) -> None:
        self._turn, self._bus, self._bitrate = turn, bus, bitrate
        self._since_ns, self._frames = turn.now_ns, 0
        self._is_told = False

    def forged(self, frames: int = 1) -> None:
        """Count forged frames.

        Reports an attack (event `attacked`) when their share of the bus has grown to a tenth.
        """
        now_ns = self._turn.now_ns
        if now_ns - self._since_ns >= _WINDOW_NS:
            self._close(now_ns)
        self._frames += frames

    def _close(self, now_ns: int) -> None:
        lasted_ns = now_ns - self._since_ns
        per_s = self._frames * _NS_PER_S // lasted_ns
        percent = 100 * per_s * _FRAME_BITS // self._bitrate
        was_told, self._is_told = self._is_told, percent >= PRICE_PERCENT
        if self._is_told and not was_told:
            self._turn.emit(events.Attacked, bus=self._bus, percent=percent, frames_per_s=per_s)
        self._since_ns, self._frames = now_ns, 0
