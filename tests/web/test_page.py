"""The page in Debian's Chromium, on a recorded flight of big_blue."""

import json
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from axe_playwright_python.sync_playwright import Axe

from heronry_manager.shell.control_protocol import Answer
from heronry_tools.watch.reducer import Reducer
from heronry_tools.web.desk import Desk
from heronry_tools.web.live import Live
from heronry_tools.web.orders import Orders
from web.browser import PICTURES, Server, Watched, browser, needs_chromium, recorded
from web.flight import big_blue, flown

pytestmark = needs_chromium

PANELS = ("graph", "timeline", "buses", "events", "what-if")


@pytest.fixture(scope="module")
def chromium():
    with browser() as opened:
        yield opened


def function_state(one):
    if not one["wanted"] or one["served"] is None:
        return "idle"
    return "lost" if not one["served"] else "degraded" if one["degraded"] else "served"


def expect_panels_to_show(watched, snapshot):
    """Every panel shows what the snapshot says."""
    page = watched.page
    functions = {name: function_state(one) for name, one in snapshot["functions"].items()}
    assert watched.attributes("#functions [data-function]", "function", "state") == functions
    standings = {name: one["standing"] for name, one in snapshot["pes"].items()}
    assert watched.attributes("#pes [data-pe]", "pe", "standing") == standings
    for name, one in snapshot["pes"].items():
        shown = page.text_content(f'#pes [data-pe="{name}"] .modules') or ""
        assert all(module in shown for module in one["modules"])
    watched.panel("graph")
    watched.until("document.querySelectorAll('#symbols tr').length > 0")
    assert watched.colours() == snapshot["graph"]["nodes"]
    assert watched.attributes("#symbols tr", "symbol", "state") == snapshot["graph"]["nodes"]
    watched.panel("timeline")
    entries = page.locator("#reconfigurations li")
    assert entries.count() == len(snapshot["reconfigurations"])
    if snapshot["reconfigurations"]:
        last = snapshot["reconfigurations"][-1]
        shown = page.text_content("#reconfiguration") or ""
        assert f"epoch {last['epoch']}" in shown
        assert all(cause in shown for cause in last["causes"])
        assert all(f"no longer served: {name}" in shown for name in last["lost"])
        for step in ("detect", "decide", "distribute", "activate"):
            ms = last["times_ns"][step] / 1e6
            assert f"{ms:.{1 if ms < 100 else 0}f} ms" == page.text_content(f'#reconfiguration [data-step="{step}"]')
    watched.panel("buses")
    for name, bus in snapshot["buses"].items():
        if bus["load"] is not None:
            assert f"load {100 * bus['load']:.1f} %" in page.text_content(f'#buses [data-bus="{name}"]')
    watched.panel("events")
    told = [one["number"] for one in snapshot["told"] if one["severity"] != "detail"]
    numbers = page.eval_on_selector_all("#events tr", "(rows) => rows.map((row) => Number(row.dataset.number))")
    assert numbers == told[::-1]
    faults = page.eval_on_selector_all("#faults .fault", "(all) => all.map((one) => one.dataset.fault)")
    assert sorted(faults) == sorted(fault["element"] for fault in snapshot["faults"])


def step(watched):
    """Go to the next reconfiguration, and wait until it is shown."""
    before = watched.page.evaluate("heronry.store.at_ns")
    watched.page.click("#replay-next")
    watched.until(f"heronry.store.at_ns > {before}")
    watched.page.wait_for_timeout(100)


def take_picture(watched):
    """The picture of README and docs/web.md."""
    watched.page.select_option("#graph-function", "guidance")
    watched.page.wait_for_selector('#graph svg[aria-label*="guidance"]')
    watched.page.evaluate("scrollTo(0, 0)")
    watched.page.wait_for_timeout(200)
    PICTURES.mkdir(parents=True, exist_ok=True)
    watched.page.screenshot(path=PICTURES / "web.png")


def expect_axe_to_find_nothing(watched, where):
    found = Axe().run(watched.page).response["violations"]
    told = [(one["id"], [node["html"][:160] for node in one["nodes"]][:3]) for one in found]
    assert not told, f"{where}: {json.dumps(told, indent=1)}"


def test_a_recorded_flight_in_the_browser(chromium):
    with Server(recorded()) as server:
        watched = Watched(chromium)
        watched.open(server.address)
        watched.page.wait_for_selector("#graph .node")
        places = watched.places()
        for _ in range(3):
            step(watched)
            shown = watched.known()
            expect_panels_to_show(watched, shown)
            truth = server.site.shown
            at_ns = watched.page.evaluate("heronry.store.at_ns")
            exact = truth.after(truth.events_until(round(at_ns))).snapshot
            assert (shown["epoch"], shown["events"]) == (exact.epoch, exact.events)
        watched.panel("graph")
        assert watched.places() == places
        step(watched)
        take_picture(watched)
        for panel in PANELS[:4]:
            watched.panel(panel)
            expect_axe_to_find_nothing(watched, panel)
        assert all(url.startswith((server.address, "data:")) for url in watched.asked)
        assert watched.wrong == []
        server.stop()
        watched.page.wait_for_selector("#stale:not([hidden])", timeout=8000)
        assert "STALE" in (watched.page.text_content("#stale") or "")


