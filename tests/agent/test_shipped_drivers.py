"""What the shipped drivers make of the bytes, lines and files of their devices: of right ones, and of any."""

# The numbers of the examples are those of the data sheets and of the published protocols.

import json
import os
import socket
import struct
import time
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from heronry_agent.device_driver import (
    ActuatorDriver,
    Measured,
    NotConnectedError,
    Option,
    OptionError,
    SensorDriver,
    Setup,
    checked_options,
)
from heronry_agent.drivers import SHIPPED, bmp280, ms5611
from heronry_agent.drivers.canaerospace import ForeignDatum, ForeignNode
from heronry_agent.drivers.gpio import GpioLine
from heronry_agent.drivers.gpsd import Gpsd, GpsdLines, position_of
from heronry_agent.drivers.iio import IioInput, IioOutput
from heronry_agent.drivers.iio_buffer import Element, IioBuffer, Scan, places
from heronry_agent.drivers.nmea import NmeaPositions, NmeaReceiver, fields_of
from heronry_agent.drivers.pwm import PwmServo, pulse_ns
from heronry_agent.drivers.sysfs_number import SysfsOutput
from heronry_agent.shell.driver_catalogue import UnknownDriverError, load_driver
from heronry_wire.bare_can import can
from heronry_wire.canaerospace import DataType, Datum, ErrorReport, encode_data, encode_emergency_event
from heronry_wire.frame import Frame

MS = 1_000_000


def setup_of(kind: type[SensorDriver] | type[ActuatorDriver], **options: object) -> Setup:
    return Setup("device", checked_options(kind.OPTIONS, options), 100 * MS)


# The catalogue and the options


@pytest.mark.parametrize("name", SHIPPED)
def test_every_shipped_driver_is_imported_without_hardware_and_declares_its_options(name: str) -> None:
    kind = load_driver(name)
    assert issubclass(kind, (SensorDriver, ActuatorDriver))
    assert all(isinstance(option, Option) and option.meaning for option in kind.OPTIONS.values())


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("bmp380", "there is no driver 'bmp380'; did you mean 'bmp280'?"),
        ("thermometer", "write package.module:Class for a driver of your own"),
        ("no_such_package:Driver", "there is no no_such_package here; install it, or set PYTHONPATH"),
        ("heronry_agent.device:", "names no class"),
        ("heronry_agent.module:Module", "has no class Module derived from SensorDriver or ActuatorDriver"),
    ],
)
def test_a_driver_that_is_not_there_is_one_sentence(name: str, says: str) -> None:
    with pytest.raises(UnknownDriverError) as refused:
        load_driver(name)
    assert says in str(refused.value)


DECLARED = {
    "port": Option("The line.", str),
    "rate": Option("Bits per second.", int, 9600, least=300, most=4000),
    "scale": Option("Factor.", float, 1.0),
    "side": Option("Which one.", str, "left", choices=("left", "right")),
}


def test_options_have_their_defaults_and_a_whole_number_is_a_number() -> None:
    assert checked_options(DECLARED, {"port": "x", "scale": 2}) == {
        "port": "x", "rate": 9600, "scale": 2.0, "side": "left",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("given_options", "says"),
    [
        ({}, "option 'port' is missing: The line."),
        ({"prot": "x"}, "the driver has no option 'prot'; did you mean 'port'?"),
        ({"port": 1}, "option 'port' must be text, not 1"),
        ({"port": "x", "rate": True}, "option 'rate' must be a whole number, not True"),
        ({"port": "x", "rate": 200}, "option 'rate' must be at least 300, not 200"),
        ({"port": "x", "rate": 5000}, "option 'rate' must be at most 4000, not 5000"),
        ({"port": "x", "side": "up"}, "option 'side' must be one of left, right, not 'up'"),
    ],
)
def test_options_that_do_not_fit_are_one_sentence(given_options: dict[str, object], says: str) -> None:
    with pytest.raises(OptionError) as refused:
        checked_options(DECLARED, given_options)
    assert str(refused.value) == says


# NMEA 0183

