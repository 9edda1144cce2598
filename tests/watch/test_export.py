"""Recordings for other tools: unmodified readers find every signal with its unit, events and reconfigurations."""

import json
from pathlib import Path

import pytest
from asammdf import MDF
from mcap.reader import make_reader

from heronry_tools.cli import main
from heronry_tools.watch.export.signals import signals_of
from heronry_wire.frame import Frame
from watch.flights import DATE_NS, big_blue, big_blue_log

pytestmark = pytest.mark.xdist_group("big_blue_log")  # it is flown once


def converted(file: Path) -> Path:
    assert main(["log", "convert", str(big_blue_log()), "big_blue", "-o", str(file)]) == 0
    return file


def expect_every_signal(units: dict[str, str]) -> None:
    """Whatever the spec lets a module give is there with its unit, and so are PEs, buses and functions; no more."""
    spec = big_blue().spec
    expected = {f"pe.{pe}.{what}": unit for pe in spec.pes for what, unit in (("load", "%"), ("epoch", ""))}
    expected |= {f"bus.{bus}.{what}": "%" for bus in spec.buses for what in ("load", "peak")}
    expected |= {f"function.{function}.served": "" for function in spec.functions}
    for module in spec.modules.values():
        for variable in {name for mode in module.modes.values() for name in mode.gives}:
            name, of = f"{module.name}.{variable}", spec.variables[variable]
            parts = {"2": 2, "3": 3, "4": 4}.get(of.type[-1], 1)
            names = [name] if parts == 1 or of.type.startswith("ACHAR") else [f"{name}.{n}" for n in range(parts)]
            expected |= dict.fromkeys(names, of.unit or "")
    assert any(expected.values())
    assert units == expected


def test_mcap_has_every_signal_with_its_unit(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = converted(tmp_path / "flight.mcap")
    assert f"{file}: {len(big_blue().frames)} frames" in capsys.readouterr().out
    with file.open("rb") as stream:
        reader = make_reader(stream)
        summary = reader.get_summary()
        channels = {channel.topic: channel for channel in summary.channels.values()}
        expect_every_signal(
            {topic[9:]: one.metadata["unit"] for topic, one in channels.items() if topic[:9] == "/signals/"}
        )
        schemas = {channel.topic: json.loads(summary.schemas[channel.schema_id].data) for channel in channels.values()}
        assert schemas["/signals/bus.can0.load"]["properties"]["value"]["description"].endswith(", in %")
        counts = summary.statistics.channel_message_counts
        expected = {series.name: series for series in signals_of(big_blue())}
        for name, series in expected.items():
            assert counts.get(channels[f"/signals/{name}"].id, 0) == len(series.values), name
        some = next(series for series in expected.values() if len(series.values) > 20)
        read = [
            (message.log_time, json.loads(message.data)["value"])
            for _, _, message in reader.iter_messages(topics=[f"/signals/{some.name}"])
        ]
        assert read == list(zip(some.times_ns, some.values, strict=True))
        told = [json.loads(m.data) for _, _, m in reader.iter_messages(topics=["/reconfigurations"])]
        assert [one["epoch"] for one in told] == [one.epoch for one in big_blue().timeline().last().reconfigurations]
        levels = {json.loads(m.data)["level"] for _, _, m in reader.iter_messages(topics=["/events"])}
        assert {1, 2, 4} <= levels


def test_mf4_has_every_signal_with_its_unit(tmp_path: Path) -> None:
    file = converted(tmp_path / "flight.mf4")
    with MDF(file) as mdf:
        expected = {series.name: series for series in signals_of(big_blue())}
        found = {name: mdf.get(name) for name in mdf.channels_db if name not in ("time", "events", "reconfigurations")}
        expect_every_signal({name: signal.unit for name, signal in found.items()})
        for name, series in expected.items():
            assert len(found[name]) == len(series.values), name
        some = next(series for series in expected.values() if len(series.values) > 20)
        read = mdf.get(some.name)
        assert read.samples.tolist() == some.values
        assert read.timestamps[-1] == pytest.approx((some.times_ns[-1] - big_blue().timeline().begins_ns) / 1e9)
        assert mdf.header.start_time.timestamp() == pytest.approx(DATE_NS / 1e9, abs=1)
        told = [json.loads(text) for text in mdf.get("reconfigurations").samples]
        assert told[-1]["epoch"] == big_blue().timeline().last().epoch
        assert any("nav is lost" in text.decode() for text in mdf.get("events").samples)


def test_frames_that_carry_no_datum_are_left_out() -> None:
    recording = big_blue()
    can_id = next(f.frame.can_id for f in recording.frames if 300 <= f.frame.can_id < 1500)
    strange = [Frame(can_id, b"\x01"), Frame(can_id, b"\x01\x02", extended=True)]
    before = sum(len(series.values) for series in signals_of(recording))
    frames = [*recording.frames, *(recording.frames[-1]._replace(frame=frame) for frame in strange)]
    changed = type(recording)(recording.spec, frames, recording.events, recording.source)
    assert sum(len(series.values) for series in signals_of(changed)) == before


def test_another_ending_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["log", "convert", str(big_blue_log()), "big_blue", "-o", str(tmp_path / "flight.csv")]) == 2
    assert "name the file *.mcap or *.mf4" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
