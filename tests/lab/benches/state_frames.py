"""How regular state frames are: by how much the interval between two of a node's is longer than the period."""

import time

from heronry_tools.runtime.softbus.client import SoftBus
from heronry_wire.state_frames import StatePage0, decode_state


def forget_waiting(observer: SoftBus) -> None:
    """Drop the frames that wait to be received."""
    while observer.recv(0) is not None:
        pass


def lateness_ms(observer: SoftBus, period_ms: float, seconds: float) -> list[float]:
    """Listen; gives by how much each interval between two pages 0 (the periodic ones) is longer than the period."""
    last_s: dict[int, float] = {}
    late_ms = []
    end = time.monotonic() + seconds
    while (left := end - time.monotonic()) > 0:
        message = observer.recv(left)
        if message is not None and isinstance(decode_state(bytes(message.data)), StatePage0):
            if message.arbitration_id in last_s:
                gap_ms = (message.timestamp - last_s[message.arbitration_id]) * 1e3
                late_ms.append(max(0.0, gap_ms - period_ms))
            last_s[message.arbitration_id] = message.timestamp
    return late_ms
