"""Plots of variables: what frames carry is what is drawn, live and recorded; without a plot no frame is looked at."""

import asyncio
import http.client
import math
import struct
import time
from bisect import bisect_right
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from starlette.testclient import TestClient

from heronry_dg.traffic import identifiers
from heronry_manager.events import Reconfigured
from heronry_tools.watch.data_samples import data_sources, sample_of
from heronry_tools.watch.orders import Orders
from heronry_tools.watch.reducer import Reducer
from heronry_tools.web.app import Site, application
from heronry_tools.web.guard import Access
from heronry_tools.web.live import Live
from heronry_tools.web.plots import live as live_room
from heronry_tools.web.plots.asked import MOST_VARIABLES, PlotError, checked_variables
from heronry_tools.web.plots.live import LivePlots, live_values
from heronry_tools.web.plots.recorded import RecordedPlots
from heronry_tools.web.plots.tracks import Track
from heronry_tools.web.questions import Questions
from heronry_wire.frame import Frame, LoggedFrame, Malformed
from web.browser import Server, Watched, browser, needs_chromium, recorded
from web.flight import S, big_blue, flown, flown_frames
from web.test_first_look import DESK, PHONE, expect_legible
from web.test_page import watched_now

ORIGIN = "http://127.0.0.1:8321"
MS = 1_000_000
VALID_1, INVALID_1, NO_VERSION = 0x11, 0x31, 0x10  # byte 2: validity, version
FLOAT, SHORT2 = 2, 12  # CANaerospace's codes
PERIOD_NS = 20 * MS  # of roll_rate as imu_driver_1 gives it, in its slowest mode


def source_of(producer, variable):
    return next(
        one for one in data_sources(big_blue()).values() if (one.producer, one.variable) == (producer, variable)
    )


SOURCE = source_of("imu_driver_1", "roll_rate")
NODE = big_blue().pes["nav"].node_id


def frame(value, code, *, status=VALID_1, node=NODE, of_type=FLOAT):
    return Frame(SOURCE.identifier, bytes((node, of_type, status, code)) + struct.pack(">f", value))


def told(track):
    (one,) = track.since(0)
    return list(zip(one["t_ns"], one["values"], strict=True))


def by_hand(producer, variable):
    """The samples of a source of numbers in single precision, read from the recorded bytes."""
    can_id = identifiers(big_blue())[producer, variable]
    found = {}
    for at_ns, _, one in flown_frames():
        if one.can_id == can_id:
            found.setdefault((one.data[3], one.data[4:]), []).append((at_ns, struct.unpack(">f", one.data[4:])[0]))
    return sorted(some[0] for some in found.values())


def test_a_frame_is_read_as_the_spec_says_or_refused_as_a_pe_would():
    assert sample_of(SOURCE, frame(1.5, 7)) == ((1.5,), 1, True, NODE, 7)
    assert not sample_of(SOURCE, frame(1.5, 7, status=INVALID_1)).is_usable
    assert not sample_of(SOURCE, frame(math.inf, 7)).is_usable
    two = source_of("telemetry", "telemetry_attitude")
    node = min(two.nodes)
    sample = sample_of(two, Frame(two.identifier, bytes((node, SHORT2, VALID_1, 0)) + struct.pack(">2h", -5, 300)))
    assert (two.parts, sample.numbers) == (2, (-5, 300))
    refused = {
        "3 bytes are too few": Frame(SOURCE.identifier, b"\1\2\3"),
        "has type FLOAT": frame(1.5, 7, of_type=3),
        "on which imu_driver_1 cannot run": frame(1.5, 7, node=NODE + 1),
        "states no version": frame(1.5, 7, status=NO_VERSION),
        "29 bits": replace_extended(frame(1.5, 7)),
    }
    for reason, bad in refused.items():
        found = sample_of(SOURCE, bad)
        assert isinstance(found, Malformed)
        assert reason in found.reason


def replace_extended(one):
    return one._replace(extended=True)


