"""The addresses of the web application, asked as a browser would, and as another site would."""

import asyncio
import json
from pathlib import Path

import pytest
from starlette.testclient import TestClient

from heronry_dg.loader import load
from heronry_dg.shipped import shipped_spec_path
from heronry_manager.core.vocabulary import (
    ClearElement,
    EnterPhase,
    FailElement,
    ReleaseTarget,
    RestoreElement,
    RetireElement,
    SetPriority,
    UnlockPe,
)
from heronry_manager.events.reading import events_in
from heronry_manager.shell.control_protocol import ORDER_NAMES, Answer, FlyScript
from heronry_tools.watch import orders
from heronry_tools.watch.orders import Orders
from heronry_tools.watch.reducer import Reducer
from heronry_tools.web.app import Site, application
from heronry_tools.web.guard import HEADERS, Access
from heronry_tools.web.live import Live
from heronry_tools.web.questions import Questions
from heronry_tools.web.recording import Recording
from heronry_tools.web.stream import live_stream
from heronry_wire.frame import Frame, LoggedFrame, format_log_line
from tools.test_process_orders import Demo
from web.flight import big_blue, flown

TOKEN = "t0ken"
ORIGIN = "http://127.0.0.1:8321"
ORDER = {"authorization": f"Bearer {TOKEN}", "origin": ORIGIN}


def live_site(**changes):
    live = Live(Reducer(big_blue()), "manager")
    for event in flown():
        live.take(event)
    given = {"orders": Orders(None), "access": Access("127.0.0.1", 8321, TOKEN), **changes}
    return Site(big_blue(), live, Questions(big_blue(), shipped_spec_path("big_blue")), **given)


def client(site):
    return TestClient(application(site), base_url=ORIGIN)


@pytest.fixture(scope="module")
def reading():
    with client(live_site()) as asking:
        yield asking


def test_the_page_and_its_parts_are_there_with_all_security_headers(reading):
    page = reading.get("/")
    assert "heronry" in page.text
    for name, value in HEADERS.items():
        assert page.headers[name] == value
    for part in ("main.js", "page.css", "colours.css", "icon.svg"):
        assert reading.get(f"/page/{part}").status_code == 200
    assert reading.get("/page/../app.py").status_code == 404


def test_the_page_has_no_style_or_script_in_its_text(reading):
    text = reading.get("/").text
    assert " style=" not in text
    assert "<script>" not in text
    assert " onclick" not in text


def test_facts_name_everything_that_a_page_lists(reading):
    facts = reading.get("/api/facts").json()
    spec = big_blue()
    assert facts["phases"] == list(spec.phases)
    assert set(facts["modules"]) == set(spec.modules)
    assert facts["orders"] == {}
    assert not facts["recorded"]
    assert facts["modules"]["pressure_voter"]["modes"][0]["needs"] == "2 of (pressure_1, pressure_2, pressure_3)"
    keys = {symbol["key"] for symbol in facts["symbols"]}
    assert keys == set(reading.get("/api/snapshot").json()["graph"]["nodes"])
    assert all(keys >= set(some) for some in facts["contributing"].values())


def test_a_drawing_has_every_symbol_and_edge_of_the_snapshot(reading):
    drawing, graph = reading.get("/api/graph").text, reading.get("/api/snapshot").json()["graph"]
    for key in graph["nodes"]:
        assert f'data-key="{key}"' in drawing
    named = set(" ".join(part.split('"')[0] for part in drawing.split('data-edges="')[1:]).replace("&gt;", ">").split())
    assert named == set(graph["edges"])
    assert reading.get("/api/graph", params={"function": "elevator"}).text != drawing
    assert reading.get("/api/graph", params={"function": "flaps"}).status_code == 404


def test_the_events_are_a_file_of_lines(reading):
    file = reading.get("/api/events.jsonl")
    assert "attachment" in file.headers["content-disposition"]
    kinds = [one.kind for one in events_in(file.text.splitlines())]
    assert "reconfigured" in kinds
    assert "bus_seen" not in kinds


def test_frames_are_given_where_they_are_recorded(reading):
    assert "heronry record" in reading.get("/api/flight.log").json()["sentence"]
    frame = LoggedFrame(1_000_000, "can0", Frame(0x7FE, b"\x00"))
    with client(live_site(frames=[frame])) as asking:
        assert asking.get("/api/flight.log").text == f"{format_log_line(frame)}\n"
        assert asking.get("/api/facts").json()["has_frames"]


