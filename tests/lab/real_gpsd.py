"""Debian's gpsd, and its gpsfake, which plays NMEA sentences to it.

    python -m lab.real_gpsd        fetches both into the user's cache; `make test` does so, since a guest has no network

Nothing is installed: the packages are only unpacked, as those of the user-mode Linux are.
"""

import os
import socket
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from signal import SIGKILL
from subprocess import DEVNULL, STDOUT, Popen

from heronry_tools.runtime.vcan.debian_packages import cache_folder, unpacked
from heronry_tools.runtime.vcan.errors import CannotRunError

PACKAGES = ("gpsd", "gpsd-clients", "python3-gps", "libbluetooth3", "libusb-1.0-0", "libdbus-1-3")
_CYCLE_S = 0.02  # between two sentences


def is_there() -> bool:
    """Tell whether all packages have been fetched."""
    return all((cache_folder() / package).is_dir() for package in PACKAGES)


def sentence(body: str) -> str:
    """Return an NMEA sentence with its check sum."""
    check = 0
    for byte in body.encode():
        check ^= byte
    return f"${body}*{check:02X}\r\n"


def one_fix(second: float, altitude_m: float) -> tuple[str, ...]:
    """Return the bodies of the sentences of a receiver that stands at 38 N 84.5 W, some time after noon."""
    at = f"12{int(second / 60) % 60:02d}{second % 60:05.2f}"
    where = "3800.000,N,08430.000,W"
    return (
        f"GPGGA,{at},{where},1,08,1.0,{altitude_m:.1f},M,-33.0,M,,",
        f"GPRMC,{at},A,{where},10.0,090.0,291126,,,A",
        "GPGSA,A,3,01,02,03,04,05,06,07,08,,,,,1.8,1.0,1.5",
    )


def fixes(altitude_m: float) -> str:
    """Return ten seconds of sentences."""
    return "".join(sentence(body) for second in range(10) for body in one_fix(second, altitude_m))


@dataclass(frozen=True)
class Daemon:
    """A gpsd, perhaps with the gpsfake that started it."""

    process: Popen[bytes]
    port: int

    def kill(self) -> None:
        """Kill gpsd, and gpsfake."""
        os.killpg(self.process.pid, SIGKILL)
        self.process.wait()


@contextmanager
def faked(folder: Path, altitude_m: float) -> Iterator[Daemon]:
    """Run gpsfake, which starts gpsd and plays sentences into a pseudo-terminal again and again."""
    (folder / "fixes.nmea").write_text(fixes(altitude_m), newline="")
    gpsfake = str(unpacked("gpsd-clients") / "usr/bin/gpsfake")
    port = _free_port()
    words = ["/usr/bin/python3", gpsfake, "-q", "-n", "-c", str(_CYCLE_S), "-P", str(port), str(folder / "fixes.nmea")]
    with _running(words, port, folder) as daemon:
        yield daemon


@contextmanager
def fed(folder: Path, port: int, altitude_m: float) -> Iterator[Daemon]:
    """Run gpsd with a receiver that sends by UDP, ten times a second.

    In a user-mode Linux gpsd soon gets nothing more from gpsfake, whether by pseudo-terminal, TCP or UDP.
    """
    source, ends = _free_port(), threading.Event()
    gpsd = str(unpacked("gpsd") / "usr/sbin/gpsd")
    sender = threading.Thread(target=_send, args=(source, altitude_m, ends))
    with _running([gpsd, "-N", "-n", "-S", str(port), f"udp://127.0.0.1:{source}"], port, folder) as daemon:
        sender.start()
        try:
            yield daemon
        finally:
            ends.set()
            sender.join()


def _send(port: int, altitude_m: float, ends: threading.Event) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        tenth = 0
        while not ends.wait(0.1):
            tenth += 1
            bodies = one_fix(tenth / 10, altitude_m)
            one.sendto("".join(map(sentence, bodies)).encode(), ("127.0.0.1", port))


@contextmanager
def _running(words: list[str], port: int, folder: Path) -> Iterator[Daemon]:
    roots = [unpacked(package) for package in PACKAGES]
    environment = {
        **os.environ,
        "LD_LIBRARY_PATH": os.pathsep.join(str(lib) for root in roots for lib in root.glob("**/lib/*-linux-gnu*")),
        "PYTHONPATH": str(unpacked("python3-gps") / "usr/lib/python3/dist-packages"),
        "GPSD_HOME": str(unpacked("gpsd") / "usr/sbin"),
        "PYTHONWARNINGS": "ignore",
    }
    log = folder / "gpsd.log"
    with log.open("wb") as file:
        process = Popen(words, env=environment, stdin=DEVNULL, stdout=file, stderr=STDOUT, start_new_session=True)
    daemon = Daemon(process, port)
    try:
        while not _listens(port):
            if process.poll() is not None:
                raise RuntimeError(f"{words[0]} has ended: {log.read_text()}")
            time.sleep(0.1)
        yield daemon
    finally:
        if process.poll() is None:
            daemon.kill()


def _free_port() -> int:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


def _listens(port: int) -> bool:
    with socket.socket() as one:
        return one.connect_ex(("127.0.0.1", port)) == 0


def main() -> int:
    """Fetch the packages; returns the exit code."""
    try:
        for package in PACKAGES:
            unpacked(package)
    except CannotRunError as error:
        print(f"real_gpsd: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
