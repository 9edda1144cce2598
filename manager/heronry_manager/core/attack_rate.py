"""The forged frames that a manager with a key receives: it reports an attack when they take a tenth of its bus.

A received frame counts as forged if it cannot come from a holder of the key: a state, nonce or command whose tag does
not fit, and an EMCY that no state has proven. A TAG that fits no command counts as two frames, the TAG and a forged
command: the manager may not have seen that command, since it does not read all kinds of commands. Once in `_WINDOW_NS`
the manager works out the share of its bus that the forged frames took. A share of a tenth or more is reported as an
attack, with the rate of the frames. A smaller share does not harm the aircraft (protocol rule 11), and only the status
shows the counts. A frame that was altered on its way counts, too: a bus that alters a tenth of its frames does the same
harm as an attack.
"""

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
            self._turn.emit("attacked", bus=self._bus, percent=percent, frames_per_s=per_s)
        self._since_ns, self._frames = now_ns, 0