def test_silence_and_invalid_data_are_gaps_and_a_frame_that_comes_twice_counts_once():
    track = Track(SOURCE)
    fresh_ns = SOURCE.fresh_ns
    for at_ns, one in (
        (0, frame(1, 0)),
        (1, frame(1, 0)),  # from another bus
        (10, frame(2, 1, status=INVALID_1)),
        (20, frame(3, 2)),
        (20 + fresh_ns, frame(4, 3)),
        (21 + 2 * fresh_ns, frame(5, 4)),
        (21 + 2 * fresh_ns, frame(6, 5, node=1)),
    ):
        track.take(at_ns, one)
    silent_ns = 20 + 2 * fresh_ns
    assert told(track) == [
        (0, 1),
        (10, None),
        (20, 3),
        (20 + fresh_ns, 4),
        (silent_ns, None),
        (silent_ns + 1, 5),
    ]
    assert (track.refused, "node 1" in track.why_refused) == (1, True)


def test_a_live_track_keeps_the_last_samples_and_no_more():
    track = Track(SOURCE, 10)
    for number in range(1_000):
        track.take(number * MS, frame(number, number % 256))
        assert len(told(track)) < 20
    assert track.count == 1_000
    assert told(track)[-10:] == [(number * MS, number) for number in range(990, 1_000)]
    (last,) = track.since(998)
    assert last["values"] == [998, 999]


@given(
    st.lists(st.one_of(st.none(), st.integers(-100, 100)), max_size=300),
    st.integers(0, 300),
    st.integers(0, 300),
    st.integers(3, 40),
)
def test_thinning_keeps_extremes_and_gaps(values, begin, end, most):
    track = Track(SOURCE)
    for number, value in enumerate(values):
        track.take(number * MS, frame(value or 0, number % 256, status=VALID_1 if value is not None else INVALID_1))
    whole = told(track)
    (one,) = track.between(begin * MS, end * MS, most)
    thin = list(zip(one["t_ns"], one["values"], strict=True))
    assert len(thin) <= most
    assert thin == [sample for sample in whole if sample in thin]  # in order, and nothing is made up
    inside = [value for at_ns, value in whole if begin * MS <= at_ns <= end * MS]
    some = [value for value in inside if value is not None]
    if some:
        kept = [value for _, value in thin if value is not None]
        assert min(kept) <= min(some)
        assert max(kept) >= max(some)
    if None in inside:
        assert None in one["values"]


def recorded_plots(frames=None):
    return RecordedPlots(Reducer(big_blue()), flown(), flown_frames() if frames is None else frames)


def test_a_recording_gives_the_samples_that_its_frames_carry_and_who_reads_them():
    answer = recorded_plots().told(["roll_rate"], 0, 20 * S, 4_000)
    assert [one["unit"] for one in answer["plots"]] == ["deg/s"]
    series = {one["producer"]: one for one in answer["series"]["roll_rate"]}
    assert set(series) == {"imu_driver_1", "imu_driver_2"}
    for producer, one in series.items():
        drawn = [pair for pair in zip(one["t_ns"], one["values"], strict=True) if pair[1] is not None]
        assert drawn == by_hand(producer, "roll_rate")
        assert set(one["versions"]) == {1 if producer == "imu_driver_1" else 2}
    used = answer["used"]["roll_rate"]
    assert [at_ns for at_ns, _ in used] == sorted(at_ns for at_ns, _ in used)
    assert list(used[0][1]) == []
    assert list(used[-1][1]) == ["imu_driver_2"]  # the navigation computer has died
    readers = Live(Reducer(big_blue()), "manager")
    readers.take_all(flown(), None, is_alive=True)
    wired = {
        reader
        for reader, module in readers.snapshot.modules.items()
        if any(wire.variable == "roll_rate" for wire in module.wires.values())
    }
    assert set(used[-1][1]["imu_driver_2"]) == wired
    done_ns = max(event.t_ns for event in flown() if isinstance(event, Reconfigured))
    assert used[-1][0] == done_ns