GGA = b"$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*47\r\n"
RMC = b"$GPRMC,123519,A,4807.038,N,01131.000,E,022.4,084.4,230394,003.1,W*6A\r\n"
THERE = (481_173_000, 115_166_667, 545_400)


def sentence(body: str) -> bytes:
    check = 0
    for byte in body.encode():
        check ^= byte
    return f"${body}*{check:02X}\r\n".encode()


def test_a_sentence_with_a_fix_is_a_position_and_the_track_is_that_of_the_last_rmc() -> None:
    receiver = NmeaPositions()
    assert receiver.feed(GGA) == [(*THERE, -1)], "no track yet"
    assert receiver.feed(RMC + GGA) == [(*THERE, 8_440_000)]
    assert fields_of(GGA)[0] == "GPGGA"


def test_south_and_west_are_negative() -> None:
    assert NmeaPositions().feed(sentence("GNGGA,1,3351.500,S,15112.600,W,2,9,1,-3.5,M,,M,,")) == [
        (-338_583_333, -1_512_100_000, -3_500, -1)
    ]


@pytest.mark.parametrize(
    "line",
    [
        GGA.replace(b"*47", b"*48"),
        GGA.replace(b"*47", b""),
        GGA[:40] + b"\r\n",
        sentence("GPGGA,1,,,,,0,00,,,M,,M,,"),
        sentence("GPGGA,1,4807.038,N,01131.000,E,6,08,0.9,545.4,M,46.9,M,,"),
        sentence("GPGGA,1,4867.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,"),
        sentence("GPGGA,1,9907.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,"),
        sentence("GPGGA,1,4807.038,N,01131.000,E,1,08,0.9,nan,M,46.9,M,,"),
        b"$GPGGA," + b"9" * 5_000 + b"\r\n",
    ],
)
def test_what_is_no_fix_gives_nothing_and_the_next_fix_counts(line: bytes) -> None:
    receiver = NmeaPositions()
    assert receiver.feed(line) == []
    assert receiver.feed(GGA) == [(*THERE, -1)]


@given(st.lists(st.one_of(st.binary(max_size=200), st.sampled_from([GGA, RMC, b"$", b"*47", b"\n"]))))
def test_any_bytes_are_taken(pieces: list[bytes]) -> None:
    receiver = NmeaPositions()
    for piece in pieces:
        for one in receiver.feed(piece):
            assert len(one) == 4
    assert receiver.feed(b"\n" + GGA)[-1][:3] == THERE


@given(st.integers(1, len(GGA) - 1))
def test_a_sentence_in_two_pieces_is_one(at: int) -> None:
    receiver = NmeaPositions()
    assert receiver.feed(GGA[:at]) == [] or at == len(GGA)
    assert receiver.feed(GGA[at:]) == [(*THERE, -1)]


def test_a_receiver_on_a_serial_line() -> None:
    pytest.importorskip("serial")
    ours, theirs = os.openpty()
    driver = NmeaReceiver(setup_of(NmeaReceiver, port=os.ttyname(theirs)))
    os.write(ours, b"half a sen" + GGA[30:] + RMC + GGA)
    found = None
    while found is None:
        found = driver.read()
    assert found.value == (*THERE, 8_440_000)
    assert found.time_ns <= time.monotonic_ns()
    os.close(ours)
    os.close(theirs)
    with pytest.raises(OSError, match=r"Input/output error|device"):  # the cable is out
        driver.read()
    driver.close()


# gpsd


def tpv(**more: object) -> bytes:
    return json.dumps({"class": "TPV", "mode": 3, "lat": 48.1173, "lon": 11.5, "altMSL": 545.4, **more}).encode()


def test_a_fix_of_gpsd_is_a_position() -> None:
    assert position_of(tpv(track=84.4), "") == (481_173_000, 115_000_000, 545_400, 8_440_000)
    assert position_of(tpv(), "") == (481_173_000, 115_000_000, 545_400, -1)
    assert position_of(tpv(device="/dev/ttyS1"), "/dev/ttyS0") is None


