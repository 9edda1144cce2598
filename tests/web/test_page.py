"""The page in Debian's Chromium, on a recorded flight of big_blue."""

import json
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import pytest
from axe_playwright_python.sync_playwright import Axe

from heronry_dg.loader import load
from heronry_dg.plan import configuration_of
from heronry_dg.shipped import shipped_spec_path
from heronry_manager.core.intake import parts_of
from heronry_manager.events import (
    EpochPrepared,
    FaultCleared,
    FaultReported,
    ManagerStarted,
    PeJoined,
    PeLost,
    PhaseChanged,
    PlanReady,
    Reconfigured,
    ScriptTaken,
)
from heronry_manager.shell.control_protocol import Answer
from heronry_pcs.plan_script import module_graph
from heronry_pcs.script_difference import difference
from heronry_tools.sim.flight.simulation import Simulation
from heronry_tools.watch.orders import Orders
from heronry_tools.watch.reducer import Reducer
from heronry_tools.watch.snapshot import document
from heronry_tools.web.desk import Desk
from heronry_tools.web.live import Live
from lab.benches.screens import heap_bytes
from thoroughness import part_of, sample
from watch.flights import PICTURES
from watch.test_live_feeds import status_of_what_comes
from web.browser import Server, Watched, browser, needs_chromium, recorded
from web.flight import S, big_blue, flown
from web.test_desk import drawn, plan_command, printed

pytestmark = needs_chromium

CHANGING = (PlanReady, EpochPrepared, PeLost, PeJoined, PhaseChanged, Reconfigured)
PLANTS = """\
plants:
  elevator: {moved_by: [elevator_servo_1], seen_by: [elevator_angle_sensor], criticality: A}
"""
NEWEST = 40  # events that the page shows without a click
PANELS = ("graph", "timeline", "buses", "events", "plots", "what-if")


@pytest.fixture(scope="module")
def chromium():
    with browser() as opened:
        yield opened


def function_state(one):
    if not one["wanted"] or one["served"] is None:
        return "idle"
    return "lost" if not one["served"] else "degraded" if one["degraded"] or one["shortfalls"] else "served"


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
    of_rows = "(rows) => rows.map((row) => Number(row.dataset.number))"
    assert page.eval_on_selector_all("#events tr", of_rows) == told[::-1][:NEWEST]
    for count in range(NEWEST, len(told), NEWEST):
        page.click("#events-older")
        watched.until(f"document.querySelectorAll('#events tr').length === {min(count + NEWEST, len(told))}")
    assert page.eval_on_selector_all("#events tr", of_rows) == told[::-1]
    assert not page.is_visible("#events-older")
    faults = page.eval_on_selector_all("#faults .fault", "(all) => all.map((one) => one.dataset.fault)")
    assert sorted(faults) == sorted(fault["element"] for fault in snapshot["faults"])


def move_to(watched, share):
    """Move the slider to a share of the recording, and wait until that moment is shown."""
    moved = """(slider, share) => {
        slider.value = String(Math.round(1000 * share));
        slider.dispatchEvent(new Event("input"));
        const { first_ns, last_ns } = heronry.store.recording;
        return first_ns + ((last_ns - first_ns) * Number(slider.value)) / 1000;
    }"""
    at_ns = watched.page.eval_on_selector("#replay input", moved, share)
    watched.until(f"Math.abs(heronry.store.at_ns - {at_ns}) < 2")
    watched.drawn()


def step(watched):
    """Go to the next reconfiguration, and wait until it is shown."""
    before = watched.page.evaluate("heronry.store.at_ns")
    watched.page.click("#replay-next")
    watched.until(f"heronry.store.at_ns > {before}")
    watched.drawn()


