"""A bus that takes its time to open, opened while its node goes on.

What lies behind some back-ends of python-can is waited for: slcan gives its modem two seconds, and a socketcand has two
for each of its answers. A node that has lost such a bus has others to serve meanwhile: a gateway whose radio is gone
must not fall silent on its aircraft's bus. So a thread opens it, and the node looks now and then whether it has.

    under way   the thread waits in the back-end
    done        `result` is the bus, or the error; nothing happens any more
    abandoned   nobody wants it: what it opens after all, it closes again

It ends with the process, wherever it waits.
"""

from collections.abc import Callable
from threading import Lock, Thread

from heronry_wire.bus_opening import Opened
from heronry_wire.errors import HeronryError


class SlowOpening:
    """One try to open a bus."""

    def __init__(self, open_bus: Callable[[], Opened]) -> None:
        """Begin; `open_bus` gives the bus, or raises."""
        self.result: Opened | HeronryError | None = None
        self._is_wanted = True
        self._lock = Lock()
        Thread(target=self._run, args=(open_bus,), daemon=True).start()

    def abandon(self) -> None:
        """Let go of it, whatever comes of it."""
        with self._lock:
            self._is_wanted = False
            opened, self.result = self.result, None
        if isinstance(opened, Opened):
            opened.bus.shutdown()

    def _run(self, open_bus: Callable[[], Opened]) -> None:
        found: Opened | HeronryError
        try:
            found = open_bus()
        except Exception as error:  # noqa: BLE001 - whatever a back-end raises, this is the end of it
            found = error if isinstance(error, HeronryError) else HeronryError(f"it cannot be opened: {error}")
        with self._lock:
            if self._is_wanted:
                self.result = found
                return
        if isinstance(found, Opened):
            found.bus.shutdown()