@pytest.mark.parametrize(
    "line", [b"", b"[]", b"{", b'{"class": "VERSION"}', tpv(mode=2), tpv(lat=None), tpv(lat="1"), tpv(lon=181.0)]
)
def test_what_gpsd_says_besides_gives_nothing(line: bytes) -> None:
    assert position_of(line, "") is None


@given(st.lists(st.binary()))
def test_any_bytes_of_gpsd_are_taken(pieces: list[bytes]) -> None:
    lines = GpsdLines()
    for piece in pieces:
        for line in lines.feed(piece):
            position_of(line, "")
    assert lines.feed(b"\n" + tpv() + b"\n")[-1] == tpv()


def test_a_connection_to_gpsd_is_watched_and_its_end_is_told() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        driver = Gpsd(setup_of(Gpsd, port=server.getsockname()[1]))
        connection, _ = server.accept()
        with connection:
            assert connection.recv(100) == b'?WATCH={"enable": true, "json": true};\n'
            connection.sendall(b'{"class":"VERSION"}\n' + tpv()[:20])
            assert driver.read() is None
            connection.sendall(tpv()[20:] + b"\n")
            assert driver.read().value[:2] == (481_173_000, 115_000_000)
        with pytest.raises(NotConnectedError, match="gpsd has closed the connection"):
            driver.read()
        driver.close()


# A foreign CANaerospace node


def pressure(value: float = 1013.0, **changed: int) -> Frame:
    fields = {"node_id": 17, "data_type": DataType.FLOAT, "service_code": 0, "message_code": 0} | changed
    return encode_data(326, Datum(**fields, value=value))


def test_a_datum_of_the_node_is_a_reading_and_nothing_else_is() -> None:
    node = ForeignDatum(17, 326, invalid_codes=(9,), quiet_ns=1_000)
    assert node.hear(pressure(), 5) == Measured(1013.0, 5)
    assert node.hear(pressure(node_id=18), 5) is None
    assert node.hear(pressure(service_code=9), 5) is None
    assert node.hear(Frame(327, pressure().data), 5) is None
    assert node.hear(Frame(326, pressure().data, True), 5) is None
    assert node.hear(Frame(326, bytes((17, DataType.NODATA, 0, 0))), 5) is None
    assert node.hear(Frame(326, b"\x11"), 5) is None


def test_after_an_emergency_event_nothing_is_used_for_a_while() -> None:
    node = ForeignDatum(17, 326, quiet_ns=1_000)
    assert node.hear(encode_emergency_event(17, ErrorReport(1, 2, 3)), 5) is None
    assert node.hear(pressure(), 1_004) is None
    assert node.hear(pressure(), 1_005) == Measured(1013.0, 1_005)
    assert node.hear(encode_emergency_event(18, ErrorReport(1, 2, 3)), 1_006) is None
    assert node.hear(pressure(), 1_007) is not None, "that was another node"


@given(st.integers(0, 2047), st.binary(max_size=8), st.booleans())
def test_any_frame_is_taken(identifier: int, data: bytes, extended: bool) -> None:
    ForeignDatum(17, 326).hear(Frame(identifier, data, extended), 0)


# Barometers

BMP280 = bmp280.Calibration(27504, 26435, -1000, 36477, -10685, 3024, 2855, 140, -7, 15500, -14600, 6000)
MS5611 = (0, 40127, 36924, 23317, 23282, 33464, 28312, 0)


def test_the_bmp280_computes_as_its_data_sheet() -> None:
    assert bmp280.temperature(BMP280, 519888)[0] == pytest.approx(25.08, abs=0.005)
    assert bmp280.pressure_hpa(BMP280, 415148, 519888) == pytest.approx(1006.5327, abs=0.001)
    assert bmp280.pressure_hpa(BMP280, 0x80000, 519888) is None
    assert bmp280.pressure_hpa(bmp280.Calibration(*[0] * 12), 415148, 519888) is None