def test_a_recording_keeps_the_last_variables_and_one_without_frames_has_no_plots(monkeypatch):
    plots = recorded_plots()
    for name in list(big_blue().variables)[:20] * 2:
        plots.told([name], 0, S, 100)
    assert len(plots._tracks) == 16
    with pytest.raises(PlotError, match="no frames"):
        recorded_plots(()).told(["roll_rate"], 0, S, 100)


@pytest.mark.parametrize(
    ("names", "sentence"),
    [
        ((), "name the variable to plot"),
        (("altitud",), "did you mean 'altitude'?"),
        (tuple(big_blue().variables)[: MOST_VARIABLES + 1], "more than the 8"),
    ],
)
def test_what_cannot_be_plotted_is_refused_in_one_sentence(names, sentence):
    with pytest.raises(PlotError, match=sentence.replace("?", r"\?")):
        checked_variables(big_blue(), names)


def test_a_text_has_no_plot():
    spec = big_blue()
    text = replace(spec.variables["altitude"], type="ACHAR4")
    with pytest.raises(PlotError, match="altitude are of type ACHAR4: no numbers"):
        checked_variables(replace(spec, variables={**spec.variables, "altitude": text}), ["altitude"])


def test_without_a_plot_no_frame_is_looked_at_and_with_the_last_page_the_samples_go():
    class Untouched:
        def __iter__(self):
            raise AssertionError("no plot is open")

    plots = LivePlots(big_blue())
    some = [LoggedFrame(number * MS, "can0", frame(number, number)) for number in range(3)]
    assert plots.picked(Untouched()) == ()
    with plots.opened(["roll_rate", "altitude"]) as first:
        plots.take(plots.picked([*some, LoggedFrame(9, "can0", Frame(0x7FE, b"\0"))]))
        with plots.opened(["roll_rate"]) as second:
            assert second["roll_rate"] is first["roll_rate"]
        assert told(first["roll_rate"][0]) == [(0, 0), (MS, 1), (2 * MS, 2)]
        picked = plots.picked(some)
        assert len(picked) == 3
    plots.take(picked)  # the plot was closed meanwhile
    assert plots.picked(Untouched()) == ()


def test_too_many_plots_at_once_are_refused(monkeypatch):
    monkeypatch.setattr(live_room, "MOST_TRACKS", 5)
    plots = LivePlots(big_blue())
    plots.expect_room(["roll_rate", "altitude"])
    with plots.opened(["roll_rate", "altitude"]):
        plots.expect_room(["altitude"])
        with pytest.raises(PlotError, match="too many variables"):
            plots.expect_room(["pitch_angle"])


def test_a_live_plot_gets_samples_as_they_come_and_who_reads_them_when_that_changes():
    live = watched_now()
    plots = live.plots

    async def watch():
        closing = asyncio.Event()
        stream = live_values(plots, ["roll_rate"], lambda: live.snapshot, closing)
        seen = [await anext(stream), await anext(stream)]
        plots.take(
            plots.picked([LoggedFrame(5 * MS, "can0", frame(2.5, 9)), LoggedFrame(6 * MS, "can0", frame(1, 8, node=1))])
        )
        seen.append(await anext(stream))
        closing.set()
        return seen, [one async for one in stream]

    ((kind, (known,)), (_, empty), (_, one)), rest = asyncio.run(watch())
    assert (kind, known["unit"], known["is_stepped"]) == ("plots", "deg/s", False)
    assert empty["series"] == {"roll_rate": []}
    ((since_ns, read),) = empty["used"]["roll_rate"]
    assert (since_ns, list(read)) == (live.snapshot.reconfigurations[-1].done_ns, ["imu_driver_2"])
    assert [(each["t_ns"], each["values"]) for each in one["series"]["roll_rate"]] == [([5 * MS], [2.5])]
    assert one["used"] == {}
    assert one["refused"]["roll_rate"]["imu_driver_1"][0] == 1
    assert rest == []
    assert plots.picked([LoggedFrame(5 * MS, "can0", frame(2.5, 9))]) == ()