def take_picture(watched):
    """The picture of README and docs/web.md."""
    watched.page.uncheck("#graph-symbols")
    watched.page.wait_for_selector("#graph .folded .box")
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
        watched.every_symbol()
        places = watched.places()
        steps = [step] * part_of(4, 2)
        moves = [partial(move_to, share=share) for share in sample((1, 0.3, 0.02, 0.9, 0.75, 0.2), 2)]
        for go in (*steps, *moves):
            go(watched)
            shown = watched.known()
            expect_panels_to_show(watched, shown)
            truth = server.site.shown
            at_ns = watched.page.evaluate("heronry.store.at_ns")
            exact = truth.after(truth.events_until(round(at_ns))).snapshot
            assert shown == json.loads(json.dumps(document(exact)))
        watched.panel("graph")
        assert watched.places() == places
        take_picture(watched)
        for panel in PANELS[:4]:
            watched.panel(panel)
            expect_axe_to_find_nothing(watched, panel)
        assert all(url.startswith((server.address, "data:")) for url in watched.asked)
        assert watched.wrong == []
        server.stop()
        watched.page.wait_for_selector("#stale:not([hidden])", timeout=30_000)
        assert "STALE" in (watched.page.text_content("#stale") or "")


@dataclass(frozen=True)
class Noted(Orders):
    """Orders that are only noted."""

    given: list = field(default_factory=list)

    def give(self, order):
        self.given.append(order)
        return Answer(done=True, sentence="the order is noted")


def watched_now(events=None):
    live = Live(Reducer(big_blue()), "manager")
    live.take_all(flown() if events is None else events, None, is_alive=True)
    return live


@pytest.mark.soak
def test_an_order_is_given_only_after_what_it_costs_is_named(chromium):
    given = []
    with Server(watched_now(), operates=True, orders=Noted(Path("none.sock"), given)) as server:
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
def test_what_if_shows_what_the_command_plans_for_thirty_sets_of_faults(chromium, capsys):
    with Server(watched_now()) as server:
        watched = Watched(chromium)
        watched.open(server.address)
        watched.panel("what-if")
        watched.page.eval_on_selector_all(
            "#what-if-form details", "(all) => all.forEach((one) => { one.open = true; })"
        )
        for down, phase in map(drawn, range(30)):
            watched.page.click("text=Nothing down")
            for element in down:
                watched.page.check(f'#what-if-form input[value="{element}"]')
            watched.page.select_option("#what-if-phase", phase)
            expected = printed(capsys, *plan_command(down, phase))
            shown = f"""(() => {{
                const table = document.querySelector("#what-if-answer:not(.busy) [data-plan]");
                const plan = table && JSON.parse(table.dataset.plan);
                return plan && [plan.phase, ...plan.down].join() === {json.dumps(",".join([phase, *sorted(down)]))};
            }})()"""
            watched.until(shown, 60)
            assert json.loads(watched.page.get_attribute("#what-if-answer [data-plan]", "data-plan")) == expected
            served = watched.attributes("#what-if-answer [data-what-if]", "whatIf", "served")
            assert served == {name: json.dumps(one["served"]) for name, one in expected["functions"].items()}
            parts = watched.page.eval_on_selector_all(
                "#what-if-answer .node.module:is(.served, .degraded)", "(all) => all.map((one) => one.dataset.key)"
            )
            assert set(parts) == {f"module:{name}" for name in expected["modules"]}
        assert watched.wrong == []


@pytest.mark.soak
def test_the_graph_is_walked_with_the_keyboard(chromium):
    with Server(watched_now()) as server:
        watched = Watched(chromium)
        watched.open(server.address)
        watched.every_symbol()
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


def test_reconfigurations_move_nothing_and_after_a_hundred_of_them_a_page_needs_no_more_memory(chromium):
    live = watched_now([])
    with Server(live) as server:
        watched = Watched(chromium)
        watched.open(server.address)
        watched.every_symbol()
        places, heaps = watched.places(), []
        changing = [one for one in flown() if isinstance(one, CHANGING)]
        for reconfigurations in (100, 140):
            while not live.snapshot.reconfigurations or live.snapshot.reconfigurations[-1].number < reconfigurations:
                live.take_all(changing, None, is_alive=True)
                watched.page.wait_for_timeout(40)
            watched.until(f"heronry.store.snapshot.events === {live.snapshot.events}")
            heaps.append(heap_bytes(watched.page))
        assert watched.places() == places
        assert heaps[1] <= 1.1 * heaps[0] + 500_000  # what the browser compiles meanwhile; soak watches it for long


