"""The manager's reactions to a gateway's reports on its radio: a limit in steps, loss of the PEs beyond, return."""

from dataclasses import dataclass, field
from fractions import Fraction

import pytest

from heronry_dg.loader import loads
from heronry_dg.uplinks import radios
from heronry_manager import events
from heronry_manager.core.situation.radio_links import RadioLinks
from heronry_wire.frame import Frame
from heronry_wire.gateway_report import LinkReport, LinkState
from heronry_wire.state_frames import PeState
from manager.one_manager import MS, OneManager

SPEC_TEXT = """
dg: 1
name: air_and_ground
buses:
  can0:  {bitrate: 500000}
  radio: {bitrate: 112500, kind: wireless, heartbeat_ms: 200, misses: 4}
  rover: {bitrate: 50000, kind: wireless, heartbeat_ms: 200, misses: 8}
manager: {bus: can0}
pes:
  nav:    {node_id: 92, buses: [can0], cpu: 0.5, ram: 32KiB, flash: 64KiB}
  comms:  {node_id: 93, buses: [can0, radio], cpu: 0.5, ram: 32KiB, flash: 64KiB}
  ground: {node_id: 94, buses: [radio, rover], cpu: 0.5, ram: 32KiB, flash: 64KiB}
  wheels: {node_id: 95, buses: [rover], cpu: 0.5, ram: 32KiB, flash: 64KiB}
devices:
  gyro: {kind: sensor, pe: nav}
  screen: {kind: actuator, pe: ground}
variables:
  rate: {type: FLOAT}
modules:
  gyro_driver: {image: pressure_driver, device: gyro, gives: {rate: 1}, cpu: 0.1, ram: 1KiB, rate_hz: 100}
  display: {image: ground_display, device: screen, needs: rate, cpu: 0.1, ram: 1KiB, rate_hz: 10}
functions:
  sight: {output: display, criticality: D}
"""
SPEC = loads(SPEC_TEXT, "air_and_ground.dg.yaml")
RADIO, ROVER = radios(SPEC)["radio"], radios(SPEC)["rover"]
PERIOD_NS = 200 * MS


@dataclass
class Link:
    """A gateway that reports, and the manager's record of it."""

    links: RadioLinks = field(default_factory=lambda: RadioLinks(SPEC))
    now_ns: int = 0
    sequence: int = 0
    any_pe_beyond: bool = True
    changes: list[tuple[str, int]] = field(default_factory=list)

    def report(self, usable: int, state: LinkState = LinkState.UP, *, node: int = 93) -> None:
        self.sequence = (self.sequence + 1) % 64
        self.now_ns += PERIOD_NS
        self.say(LinkReport(node, state, self.sequence, usable, 100, 0, 0).encode())

    def say(self, data: bytes) -> None:
        heard = self.links.heard(Frame(RADIO.link_id, data), self.now_ns, any_pe_beyond=self.any_pe_beyond)
        self.changes += [(change.what, change.step) for change in heard]

    def repeat(self, usable: int, times: int) -> None:
        for _ in range(times):
            self.report(usable)


@pytest.fixture
def link() -> Link:
    """A radio that is well, with a PE beyond."""
    found = Link()
    found.report(1000)
    return found


def test_the_radios_of_a_spec_with_their_gateways_and_the_pes_that_are_lost_with_them() -> None:
    assert (RADIO.link_id, RADIO.gateway, RADIO.beyond) == (291, "comms", {"ground", "wheels"})
    assert (ROVER.link_id, ROVER.gateway, ROVER.beyond) == (292, "ground", {"wheels"})


def test_a_gateway_that_starts_anew_counts_anew(link: Link) -> None:
    """Its first reports look like late ones of before, unless it is known that the gateway was away."""
    link.repeat(1000, 3)
    link.sequence = 0
    link.repeat(500, 2)
    assert link.changes == []
    link.sequence = 0
    link.links.restarted("comms")
    link.repeat(500, 2)
    assert link.changes == [("limited", 400)]


def test_noise_about_a_step_moves_nothing(link: Link) -> None:
    link.repeat(700, 2)
    for usable in (545, 835, 600, 540, 790) * 10:
        link.report(usable)
    assert link.changes == [("limited", 600)]


def test_more_bandwidth_counts_after_a_hold_down_as_low_as_it_was_meanwhile(link: Link) -> None:
    link.repeat(100, 2)
    link.repeat(1000, 5)
    link.report(500)
    link.repeat(1000, 4)
    assert link.changes == [("limited", 80)]
    link.report(1000)
    assert link.changes == [("limited", 80), ("limited", 400)]
    link.repeat(1000, 11)
    assert link.changes[-1] == ("limited", 1000)
    assert link.links.limits() == {}


