"""How many forged frames a manager with a key sees, and the share of its bus that they take.

Every frame that it receives and that cannot come from a holder of the key is counted: states, nonces and commands whose
tags do not fit. Once in `_WINDOW_NS` the manager compares the count with its bus. From a tenth on it is told as an
attack, with its rate; below that the aircraft does not suffer (protocol rule 11), and the counts stand in the status.
A frame that was altered on its way counts, too: a bus that alters a tenth of its frames is as bad.
"""

from heronry_manager.core.turn import Turn

PRICE_PERCENT = 10
_WINDOW_NS = 1_000_000_000
_NS_PER_S = 1_000_000_000
_FRAME_BITS = 125  # of a frame with eight bytes, with some stuffing


class AttackRate:
    """The forged frames of one bus."""

    def __init__(self, turn: Turn, bus: str, bitrate: int) -> None:
        self._turn, self._bus, self._bitrate = turn, bus, bitrate
        self._since_ns, self._frames = turn.now_ns, 0
        self._is_told = False

    def forged(self, frames: int = 1) -> None:
        """Count frames, and tell an attack that begins."""
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
            self._turn.emit("attacked", bus=self._bus, percent=percent, frames_per_s=per_s)
        self._since_ns, self._frames = now_ns, 0