def expect_order(watched, given, opener, order, words=None):
    """Press the opener of an order, confirm what it will cost, and see it given; tells what the question said."""
    watched.page.click(opener)
    if words is not None:
        watched.page.fill("#confirm textarea, #confirm input", words)
        watched.page.click("#confirm button[type=submit]")
    confirming = "#confirm .bar button:nth-child(2):not([disabled]):not([type=submit])"
    watched.page.wait_for_selector(confirming, timeout=60_000)
    said = watched.page.text_content("#confirm") or ""
    assert given == []
    expect_axe_to_find_nothing(watched, f"the question before {order}")
    watched.page.click(confirming)
    watched.page.wait_for_selector("#note:not([hidden])")
    assert given == [order]
    given.clear()
    return said


@pytest.mark.soak
def test_every_other_order_is_given_from_the_page(chromium):
    given = []
    keyed = (replace(one, key="A1B2C3") if isinstance(one, ManagerStarted) else one for one in flown())
    live = watched_now(list(keyed))
    with Server(live, operates=True, orders=Noted(Path("none.sock"), given)) as server:
        watched = Watched(chromium)
        watched.open(server.access.url(with_token=True))
        assert watched.page.is_hidden('[data-order="release"]')
        name = next(name for name, one in watched.known()["functions"].items() if one["served"])
        watched.page.click(f'#functions [data-function="{name}"]')
        priority = f'[data-order="priority {name}"]'
        said = expect_order(watched, given, priority, {"do": "priority", "what": name, "to": 0}, "0")
        assert f"{name} will be lost: its priority was changed to 0" in said
        watched.page.click(priority)
        watched.page.click("text=As in the spec")
        watched.page.click("text=Leave it")
        watched.page.click('#pes [data-pe="air"] header button')
        said = expect_order(watched, given, '[data-order="unlock pe:air"]', {"do": "unlock", "what": "pe:air"})
        assert "the planner cannot foresee that" in said
        said = expect_order(watched, given, '[data-order="retire pe:air"]', {"do": "retire", "what": "pe:air"})
        parts = parts_of(big_blue(), "pe:air")
        desk = Desk(big_blue()).answer(
            {"ask": "plan", "down": [*watched.known()["down"], *parts], "phase": watched.known()["phase"]}
        )
        served = (one for one, of in watched.known()["functions"].items() if of["served"])
        assert all(f"{one} will be lost" in said for one in served if not desk["plan"]["functions"][one]["served"])
        code = "OPERATOR"
        faults = [
            FaultReported(live.snapshot.t_ns, element=one, by="the operator", detail=0, code=code) for one in parts
        ]
        live.take_all(faults, None, is_alive=True)
        watched.page.wait_for_selector('[data-order="restore pe:air"]')
        expect_order(watched, given, '[data-order="restore pe:air"]', {"do": "restore", "what": "pe:air"})
        live.take_all(
            [FaultCleared(live.snapshot.t_ns, element=one, by="the operator") for one in parts], None, is_alive=True
        )
        watched.page.wait_for_selector('[data-order="restore pe:air"]', state="detached")
        running = {
            name: {"pe": one["pe"], "mode": one["mode"], "inputs": one["wires"]}
            for name, one in watched.known()["modules"].items()
            if one["pe"]
        }
        asked = {"ask": "plan", "down": watched.known()["down"], "phase": "glide", "priorities": [f"{name}=0"]}
        rest = Desk(big_blue()).answer(asked)["plan"]
        graphs = (module_graph(big_blue(), configuration_of(one)) for one in ({"modules": running}, rest))
        script = difference(*graphs).strip()
        order = {"do": "script", "what": script}
        assert f"{name} will be lost" in expect_order(watched, given, '[data-order="script"]', order, script)
        watched.page.click('[data-order="script"]')
        watched.page.fill("#order-script", "G.DeleteComponent ( nothing );")
        watched.page.click("#confirm button[type=submit]")
        watched.page.wait_for_selector("#confirm .why", timeout=60_000)
        assert "the script would be refused: line 1" in (watched.page.text_content("#confirm") or "")
        assert watched.page.is_disabled("#confirm .bar button:nth-child(2)")
        watched.page.click("text=Leave it")
        live.take_all([ScriptTaken(live.snapshot.t_ns, reason="it is not worse")], None, is_alive=True)
        watched.page.wait_for_selector('[data-order="release"]:not([hidden])')
        assert "No function will be lost" in expect_order(watched, given, '[data-order="release"]', {"do": "release"})
        assert watched.wrong == []