def test_the_ms5611_computes_as_its_data_sheet() -> None:
    assert ms5611.pressure_hpa(MS5611, 9085466, 8569150) == 1000.09
    assert ms5611.pressure_hpa(MS5611, 0, 8569150) is None
    assert ms5611.is_whole((0x3132, 0x3334, 0x3536, 0x3738, 0x3940, 0x4142, 0x4344, 0x450B))
    assert not ms5611.is_whole((0x3132, 0x3334, 0x3536, 0x3738, 0x3940, 0x4142, 0x4344, 0x450A))
    assert not ms5611.is_whole((0,) * 8), "nobody answers, and the check sum of nothing is 0"


@given(st.integers(0, 2**24 - 1), st.integers(0, 2**24 - 1))
def test_a_barometer_computes_with_any_register(first: int, second: int) -> None:
    assert isinstance(ms5611.pressure_hpa(MS5611, first, second), float | None)
    assert isinstance(bmp280.pressure_hpa(BMP280, first >> 4, second >> 4), float | None)


class FakeChip:
    """Registers, and answers to commands: what i2c-stub is in a kernel that has it."""

    def __init__(self, registers: dict[int, bytes]) -> None:
        self.registers = registers
        self.orders: list[int] = []

    def read(self, register: int, count: int) -> bytes:
        return self.registers[register][:count]

    def write(self, register: int, value: int) -> None:
        self.registers[register] = bytes((value,))

    def order(self, command: int) -> None:
        self.orders.append(command)
        converted = {ms5611.CONVERT_PRESSURE: 9085466, ms5611.CONVERT_TEMPERATURE: 8569150}
        if command in converted:
            self.registers[ms5611.READ_RESULT] = converted[command].to_bytes(3)

    def close(self) -> None:
        self.registers.clear()


def test_the_bmp280_is_asked_for_its_id_and_measures_when_it_is_read() -> None:
    raw = (415148 << 4).to_bytes(3) + (519888 << 4).to_bytes(3)
    chip = FakeChip({0xD0: b"\x58", 0x88: struct.pack("<HhhH8h", *BMP280), 0xF3: b"\x00", 0xF7: raw})
    driver = bmp280.Bmp280(setup_of(bmp280.Bmp280), chip)
    assert driver.read() == pytest.approx(1006.5327, abs=0.001)
    assert chip.registers[0xF4] == b"\x2d", "it was told to measure"
    with pytest.raises(NotConnectedError, match="is no BMP280: its ID is 60h"):
        bmp280.Bmp280(setup_of(bmp280.Bmp280), FakeChip({0xD0: b"\x60"}))


def test_the_ms5611_is_reset_and_its_prom_is_checked() -> None:
    words = [*MS5611[:-1], 0]
    words[-1] = next(crc for crc in range(16) if ms5611.is_whole((*words[:-1], crc)))
    chip = FakeChip({0xA0 + 2 * number: word.to_bytes(2) for number, word in enumerate(words)})
    driver = ms5611.Ms5611(setup_of(ms5611.Ms5611), chip)
    assert driver.read() == 1000.09
    assert chip.orders == [0x1E, 0x48, 0x58]
    chip.registers[0xA4] = b"\x00\x00"
    with pytest.raises(NotConnectedError, match="its check sum does not fit"):
        ms5611.Ms5611(setup_of(ms5611.Ms5611), chip)


# Files of the kernel


def chip_folder(root: Path, number: int = 0, name: str = "adc081c", **files: str) -> Path:
    folder = root / f"iio:device{number}"
    folder.mkdir()
    (folder / "name").write_text(f"{name}\n")
    for file, text in files.items():
        (folder / file).write_text(text)
    return folder


def iio(root: Path, channel: str, device: str = "adc081c", **more: object) -> dict[str, object]:
    return {"device": device, "channel": channel, "root": str(root), **more}


