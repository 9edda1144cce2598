"""What a spec says of the driver of a device: how it is read, refused and compiled into the table of its PE."""

from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import pytest

from heronry_dg.check.examples import SOUND
from heronry_dg.findings import SpecError
from heronry_dg.loader import load, loads
from heronry_dg.meaning import with_digest
from heronry_dg.model import Spec
from heronry_manager.core.tables.compilation import Compiler
from heronry_wire.pe_table import DriverEntry

MS = 1_000_000


def spec_of(gps: str = "", lamp: str = "") -> Spec:
    text = SOUND.replace("kind: sensor, pe: nav", f"kind: sensor, pe: nav{gps}")
    return loads(text.replace("kind: actuator, pe: tail", f"kind: actuator, pe: tail{lamp}"), "sound")


def test_everything_that_can_be_said_is_read() -> None:
    spec = spec_of(
        ", driver: gpsd, options: {port: 2948, gain: 0.5, taps: [1, 2.5], low: true}, stale_ms: 0.5, range: [-1, 1.5]",
        ", driver: 'my_rig.lamps:Lamp', limits: [0, 1], rate_limit: 2.5, safe: 0.25",
    )
    gps, lamp = spec.devices["gps"], spec.devices["lamp"]
    assert (gps.driver, gps.stale_ns, gps.span) == ("gpsd", MS // 2, (-1, Fraction(3, 2)))
    assert gps.options == {"port": 2948, "gain": 0.5, "taps": (1, 2.5), "low": True}
    assert (lamp.driver, lamp.limits, lamp.rate_limit) == ("my_rig.lamps:Lamp", (0, 1), Fraction(5, 2))
    assert lamp.safe == Fraction(1, 4)
    assert spec_of(lamp=", safe: hold").devices["lamp"].safe == "hold"


@pytest.mark.parametrize(
    ("gps", "lamp", "code"),
    [
        (", range: [1, 1]", "", "DG124"),
        (", range: [2, 1]", "", "DG124"),
        (", range: 5", "", "DG104"),
        (", stale_ms: 0", "", "DG106"),
        (", driver: 'a b'", "", "DG109"),
        (", driver: gpsd, options: [1]", "", "DG101"),
        (", driver: gpsd, options: {port: {a: 1}}", "", "DG104"),
        ("", ", rate_limit: 0", "DG106"),
        ("", ", safe: off_now", "DG105"),
        (", limits: [0, 1]", "", "DG125"),
        (", safe: hold", "", "DG125"),
        ("", ", stale_ms: 5", "DG125"),
        ("", ", range: [0, 1]", "DG125"),
    ],
)
def test_what_does_not_fit_is_refused(gps: str, lamp: str, code: str) -> None:
    with pytest.raises(SpecError) as refused:
        spec_of(gps, lamp)
    assert code in str(refused.value)


def test_it_changes_the_digest_and_a_spec_without_it_has_the_digest_as_before() -> None:
    plain = spec_of()
    assert spec_of(", driver: gpsd").digest != plain.digest
    devices = {name: replace(device, driver=None) for name, device in spec_of(", driver: gpsd").devices.items()}
    assert with_digest(replace(plain, devices=devices)).digest == plain.digest


def test_the_table_of_its_pe_carries_it_and_no_other() -> None:
    compiler = Compiler(
        spec_of(", driver: gpsd, options: {port: 2948}", ", limits: [0, 1.5], rate_limit: 2, safe: 0.25")
    )
    assert compiler.table("nav").drivers == (
        DriverEntry("gps", "gpsd", '{"port": 2948}', 500 * MS, None, None, None, "release"),
    )
    assert compiler.table("tail").drivers == (DriverEntry("lamp", None, "{}", 500 * MS, 0.0, 1.5, 2.0, 0.25),)


def test_a_spec_that_says_nothing_has_nothing_in_its_tables() -> None:
    spec = load(Path("dg_specs/big_blue.dg.yaml"))
    assert all(not Compiler(spec).table(pe).drivers for pe in spec.pes)