def client(shown, frames=()):
    questions = Questions(big_blue(), None)
    return TestClient(
        application(Site(big_blue(), shown, questions, Orders(None), Access("127.0.0.1", 8321, "t"), frames)),
        base_url=ORIGIN,
    )


def test_the_address_gives_samples_of_a_recording_and_refuses_what_is_wrong():
    with client(recorded(), flown_frames()) as asking:
        whole = asking.get(f"/api/values?variable=roll_rate&points=100000&to_ns={20 * S}").json()
        drawn = sum(value is not None for one in whole["series"]["roll_rate"] for value in one["values"])
        assert drawn == len(by_hand("imu_driver_1", "roll_rate")) + len(by_hand("imu_driver_2", "roll_rate"))
        part = asking.get(f"/api/values?variable=roll_rate&from_ns={2 * S}&to_ns={3 * S}&points=nan").json()
        times = part["series"]["roll_rate"][0]["t_ns"]
        assert 2 * S - 100 * MS <= times[0] <= 2 * S
        assert 3 * S <= times[-1] <= 3 * S + 100 * MS
        assert asking.get("/api/values?variable=roll_rate&points=-3").status_code == 200
        for query in ("", "?variable=", "?variable=nothing", "?variable=altitude&variable=nothing"):
            answer = asking.get(f"/api/values{query}")
            assert answer.status_code == 400
            assert answer.json()["sentence"]
    with client(recorded()) as asking:
        assert "no frames" in asking.get("/api/values?variable=roll_rate").json()["sentence"]


def test_a_plot_of_a_page_that_goes_away_ends_at_once():
    live = watched_now()
    with Server(live) as server:
        connection = http.client.HTTPConnection(server.access.address, server.access.port, timeout=10)
        connection.request("GET", "/api/values?variable=roll_rate")
        answer = connection.getresponse()
        assert answer.readline() == b"event: plots\n"
        some = [LoggedFrame(MS, "can0", frame(1, 1))]
        assert live.plots.picked(some)
        answer.close()
        connection.close()
        until_s = time.monotonic() + 30
        while live.plots.picked(some):
            assert time.monotonic() < until_s
            time.sleep(0.01)


@pytest.fixture(scope="module")
def chromium():
    with browser() as opened:
        yield opened


COLUMN = """([variable, share, number]) => {
    const canvas = document.querySelector(`[data-plot="${variable}"] canvas`);
    const over = document.querySelector(`[data-plot="${variable}"] .u-over`);
    const scale = canvas.width / canvas.clientWidth;
    const x = Math.round((over.offsetLeft + share * over.clientWidth) * scale);
    const copy = Object.assign(document.createElement("canvas"), { width: 2, height: canvas.height });
    const probe = copy.getContext("2d", { willReadFrequently: true });
    probe.fillStyle = getComputedStyle(document.documentElement).getPropertyValue(`--plot-${number}`).trim();
    probe.fillRect(1, 0, 1, 1);
    const [r, g, b] = probe.getImageData(1, 0, 1, 1).data;
    probe.drawImage(canvas, -x, 0);
    const { data } = probe.getImageData(0, 0, 1, canvas.height);
    let found = 0;
    for (let at = 0; at < data.length; at += 4) {
        const apart = Math.abs(data[at] - r) + Math.abs(data[at + 1] - g) + Math.abs(data[at + 2] - b);
        if (data[at + 3] > 200 && apart < 40) found += 1;
    }
    return found;
}"""


def is_drawn(watched, variable, at_ns, number):
    """Whether the line of a colour is drawn where a time is; the whole recording is shown."""
    first_ns, last_ns = watched.page.evaluate("[heronry.store.recording.first_ns, heronry.store.recording.last_ns]")
    return watched.page.evaluate(COLUMN, [variable, (at_ns - first_ns) / (last_ns - first_ns), number]) > 0