def test_gone_and_back_and_a_pe_that_returns_finds_the_step_of_the_moment(link: Link) -> None:
    link.report(0, LinkState.GONE)
    link.report(0, LinkState.GONE)
    assert link.changes == [("gone", 0)]
    assert link.links.limits() == {}
    link.any_pe_beyond = False
    for usable in (300, 90, 170):
        link.report(usable)
    assert link.changes[1:] == [("back", 1000), ("limited", 250), ("limited", 80), ("limited", 160)]
    link.any_pe_beyond = True
    link.report(1000)
    assert link.changes[-1] == ("limited", 160)


def test_a_radio_that_is_back_with_all_of_its_bandwidth_is_not_limited(link: Link) -> None:
    link.report(0, LinkState.GONE)
    link.any_pe_beyond = False
    link.repeat(1000, 2)
    assert link.changes == [("gone", 0), ("back", 1000)]


def test_a_dip_begins_the_hold_down_anew(link: Link) -> None:
    link.repeat(300, 2)
    for _ in range(5):
        link.repeat(1000, 9)
        link.report(300)
    assert link.changes == [("limited", 250)]


def test_a_radio_that_falls_again_and_again_is_held_down_longer_and_forgiven_after_a_minute(link: Link) -> None:
    waits = []
    for _ in range(6):
        link.repeat(300, 2)
        times = 0
        while link.links.limits():
            link.report(1000)
            times += 1
        waits.append(times - 1)
    assert waits == [10, 20, 40, 40, 40, 40]
    link.now_ns += 60_000 * MS
    link.repeat(300, 2)
    link.repeat(1000, 11)
    assert link.links.limits() == {}


def test_the_reports_of_a_restarted_gateway_count(link: Link) -> None:
    link.sequence = 30
    link.report(1000)
    link.sequence = 0
    link.repeat(100, 3)
    assert link.changes == [("limited", 80)]


class Flight(OneManager):
    """A manager of the spec above that flies, and the gateway of its radio."""

    def __init__(self) -> None:
        super().__init__(SPEC)
        self.start()
        self.sequence = 0

    def report(self, usable: int, state: LinkState = LinkState.UP, *, times: int = 1) -> None:  # type: ignore[override]
        for _ in range(times):
            self.pass_time(PERIOD_NS)
            self.sequence = (self.sequence + 1) % 64
            frame = LinkReport(93, state, self.sequence, usable, 100, 0, 0).encode()
            self.hear(Frame(RADIO.link_id, frame))


def test_a_limit_above_what_the_plan_uses_leads_to_no_plan() -> None:
    flight = Flight()
    requested = len(flight.requests)
    flight.report(700, times=2)
    assert flight.last(events.LinkLimited).share == "60%"
    assert len(flight.requests) == requested
    flight.report(1000, times=12)
    assert flight.last(events.LinkLimited).share == "100%"
    assert len(flight.requests) == requested, "what was planned for all of it is as good again"


def test_a_limit_below_what_the_plan_uses_is_a_fault_with_a_number() -> None:
    flight = Flight()
    flight.report(100, times=2)
    request = flight.requests[-1]
    assert request.now.limits == {"bus:radio": Fraction(8, 100)}
    assert flight.last(events.PlanRequested).limits == {"bus:radio": "8%"}
    assert not flight.answer().functions["sight"].served
    assert flight.core.status()["links"]["radio"]["limit"] == 80


def test_what_was_planned_under_a_limit_is_planned_anew_without_it() -> None:
    flight = Flight()
    flight.report(100, times=2)
    flight.answer()
    for pe in SPEC.pes:
        flight.stage(pe)
    for pe in SPEC.pes:
        flight.take(pe, PeState.ACTIVE)
    flight.report(1000, times=12)
    assert flight.requests[-1].now.limits == {}
    assert flight.answer().functions["sight"].served


def test_a_limit_voids_a_plan_that_is_on_its_way() -> None:
    flight = Flight()
    flight.report(100, times=2)
    flight.report(300, times=13)
    assert flight.requests[-1].now.limits == {"bus:radio": Fraction(1, 4)}


def test_a_radio_is_unheard_until_its_gateway_reports() -> None:
    links = Flight().core.status()["links"]
    assert (
        links["radio"]
        == links["rover"]
        == {
            "state": "unheard",
            "limit": 1000,
            "usable": None,
            "delivered": None,
            "queued": 0,
            "dropped": 0,
        }
    )
