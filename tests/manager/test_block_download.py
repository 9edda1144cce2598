"""The pace of a block transfer: what a late wake-up or a late answer has delayed follows at once, and no more."""

from heronry_manager.core.sdo_client import BlockDownload, Outcome
from heronry_wire.sdo import (
    BLOCK_ACKNOWLEDGE,
    BLOCK_DOWNLOAD_ANSWER,
    BLOCK_INITIATE,
    LATE_NS,
    segment,
    with_data,
)

MS = 1_000_000
PERIOD_NS = 2 * MS
BLOCK = 32


class Client:
    """A transfer of 100 segments that is open, and the times at which its requests went out."""

    def __init__(self) -> None:
        self.now_ns, self.said_ns = 0, list[int]()
        self.transfer = BlockDownload(0x1F50, bytes(700), PERIOD_NS, lambda _: self.said_ns.append(self.now_ns))
        self.transfer.begin(0)
        self.said_ns.clear()
        self.hear(with_data(BLOCK_DOWNLOAD_ANSWER | BLOCK_INITIATE, 0x1F50, 0, bytes((BLOCK,))))

    def hear(self, message: bytes) -> None:
        self.transfer.heard(message, self.now_ns)

    def acknowledge(self) -> None:
        self.hear(segment(BLOCK_DOWNLOAD_ANSWER | BLOCK_ACKNOWLEDGE, bytes((BLOCK, BLOCK))))

    def wake(self, now_ns: int) -> None:
        """Do what is due now, as the loop of a process does when it wakes."""
        self.now_ns = now_ns
        while self.transfer.next_ns <= now_ns:
            self.transfer.tick(now_ns)


def test_a_punctual_client_sends_one_segment_in_each_period() -> None:
    client = Client()
    while len(client.said_ns) < BLOCK:
        client.wake(client.transfer.next_ns)
    assert client.said_ns == [number * PERIOD_NS for number in range(BLOCK)]


def test_late_wake_ups_do_not_lengthen_a_transfer() -> None:
    client = Client()
    for number in range(1, 8):
        client.wake(4 * number * PERIOD_NS)
    assert len(client.said_ns) == 1 + 4 * 7
    assert client.transfer.next_ns == (1 + 4 * 7) * PERIOD_NS


def test_what_a_long_pause_has_delayed_is_sent_with_pauses_but_for_the_last_moments() -> None:
    client = Client()
    client.wake(30 * PERIOD_NS)
    assert len(client.said_ns) == 1 + 1 + LATE_NS // PERIOD_NS
    assert client.transfer.next_ns == 31 * PERIOD_NS


def test_a_late_acknowledgement_does_not_lengthen_a_transfer() -> None:
    client = Client()
    while len(client.said_ns) < BLOCK:
        client.wake(client.transfer.next_ns)
    client.now_ns += PERIOD_NS // 2
    client.acknowledge()
    assert client.transfer.next_ns == BLOCK * PERIOD_NS
    client.wake(BLOCK * PERIOD_NS)
    while len(client.said_ns) < 2 * BLOCK:
        client.wake(client.transfer.next_ns)
    client.now_ns += 3 * PERIOD_NS
    client.acknowledge()
    client.wake(client.now_ns)
    assert len(client.said_ns) == 2 * BLOCK + 3
    assert client.transfer.outcome is Outcome.UNDER_WAY