def test_an_iio_channel_is_scaled_as_the_kernel_and_the_options_say(tmp_path: Path) -> None:
    folder = chip_folder(tmp_path, in_voltage_raw="100\n", in_voltage_scale="12.5\n", in_temp0_input="21500\n")
    driver = IioInput(setup_of(IioInput, **iio(tmp_path, "in_voltage", scale=0.001, offset=2)))
    assert driver.read() == pytest.approx(3.25)
    assert IioInput(setup_of(IioInput, **iio(tmp_path, "in_temp0"))).read() == 21500.0
    (folder / "in_voltage_raw").write_text("garbage")
    with pytest.raises(ValueError, match="garbage"):
        driver.read()


def test_an_iio_channel_with_a_number_has_the_scale_of_its_kind(tmp_path: Path) -> None:
    chip_folder(tmp_path, in_voltage1_raw="10", in_voltage_scale="2", in_voltage1_offset="5")
    assert IioInput(setup_of(IioInput, **iio(tmp_path, "in_voltage1"))).read() == 30.0


def test_an_iio_output_writes_the_register_and_tells_where_it_is(tmp_path: Path) -> None:
    folder = chip_folder(tmp_path, name="ad5241", out_resistance0_raw="0", out_resistance0_scale="39.0625")
    driver = IioOutput(setup_of(IioOutput, **iio(tmp_path, "out_resistance0", "ad5241")))
    assert driver.command(1000.0) == pytest.approx(1015.625)
    assert (folder / "out_resistance0_raw").read_text() == "26"
    assert driver.release is None


def test_an_iio_device_that_is_not_there_is_told_with_what_is(tmp_path: Path) -> None:
    chip_folder(tmp_path, in_voltage_raw="1")
    chip_folder(tmp_path, 1)
    with pytest.raises(NotConnectedError, match=r"there is no IIO device mcp .* iio:device0 \(adc081c\), iio:device1"):
        IioInput(setup_of(IioInput, **iio(tmp_path, "in_voltage", "mcp")))
    with pytest.raises(NotConnectedError, match="several IIO devices are named adc081c"):
        IioInput(setup_of(IioInput, **iio(tmp_path, "in_voltage")))
    with pytest.raises(NotConnectedError, match="has no channel in_pressure"):
        IioInput(setup_of(IioInput, **iio(tmp_path, "in_pressure", "iio:device0")))


def test_a_unit_that_the_kernel_cannot_tell_is_refused_and_the_register_can_be_taken_as_it_is(tmp_path: Path) -> None:
    folder = tmp_path / "iio:device0"
    folder.mkdir()
    for file, text in {"name": "0-0054", "in_voltage_raw": "110", "in_voltage_scale": ""}.items():
        (folder / file).write_text(text)
    with pytest.raises(NotConnectedError, match=r"in_voltage_scale .* cannot tell .* option 'raw'"):
        IioInput(setup_of(IioInput, **iio(tmp_path, "in_voltage", "0-0054")))
    assert IioInput(setup_of(IioInput, **iio(tmp_path, "in_voltage", "0-0054", raw=True))).read() == 110.0


@pytest.mark.parametrize(
    ("text", "data", "number"),
    [
        ("le:u8/16>>4", "e006", 110),  # of the ADC081C
        ("le:s12/16>>4", "f0ff", -1),
        ("be:s16/32>>0", "00008000", -32768),
        ("le:s64/64>>0", "0100000000000000", 1),
        ("be:u24/32>>8", "01020304", 0x010203),
    ],
)
def test_an_element_of_a_sample_is_read_by_its_type(text: str, data: str, number: int) -> None:
    assert Element.of(text + "\n").number(bytes.fromhex(data)) == number


@pytest.mark.parametrize("text", ["le:u17/16>>0", "le:u8/16X2>>4", "u8/16", ""])
def test_a_type_that_is_not_understood_is_refused(text: str) -> None:
    with pytest.raises(NotConnectedError, match="not understood"):
        Element.of(text)


def test_elements_of_a_sample_begin_at_multiples_of_their_sizes() -> None:
    byte, word, long = (Element.of(f"le:u{bits}/{bits}>>0") for bits in (8, 16, 64))
    assert places((byte, word, long)) == ((0, 2, 8), 16)
    assert places((long, byte)) == ((0, 8), 16)
    assert places((word,)) == ((0,), 2)


