"""The terminal of `heronry top`: what is typed there need not be UTF-8."""

from textual.drivers.linux_driver import LinuxDriver


class Terminal(LinuxDriver):
    """Textual's terminal, except that bytes which are no UTF-8 are passed over; without this they end the program."""

    def run_input_thread(self) -> None:
        """Read what is typed until the program ends."""
        while not self.exit_event.is_set():
            try:
                super().run_input_thread()
            except UnicodeDecodeError:
                continue