def test_what_is_coming_has_a_panel_with_tables_code_and_nodes_that_the_spec_does_not_have(chromium):
    live = Live(Reducer(big_blue()), "manager")
    with Server(live, spec=big_blue(), file=shipped_spec_path("big_blue")) as server:
        watched = Watched(chromium)
        watched.open(server.address)
        assert watched.page.is_hidden("#coming-section")
        live.take_all([status_of_what_comes()], None, is_alive=True)
        watched.until("document.querySelectorAll('#coming > li').length === 6")
        assert "50 %" in (watched.page.text_content('#coming [data-coming="flight"]') or "")
        assert "no bundle" in (watched.page.text_content('#coming [data-coming="comms"]') or "")
        shown = watched.page.text_content('#coming [data-stranger="101"]') or ""
        assert "arm64, 4 cores, 2 MiB of memory" in shown
        assert "heronry adopt big_blue 101" in shown
        expect_axe_to_find_nothing(watched, "coming")
        assert watched.wrong == []


def test_control_loops_have_a_panel_where_the_spec_has_plants(chromium, tmp_path):
    file = tmp_path / "elevator_and_chute.dg.yaml"
    file.write_text(shipped_spec_path("elevator_and_chute").read_text() + PLANTS)
    spec, live = load(file), Live(Reducer(load(file)), "manager")
    flight = Simulation(spec, 3)
    flight.run_until(2 * S)
    live.take_all(flight.events, None, is_alive=True)
    with Server(live, spec=spec, file=file) as server:
        watched = Watched(chromium)
        watched.open(server.address)
        shown = watched.page.text_content('#plants [data-plant="elevator"][data-loop="open"]') or ""
        assert "nothing leads from elevator_angle_sensor, which sees it, to elevator_servo_1" in shown
        flight.fleet.kill("tail_pe")
        flight.run_for(1 * S)
        live.take_all(flight.events[live.snapshot.events :], None, is_alive=True)
        watched.until("document.querySelector('#plants .why').textContent.includes('no module runs on any actuator')")
        expect_axe_to_find_nothing(watched, "control loops")
        assert watched.wrong == []


@pytest.mark.soak
def test_the_page_at_every_size_in_light_and_dark(chromium):
    PICTURES.mkdir(parents=True, exist_ok=True)
    with Server(recorded()) as server:
        for width in (390, 1280, 1920):
            for scheme in ("light", "dark"):
                watched = Watched(chromium, width, scheme)
                watched.open(server.address)
                for _ in range(4):  # until the navigation computer is lost in the glide
                    step(watched)
                for panel in PANELS:
                    watched.panel(panel)
                    if width < 500:
                        watched.page.eval_on_selector("#tabs", "(tabs) => scrollTo(0, tabs.offsetTop)")
                    if panel == "what-if":
                        watched.page.wait_for_selector("#what-if-answer [data-plan]", timeout=60_000)
                    expect_axe_to_find_nothing(watched, f"{panel} at {width}, {scheme}")
                    overflow = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
                    assert watched.page.evaluate(overflow) <= 0
                    watched.page.screenshot(path=PICTURES / f"{panel}-{width}-{scheme}.png")
                assert watched.wrong == []
                watched.page.close()