def values_shown(watched, variable):
    script = """(all) => Object.fromEntries(all.map((one) =>
        [one.dataset.line, [one.querySelector(".number").textContent, one.dataset.used]]))"""
    return watched.page.eval_on_selector_all(f'[data-plot="{variable}"] [data-line]', script)


@needs_chromium
@pytest.mark.parametrize(("width", "scheme"), [(DESK, "light"), pytest.param(PHONE, "dark", marks=pytest.mark.soak)])
def test_a_recorded_variable_is_plotted_in_two_taps(chromium, width, scheme):
    with Server(recorded(), frames=flown_frames()) as server:
        watched = Watched(chromium, width, scheme)
        watched.open(server.address)
        page = watched.page
        assert not any("uPlot.iife" in url for url in watched.asked)  # only a plot needs it
        watched.every_symbol()
        page.click('#symbols [data-symbol="variable:roll_rate"] button')
        page.click('#details [data-plot-of="roll_rate"]')
        page.wait_for_selector('#panel-plots [data-plot="roll_rate"] canvas')
        page.keyboard.press("Escape")
        ends = recorded().ends_ns
        lost_ns = by_hand("imu_driver_1", "roll_rate")[-1][0]
        watched.until("document.querySelectorAll('[data-plot=roll_rate] [data-line]').length === 2")
        watched.page.wait_for_timeout(300)
        assert is_drawn(watched, "roll_rate", 2 * S, 1)
        assert is_drawn(watched, "roll_rate", (lost_ns + ends) // 2, 2)
        assert not is_drawn(watched, "roll_rate", (lost_ns + ends) // 2, 1)
        at_ns = 9_500 * MS
        moved = """(slider, at_ns) => {
            const { first_ns, last_ns } = heronry.store.recording;
            slider.value = String(Math.round(1000 * (at_ns - first_ns) / (last_ns - first_ns)));
            slider.dispatchEvent(new Event("input"));
        }"""
        page.eval_on_selector("#replay input", moved, at_ns)
        watched.until(f"Math.abs(heronry.store.at_ns - {at_ns}) < {20 * MS}")
        page.wait_for_timeout(300)
        samples = by_hand("imu_driver_2", "roll_rate")
        shown_ns = page.evaluate("heronry.store.at_ns")
        last = samples[bisect_right(samples, (shown_ns, math.inf)) - 1][1]
        shown = values_shown(watched, "roll_rate")
        assert float(shown["imu_driver_2"][0].removesuffix(" deg/s")) == pytest.approx(last, rel=1e-5)
        assert shown["imu_driver_2"][1] == "true"
        assert shown["imu_driver_1"] == ["not heard", "false"]
        expect_legible(watched, f"a plot at {width}, {scheme}")
        page.select_option("#plots-add", "altitude")
        page.wait_for_selector('[data-plot="altitude"] canvas')
        assert page.evaluate("location.hash") == "#/plots/roll_rate,altitude"
        page.click('[data-plot="roll_rate"] [aria-label="Close the plot of roll_rate"]')
        page.wait_for_selector('[data-plot="roll_rate"]', state="detached")
        assert watched.wrong == []


@needs_chromium
def test_a_live_variable_is_plotted_while_its_panel_is_open_and_the_keyboard_suffices(chromium):
    live = watched_now()
    probe = [LoggedFrame(MS, "can0", frame(1, 1))]
    with Server(live) as server:
        watched = Watched(chromium)
        page = watched.page
        watched.open(server.address)
        assert not live.plots.picked(probe)
        watched.panel("plots")
        page.focus("#plots-add")
        page.keyboard.type("roll_rate")
        page.keyboard.press("Enter")
        page.wait_for_selector('[data-plot="roll_rate"] canvas')
        watched.until("document.querySelector('[data-plot=roll_rate] p').textContent.includes('has been heard yet')")
        now_ns = live.snapshot.t_ns
        for number in range(40):
            at_ns = now_ns - (40 - number) * PERIOD_NS
            live.plots.take(live.plots.picked([LoggedFrame(at_ns, "can0", frame(number / 4, number))]))
        watched.until("document.querySelector('[data-line=imu_driver_1] .number').textContent === '9.75 deg/s'")
        live.plots.take(live.plots.picked([LoggedFrame(now_ns, "can0", frame(0, 40, status=INVALID_1))]))
        watched.until("document.querySelector('[data-line=imu_driver_1] .number').textContent.startsWith('invalid')")
        live.plots.take(live.plots.picked([LoggedFrame(now_ns, "can0", frame(0, 41, node=1))]))
        watched.until(
            "document.querySelector('[data-plot=roll_rate] .why').textContent.includes('1 frame of imu_driver_1')"
        )
        page.focus("#plots-hold")
        page.keyboard.press("Enter")
        page.wait_for_selector('#plots-hold[aria-pressed="true"]')
        page.focus("#plots-all")
        page.keyboard.press("Enter")
        page.wait_for_selector('#plots-hold[aria-pressed="false"]')
        watched.panel("events")
        until_s = time.monotonic() + 30
        while live.plots.picked(probe):
            assert time.monotonic() < until_s
            page.wait_for_timeout(20)
        page.goto(f"{server.address}#/plots/nothing")
        page.wait_for_selector("#plots-trouble:not([hidden])")
        assert "'nothing' is no variable" in (page.text_content("#plots-trouble") or "")
        assert watched.wrong == []


JOINED = """() => {
    const join = uPlot.join;
    uPlot.join = (tables) => {
        if (tables.some((one) => one[1].length)) globalThis.joined = tables;
        return join(tables);
    };
}"""


@needs_chromium
def test_samples_that_are_told_again_are_drawn_once(chromium):
    live = watched_now()
    with live.plots.opened(["roll_rate"]), Server(live) as server:  # another page plots it all the time
        watched = Watched(chromium)
        page = watched.page
        watched.open(server.address, "#/plots/roll_rate")
        page.wait_for_selector('[data-plot="roll_rate"] canvas')
        page.evaluate(JOINED)
        now_ns = live.snapshot.t_ns
        for number in range(40):
            at_ns = now_ns - (40 - number) * PERIOD_NS
            live.plots.take(live.plots.picked([LoggedFrame(at_ns, "can0", frame(number / 4, number))]))
        watched.until("document.querySelector('[data-line=imu_driver_1] .number').textContent === '9.75 deg/s'")
        page.select_option("#plots-add", "altitude")  # the stream is opened anew, for both
        page.wait_for_selector('[data-plot="altitude"] canvas')
        live.plots.take(live.plots.picked([LoggedFrame(now_ns, "can0", frame(10, 40))]))
        watched.until("document.querySelector('[data-line=imu_driver_1] .number').textContent === '10 deg/s'")
        watched.until("globalThis.joined.some((one) => one[1].includes(10))")
        times, values = page.evaluate("joined.find((one) => one[1].includes(10))")[:2]
        assert values == [number / 4 for number in range(41)]
        assert times == sorted(set(times))
        assert watched.wrong == []


@needs_chromium
def test_a_library_that_does_not_come_is_told_and_asked_for_again(chromium):
    with Server(watched_now()) as server:
        watched = Watched(chromium)
        page = watched.page
        page.route("**/uPlot.iife.min.js", lambda route: route.abort())
        watched.open(server.address, "#/plots/roll_rate")
        watched.until("document.querySelector('#plots-trouble').textContent.includes('the library of the plots')")
        assert [one for one in watched.wrong if "Failed to load resource" not in one] == []
        page.unroute("**/uPlot.iife.min.js")
        page.click('[aria-label="Close the plot of roll_rate"]')
        page.select_option("#plots-add", "roll_rate")
        page.wait_for_selector('[data-plot="roll_rate"] canvas')