def test_a_recording_gives_any_moment():
    recording = Recording(Reducer(big_blue()), flown(), "log")
    site = live_site()
    site.shown = recording
    with client(site) as asking:
        early = asking.get("/api/snapshot", params={"at_ns": recording.marks[0]["t_ns"]}).json()
        assert early["epoch"] == recording.marks[0]["epoch"]
        assert asking.get("/api/snapshot", params={"at_ns": "soon"}).json()["events"] == len(flown())
        assert asking.get("/api/snapshot", params={"at_ns": "nan"}).json()["events"] == len(flown())
        assert asking.get("/api/facts").json()["recorded"]


def test_a_change_of_the_spec_ends_each_stream_with_the_whole_and_changes_what_pages_get():
    file = shipped_spec_path("elevator_and_chute")
    other, site = load(file), live_site()
    drawing = site.picture("")

    async def last():
        stream = live_stream(site.shown, asyncio.Event())
        await anext(stream)
        site.change_to(other, file)
        return [one async for one in stream]

    *_, whole = asyncio.run(last())
    assert whole.startswith("event: whole")
    assert json.loads(whole.split("data: ")[1])["snapshot"]["spec_digest"] == other.digest
    assert (site.facts["digest"], list(site.facts["pes"])) == (other.digest, list(other.pes))
    assert site.picture("") != drawing
    with client(site) as asking:
        answer = asking.post("/api/ask", json={"ask": "plan", "down": []}, headers={"origin": ORIGIN}).json()
        assert set(answer["plan"]["modules"]) <= set(other.modules)


def test_another_site_learns_and_orders_nothing(reading):
    assert reading.get("/api/snapshot", headers={"origin": "http://evil.example"}).status_code == 403
    assert reading.get("/api/snapshot", headers={"host": "evil.example:8321"}).status_code == 403
    refused = reading.post("/api/order", json={"do": "fail", "what": "pe:nav"}, headers=ORDER)
    assert refused.status_code == 403
    assert "--operate" in refused.json()["sentence"]
    assert "access-control-allow-origin" not in reading.get("/api/snapshot", headers={"origin": ORIGIN}).headers


def operated(orders):
    return client(live_site(orders=orders, access=Access("127.0.0.1", 8321, TOKEN, operates=True)))


def test_orders_of_a_demo_reach_it(tmp_path):
    manager = tmp_path / "some.sock"
    demo = Demo(manager)
    with demo.looping(), operated(Orders(manager)) as asking:
        assert asking.get("/api/facts").json()["orders"].keys() >= {"kill", "start", "fail"}
        for do, sentence in (("kill", "pe:left: kill"), ("start", "pe:left: restore")):
            answer = asking.post("/api/order", json={"do": do, "what": "pe:left"}, headers=ORDER).json()
            assert answer == {"done": True, "sentence": sentence}
    assert demo.done == [("kill", "left"), ("restore", "left")]


def test_a_demo_that_has_ended_is_told(tmp_path):
    with operated(Orders(tmp_path / "some.sock")) as asking:
        assert "kill" not in asking.get("/api/facts").json()["orders"]
        answer = asking.post("/api/order", json={"do": "kill", "what": "pe:nav"}, headers=ORDER).json()
    assert not answer["done"]
    assert "has it ended?" in answer["sentence"]


def test_an_order_to_a_manager_that_is_not_there_is_answered(tmp_path):
    with operated(Orders(tmp_path / "none.sock")) as asking:
        answer = asking.post("/api/order", json={"do": "fail", "what": "pe:nav"}, headers=ORDER).json()
        assert not answer["done"]
        assert "no manager listens" in answer["sentence"]
        unknown = asking.post("/api/order", json={"do": "land", "what": "pe:nav"}, headers=ORDER).json()
        assert ", ".join(ORDER_NAMES) in unknown["sentence"]
        for body in ("[1]", "{", "null"):
            head = {**ORDER, "content-type": "application/json"}
            assert not asking.post("/api/order", content=body, headers=head).json()["done"]