@dataclass(frozen=True)
class Noted(Orders):
    """Orders that are only noted."""

    given: list = field(default_factory=list)

    async def give(self, order):
        self.given.append(order)
        return Answer(done=True, sentence="the order is noted")


def watched_now(events=None):
    live = Live(Reducer(big_blue()), "manager")
    live.take_all(flown() if events is None else events, None, is_alive=True)
    return live


@pytest.mark.soak
def test_an_order_is_given_only_after_what_it_costs_is_named(chromium):
    given = []
    with Server(watched_now(), operates=True, orders=Noted(Path("none.sock"), None, given)) as server:
        watched = Watched(chromium)
        watched.open(server.access.url(with_token=True))
        assert server.access.token not in watched.page.url
        watched.page.click('#pes [data-pe="air"] header button')
        watched.page.click('#details [data-order="fail pe:air"]')
        watched.page.wait_for_selector("#confirm .lost-list li, #confirm p:not([class])", timeout=60_000)
        expect_axe_to_find_nothing(watched, "the question before an order")
        lost = watched.page.eval_on_selector_all("#confirm .lost-list b", "(all) => all.map((one) => one.textContent)")
        plan = Desk(big_blue()).answer({"ask": "plan", "down": [*watched.known()["down"], "pe:air"], "phase": "glide"})
        served = {name for name, one in watched.known()["functions"].items() if one["served"]}
        assert sorted(lost) == sorted(name for name in served if not plan["plan"]["functions"][name]["served"])
        assert given == []
        watched.page.click("#confirm button.grave")
        watched.page.wait_for_selector("#note:not([hidden])")
        assert given == [{"do": "fail", "what": "pe:air"}]
        assert watched.wrong == []


@pytest.mark.soak
def test_what_if_shows_what_the_planner_says(chromium):
    with Server(watched_now()) as server:
        watched = Watched(chromium)
        watched.open(server.address)
        watched.panel("what-if")
        for down in (["pe:flight"], ["pe:flight", "pe:comms"], []):
            watched.page.click("text=Nothing down")
            for element in down:
                watched.page.check(f'#what-if-form input[value="{element}"]')
            watched.page.select_option("#what-if-phase", "glide")
            expected = Desk(big_blue()).answer({"ask": "plan", "down": down, "phase": "glide"})
            text = json.dumps(sorted(down))
            shown = f"""(() => {{
                const table = document.querySelector("#what-if-answer:not(.busy) [data-plan]");
                return table && JSON.stringify(JSON.parse(table.dataset.plan).down) === {json.dumps(text)}
                    .replaceAll(", ", ",");
            }})()"""
            watched.until(shown, 60)
            table = watched.page.get_attribute("#what-if-answer [data-plan]", "data-plan")
            assert json.loads(table) == json.loads(json.dumps(expected["plan"]))


@pytest.mark.soak
def test_the_graph_is_walked_with_the_keyboard(chromium):
    with Server(watched_now()) as server:
        watched = Watched(chromium)
        watched.open(server.address)
        watched.page.wait_for_selector("#graph .node")
        watched.page.eval_on_selector('#graph .node[tabindex="0"]', "(one) => one.focus()")
        first = watched.page.evaluate("document.activeElement.dataset.key")
        watched.page.keyboard.press("ArrowDown")
        second = watched.page.evaluate("document.activeElement.dataset.key")
        assert first != second
        watched.page.keyboard.press("Enter")
        watched.page.wait_for_selector("#details:not([hidden])")
        assert second.partition(":")[2] in (watched.page.text_content("#details-title") or "")
        watched.page.keyboard.press("Escape")
        watched.page.wait_for_selector("#details", state="hidden")
        assert watched.page.evaluate("document.activeElement.dataset.key") == second


@pytest.mark.soak
def test_a_hundred_reconfigurations_move_nothing(chromium):
    live = watched_now([])
    with Server(live) as server:
        watched = Watched(chromium)
        watched.open(server.address)
        watched.page.wait_for_selector("#graph .node")
        places = watched.places()
        for _ in range(25):
            live.take_all(flown(), None, is_alive=True)
            watched.page.wait_for_timeout(150)
        watched.until(f"heronry.store.snapshot.events === {live.snapshot.events}")
        assert len(live.snapshot.reconfigurations) == 100
        assert watched.places() == places


@pytest.mark.soak
def test_the_page_at_every_size_in_light_and_dark(chromium):
    PICTURES.mkdir(parents=True, exist_ok=True)
    with Server(recorded()) as server:
        for width in (390, 1280, 1920):
            for scheme in ("light", "dark"):
                watched = Watched(chromium, width, scheme)
                watched.open(server.address)
                for _ in range(2):
                    step(watched)
                for panel in PANELS:
                    watched.panel(panel)
                    if panel == "what-if":
                        watched.page.wait_for_selector("#what-if-answer [data-plan]", timeout=60_000)
                    expect_axe_to_find_nothing(watched, f"{panel} at {width}, {scheme}")
                    overflow = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
                    assert watched.page.evaluate(overflow) <= 0
                    watched.page.screenshot(path=PICTURES / f"{panel}-{width}-{scheme}.png")
                assert watched.wrong == []
                watched.page.close()