@given(st.binary(max_size=70), st.booleans())
def test_the_last_whole_sample_counts_whatever_comes(data: bytes, time_first: bool) -> None:
    scan = Scan(Element.of("le:u8/16>>4"), Element.of("le:s64/64>>0"), time_first=time_first)
    found = scan.newest(data)
    assert (found is None) is (len(data) < scan.size == 16)
    assert found is None or 0 <= found[0] <= 255


def buffered(root: Path) -> Path:
    """The files of an ADC081C as the kernel 6.1 has them; a pipe stands for the device."""
    folder = root / "iio:device0"
    files = {
        "name": "0-0054", "current_timestamp_clock": "realtime", "buffer/enable": "0", "buffer/length": "2",
        "trigger/current_trigger": "", "scan_elements/in_voltage_en": "0", "scan_elements/in_voltage_index": "0",
        "scan_elements/in_voltage_type": "le:u8/16>>4", "scan_elements/in_temp_en": "1",
        "scan_elements/in_timestamp_en": "0", "scan_elements/in_timestamp_index": "1",
        "scan_elements/in_timestamp_type": "le:s64/64>>0", "in_voltage_scale": "2",
    }  # fmt: skip
    for file, text in files.items():
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
        (folder / file).write_text(text)
    (root / "dev").mkdir()
    os.mkfifo(root / "dev" / "iio:device0")
    return folder


def test_a_buffer_is_set_up_and_its_newest_sample_has_the_kernels_time(tmp_path: Path) -> None:
    folder = buffered(tmp_path)
    more = {"trigger": "timer1", "devices": str(tmp_path / "dev"), "offset": 1}
    driver = IioBuffer(setup_of(IioBuffer, **iio(tmp_path, "in_voltage", "0-0054", **more)))
    said = {one: (folder / one).read_text() for one in ("trigger/current_trigger", "current_timestamp_clock")}
    assert said == {"trigger/current_trigger": "timer1", "current_timestamp_clock": "monotonic"}
    enabled = {one.name: one.read_text() for one in (folder / "scan_elements").glob("*_en")}
    assert enabled == {"in_voltage_en": "1", "in_temp_en": "0", "in_timestamp_en": "1"}
    assert [(folder / "buffer" / one).read_text() for one in ("length", "enable")] == ["16", "1"]
    assert driver.read() is None
    with (tmp_path / "dev" / "iio:device0").open("wb", buffering=0) as kernel:
        kernel.write(b"".join(struct.pack("<H6xq", raw << 4, at) for raw, at in ((109, 5), (110, 7))))
        assert driver.read() == Measured(221.0, 7)
    driver.close()
    assert (folder / "buffer/enable").read_text() == "0"


def test_a_buffer_that_the_kernel_does_not_begin_names_the_trigger(tmp_path: Path) -> None:
    folder = buffered(tmp_path)
    (folder / "buffer" / "enable").unlink()
    (folder / "buffer" / "enable").mkdir()
    with pytest.raises(NotConnectedError, match=r"does not begin the buffer .* which the option 'trigger' names"):
        IioBuffer(setup_of(IioBuffer, **iio(tmp_path, "in_voltage", "0-0054")))
    with pytest.raises(NotConnectedError, match="has no channel in_voltage7 in its buffer"):
        IioBuffer(setup_of(IioBuffer, **iio(tmp_path, "in_voltage7", "0-0054")))


def test_a_file_of_the_kernel_gets_the_nearest_whole_number(tmp_path: Path) -> None:
    file = tmp_path / "rdac0"
    with pytest.raises(NotConnectedError, match="load the kernel's driver of the chip"):
        SysfsOutput(setup_of(SysfsOutput, file=str(file)))
    file.write_text("0")
    with pytest.raises(OptionError, match="'scale' must not be 0"):
        SysfsOutput(setup_of(SysfsOutput, file=str(file), scale=0))
    driver = SysfsOutput(setup_of(SysfsOutput, file=str(file), scale=0.5, offset=-10))
    assert driver.command(2.2) == 2.0
    assert file.read_text() == "24"


