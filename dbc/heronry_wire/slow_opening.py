"""Opens a bus in a thread, while its node goes on: for back-ends of python-can that are slow to open.

slcan waits two seconds for its modem, and socketcand up to two seconds for each answer of its server. Meanwhile the
node must serve its other buses: a gateway whose radio is gone must not fall silent on the aircraft's bus. So a thread
opens the bus, and the node polls for the result.

    under way   the thread waits in the back-end
    done        `result` is the bus, or the error; the thread has ended
    abandoned   the node does not need the bus any more. If the thread is still opening the bus, it closes the
                bus afterwards

In every state the thread ends when the process ends.
"""

from collections.abc import Callable
from threading import Lock, Thread

from heronry_wire.bus_opening import Opened
from heronry_wire.errors import HeronryError


class SlowOpening:
    """One attempt to open a bus in a thread."""

    def __init__(self, open_bus: Callable[[], Opened]) -> None:
        """Start the thread, which calls `open_bus`; `open_bus` returns the bus, or raises any exception."""
        self.result: Opened | HeronryError | None = None
        self._is_wanted = True
        self._lock = Lock()
        Thread(target=self._run, args=(open_bus,), daemon=True).start()

    def abandon(self) -> None:
        """End the attempt: a bus that the thread has opened, or opens later, is closed."""
        with self._lock:
            self._is_wanted = False
            opened, self.result = self.result, None
        if isinstance(opened, Opened):
            opened.bus.shutdown()

    def _run(self, open_bus: Callable[[], Opened]) -> None:
        found: Opened | HeronryError
        try:
            found = open_bus()
        except Exception as error:  # noqa: BLE001 - a back-end may raise anything, and the thread must not
            found = error if isinstance(error, HeronryError) else HeronryError(f"the bus cannot be opened: {error}")
        with self._lock:
            if self._is_wanted:
                self.result = found
                return
        if isinstance(found, Opened):
            found.bus.shutdown()