EACH_ORDER = (
    (EnterPhase("glide"), {"do": "phase", "what": "glide"}),
    (FailElement("pe:nav"), {"do": "fail", "what": "pe:nav"}),
    (ClearElement("pe:nav"), {"do": "clear", "what": "pe:nav"}),
    (SetPriority("imaging", 90), {"do": "priority", "what": "imaging", "to": 90}),
    (SetPriority("imaging", None), {"do": "priority", "what": "imaging", "to": None}),
    (RetireElement("pe:nav"), {"do": "retire", "what": "pe:nav"}),
    (RestoreElement("pe:nav"), {"do": "restore", "what": "pe:nav"}),
    (UnlockPe("pe:nav"), {"do": "unlock", "what": "pe:nav"}),
    (FlyScript("G.PruneEdges ();"), {"do": "script", "what": "G.PruneEdges ();"}),
    (ReleaseTarget(), {"do": "release"}),
)


def test_each_order_reaches_the_manager_as_it_was_given(monkeypatch, tmp_path):
    got = []
    monkeypatch.setattr(orders, "call", lambda _, order: got.append(order) or Answer(done=True, sentence="done"))
    monkeypatch.setattr(orders, "standby_of", lambda path: path)
    with operated(Orders(tmp_path / "some.sock")) as asking:
        for _, order in EACH_ORDER:
            assert asking.post("/api/order", json=order, headers=ORDER).json()["done"]
        assert got == [order for order, _ in EACH_ORDER]
        for none in ({"do": "priority", "what": "imaging"}, {"do": "follow"}, {"do": "status"}, {"do": "script"}):
            assert not asking.post("/api/order", json=none, headers=ORDER).json()["done"]
        assert len(got) == len(EACH_ORDER)


@pytest.mark.parametrize("order", [order for _, order in EACH_ORDER], ids=lambda order: order["do"])
def test_no_order_is_taken_without_token_or_from_another_site(order):
    with operated(Orders(Path("none.sock"))) as asking:
        for wrong, code in (
            ({"authorization": ""}, 401),
            ({"authorization": "Bearer another"}, 401),
            ({"origin": "http://evil.example"}, 403),
            ({"host": "evil.example:8321"}, 403),
        ):
            assert asking.post("/api/order", json=order, headers={**ORDER, **wrong}).status_code == code
    with client(live_site(orders=Orders(Path("none.sock")))) as asking:
        assert asking.post("/api/order", json=order, headers=ORDER).status_code == 403


def test_a_question_that_is_none_is_refused(reading):
    head = {"origin": ORIGIN, "content-type": "application/json"}
    assert reading.post("/api/ask", content="[]", headers=head).status_code == 400
    assert reading.post("/api/ask", content='{"a": "' + "x" * 70_000 + '"}', headers=head).status_code == 400


def test_the_stream_of_a_live_system_tells_what_comes_and_when_nothing_does():
    async def read():
        live, closing = Live(Reducer(big_blue()), "manager"), asyncio.Event()
        stream = live_stream(live, closing)
        found = [await anext(stream), await anext(stream)]
        for event in flown()[:40]:
            live.take(event)
        found.append(await anext(stream))
        live.waits("the manager has ended")
        found.append(await anext(stream))
        closing.set()
        return [*found, *[one async for one in stream]], live

    found, live = asyncio.run(read())
    assert [one.split("\n")[0] for one in found] == ["event: whole", "event: beat", "event: change", "event: beat"]
    assert json.loads(found[2].split("data: ")[1])["set"]["events"] == live.snapshot.events == 40
    assert "the manager has ended" in found[3]


def test_an_event_right_after_a_change_is_sent_at_once_and_not_when_the_next_one_comes():
    async def read():
        live, events = Live(Reducer(big_blue()), "manager"), flown()
        stream = live_stream(live, asyncio.Event())
        found = [await anext(stream), await anext(stream)]
        for event in events[:2]:
            live.take(event)
            async with asyncio.timeout(0.5):  # the next beat is due in a second
                found.append(await anext(stream))
        return found

    assert [one.split("\n")[0] for one in asyncio.run(read())[2:]] == ["event: change", "event: change"]


@pytest.mark.parametrize(
    "body",
    [
        b'{"ask": "why", "function": "\\ud800"}',
        b'{"ask": "plan", "down": [NaN]}',
        b'{"ask": "plan", "phase": ' + b"[" * 30_000,
        b'{"ask": "plan", "down": [' + b"9" * 5000 + b"]}",
        b"\xff\xfe",
        b"[]",
    ],
    ids=["half a character", "no number", "deep", "long number", "no text", "a list"],
)
def test_a_body_that_is_no_question_is_refused_in_a_sentence(reading, body):
    told = reading.post("/api/ask", content=body, headers={"origin": ORIGIN, "content-type": "application/json"})
    assert told.status_code == 400
    assert told.json()["sentence"] == "the body of a question must be a JSON object"