def test_a_servo_gets_pulses_and_loses_them_when_it_is_released(tmp_path: Path) -> None:
    output = tmp_path / "pwmchip0" / "pwm1"
    output.mkdir(parents=True)
    for file, text in {"period": "0", "duty_cycle": "0", "enable": "0"}.items():
        (output / file).write_text(text)
    options = {"output": 1, "root": str(tmp_path), "low": -25, "high": 25}
    servo = PwmServo(setup_of(PwmServo, **options))
    assert (output / "period").read_text() == "20000000"
    assert servo.command(0.0) == 0.0
    assert ((output / "duty_cycle").read_text(), (output / "enable").read_text()) == ("1500000", "1")
    assert servo.command(99.0) == 25.0
    assert (output / "duty_cycle").read_text() == "2000000"
    servo.release()
    assert (output / "enable").read_text() == "0"
    with pytest.raises(NotConnectedError, match="enable the PWM of the board"):
        PwmServo(setup_of(PwmServo, **options, chip=1))
    with pytest.raises(OptionError, match="less than 'period_us'"):
        PwmServo(setup_of(PwmServo, **options, period_us=1500))


@given(st.floats(allow_nan=False), st.floats(500, 2500), st.floats(500, 2500))
def test_a_pulse_is_between_its_ends(value: float, least_us: float, most_us: float) -> None:
    low_ns, high_ns = sorted((round(least_us * 1000), round(most_us * 1000)))
    assert low_ns <= pulse_ns(value, -1.0, 1.0, least_us, most_us) <= high_ns


class Lines:
    """A request of gpiod for one line, as this computer has no chip to give one."""

    def __init__(self, chip: str, consumer: str, config: dict[int, object]) -> None:
        self.chip, self.consumer, self.config = chip, consumer, config
        self.values: list[tuple[int, str]] = []

    def set_value(self, line: int, value: Any) -> None:
        self.values.append((line, value.name))

    def release(self) -> None:
        self.values.append((-1, "released"))


def test_a_line_is_requested_off_and_may_be_on_for_its_longest_time(monkeypatch: pytest.MonkeyPatch) -> None:
    gpiod = pytest.importorskip("gpiod")
    monkeypatch.setattr(gpiod, "request_lines", Lines)
    driver = GpioLine(setup_of(GpioLine, line=4, longest_ms=300))
    (settings,) = driver._request.config.values()
    assert (settings.direction, settings.output_value) == (gpiod.line.Direction.OUTPUT, gpiod.line.Value.INACTIVE)
    assert [driver.command(value) for value in (1.0, 0.4)] == [1.0, 0.0]
    assert [driver.lasts_ms(value) for value in (1.0, 0.4)] == [300.0, None]
    driver.release()
    driver.close()
    assert driver._request.values == [(4, "ACTIVE"), (4, "INACTIVE"), (4, "INACTIVE"), (-1, "released")]


def test_a_foreign_node_is_heard_on_a_bus_of_the_pe() -> None:
    bus = {"interface": "virtual", "channel": "foreign"}
    setup = Setup(
        "barometer", checked_options(ForeignNode.OPTIONS, {"node": 17, "identifier": 326}), MS, {"can0": bus}, "can0"
    )
    driver = ForeignNode(setup)
    with can.Bus(**bus) as other:
        other.send(can.Message(arbitration_id=327, data=pressure().data, is_extended_id=False))
        other.send(can.Message(arbitration_id=326, data=pressure().data, is_extended_id=True))
        other.send(can.Message(arbitration_id=326, data=pressure().data, is_extended_id=False))
        found = None
        while found is None:
            found = driver.read()
        assert found.value == 1013.0
        assert driver.read() is None
    driver.close()
    with pytest.raises(OptionError, match="option 'bus' names no bus of this PE: can1; there is can0"):
        ForeignNode(Setup("x", {**setup.options, "bus": "can1"}, MS, {"can0": bus}, "can0"))
