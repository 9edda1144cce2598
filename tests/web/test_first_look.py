"""What a user sees first, on a desk and on a phone: the graph, what is lost and why; legible, and without a click."""

import pytest

from heronry_manager.events import Adopted
from heronry_tools.fly.report.axes import picture
from heronry_tools.fly.report.flight_page import page
from tools.test_process_orders import Demo
from web.browser import Server, Watched, browser, needs_chromium
from web.flight import big_blue, three_lost
from web.test_page import PANELS, Noted, expect_axe_to_find_nothing, watched_now

pytestmark = needs_chromium

DESK, PHONE = 1280, 390
LEAST_PX = 11
HIGHEST_PX = 300

SIDEWAYS = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
SMALL_TEXTS = """(least) => {
    const found = [];
    const walk = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
    for (let text = walk.nextNode(); text; text = walk.nextNode()) {
        const one = text.parentElement;
        if (!text.data.trim() || !one.checkVisibility() || one.closest(".hidden-title, option, script")) continue;
        const scale = one instanceof SVGElement && one.getScreenCTM ? one.getScreenCTM().a : 1;
        if (parseFloat(getComputedStyle(one).fontSize) * scale < least - 0.01) found.push(text.data.trim());
    }
    return found;
}"""


@pytest.fixture(scope="module")
def chromium():
    with browser() as opened:
        yield opened


@pytest.fixture(scope="module")
def server():
    with Server(watched_now(three_lost())) as running:
        yield running


def opened(chromium, server, width, scheme="light"):
    watched = Watched(chromium, width, scheme)
    watched.open(server.address)
    watched.page.wait_for_selector("#graph .folded .box")
    return watched


def expect_legible(watched, where):
    assert watched.page.evaluate(SIDEWAYS) <= 0, where
    assert watched.page.evaluate(SMALL_TEXTS, LEAST_PX) == [], where
    expect_axe_to_find_nothing(watched, where)


def graph_top(watched):
    """Where the graph begins, below the warning that nothing comes any more."""
    watched.page.wait_for_selector("#stale:not([hidden])", timeout=20_000)
    return watched.page.evaluate("document.getElementById('graph').getBoundingClientRect().top")


def in_sight(watched, selector):
    """Whether an element with all its text is in the window, and in the graph's own part of it."""
    script = """(one) => {
        const inside = (box, room) => box.top >= room.top && box.bottom <= room.bottom
            && box.left >= room.left - 1 && box.right <= room.right + 1;
        const box = one.getBoundingClientRect();
        return inside(box, document.getElementById("graph").getBoundingClientRect())
            && box.bottom <= innerHeight && one.scrollHeight <= one.clientHeight + 1;
    }"""
    return watched.page.eval_on_selector(selector, script)


def test_what_is_lost_and_why_is_read_without_a_click_and_everything_is_legible(chromium, server):
    desk = opened(chromium, server, DESK)
    functions = desk.known()["functions"]
    lost = {name: one["why_not"] for name, one in functions.items() if one["wanted"] and not one["served"]}
    assert lost
    assert sum(pe["standing"] == "down" for pe in desk.known()["pes"].values()) == 3
    assert graph_top(desk) < HIGHEST_PX
    for name, why in lost.items():
        box = f'#graph [data-fold="function:{name}"][data-state="lost"]'
        assert why in (desk.page.text_content(box) or "")
        assert in_sight(desk, box)
    for pe in ("nav", "air", "flight"):
        assert in_sight(desk, f'#graph [data-fold="pe:{pe}"]')
    expect_legible(desk, "the graph on a desk")
    phone = opened(chromium, server, PHONE)
    assert graph_top(phone) < HIGHEST_PX
    expect_legible(phone, "the graph on a phone")
    for name in functions:
        if not phone.page.is_visible(f'#functions.open [data-function="{name}"]'):
            phone.page.click("#functions-more")
        phone.page.click(f'#functions [data-function="{name}"]')
        assert name in (phone.page.text_content("#details-title") or "")
        phone.page.keyboard.press("Escape")
        phone.page.click("#functions-more")
    assert desk.wrong == phone.wrong == []


def test_a_function_is_degraded_when_something_upstream_of_its_output_is(chromium, server):
    desk = opened(chromium, server, DESK)
    upstream = {
        name: one["shortfalls"][0]
        for name, one in desk.known()["functions"].items()
        if one["served"] and one["shortfalls"] and not one["degraded"]
    }
    assert upstream
    for name, what in upstream.items():
        assert desk.attributes("#functions [data-function]", "function", "state")[name] == "degraded"
        assert what in (desk.page.text_content(f'#graph [data-fold="function:{name}"]') or "")


@pytest.mark.soak
def test_one_function_opens_its_graph_and_fit_shows_all_of_it(chromium, server):
    for width in (DESK, PHONE):
        watched = opened(chromium, server, width)
        for name in big_blue().functions:
            watched.page.select_option("#graph-function", name)
            watched.page.wait_for_selector(f'#graph .folded[aria-label="What contributes to {name}"] .box')
            modules = set(watched.attributes('#graph [data-fold^="module:"]', "fold", "state"))
            known = watched.page.evaluate("(name) => heronry.store.facts.contributing[name]", name)
            assert modules == {key for key in known if key.startswith("module:")}
            room = "(one) => one.scrollWidth - one.clientWidth"
            assert watched.page.eval_on_selector("#graph", room) <= 1
        watched.page.click("#graph-fit")
        assert watched.page.eval_on_selector("#graph", "(one) => one.scrollHeight - one.clientHeight") <= 2
        watched.every_symbol()
        assert watched.page.evaluate(SMALL_TEXTS, LEAST_PX) == []
        watched.page.click("#graph-fit")
        over = "(one) => [one.scrollWidth - one.clientWidth, one.scrollHeight - one.clientHeight]"
        assert max(watched.page.eval_on_selector("#graph", over)) <= 2
        assert watched.wrong == []


@pytest.mark.soak
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [DESK, PHONE])
def test_every_panel_is_legible(chromium, server, width, scheme):
    watched = opened(chromium, server, width, scheme)
    for panel in PANELS:
        watched.panel(panel)
        if panel == "what-if":
            watched.page.wait_for_selector("#what-if-answer [data-plan]", timeout=60_000)
            then = watched.attributes("#what-if-answer [data-what-if]", "whatIf", "state")
            assert (then["experiment"], then["parachute"], then["pilot_view"]) == ("lost", "degraded", "idle")
            assert "runs without" in (watched.page.text_content('#what-if-answer [data-what-if="parachute"]') or "")
        expect_legible(watched, f"{panel} at {width}, {scheme}")


def test_only_orders_that_can_be_given_now_are_offered_and_an_adopted_epoch_is_listed(chromium, tmp_path):
    live = watched_now(three_lost())
    live.take_all([Adopted(live.snapshot.t_ns, epoch=77, digest="0000AB")], None, is_alive=True)
    manager = tmp_path / "none.sock"
    with Demo(manager).looping(), Server(live, operates=True, orders=Noted(manager)) as running:
        watched = Watched(chromium, DESK)
        watched.open(running.access.url(with_token=True))
        for pe, one in watched.known()["pes"].items():
            offered = [
                order for order in ("kill", "start") if watched.page.query_selector(f'[data-order="{order} pe:{pe}"]')
            ]
            assert offered == ["start" if one["standing"] == "down" else "kill"], pe
        watched.page.click('#pes [data-pe="nav"] header button')
        watched.page.wait_for_selector("#details:not([hidden]) dl")
        shown = watched.page.text_content("#details") or ""
        assert " ago" in shown
        assert watched.page.eval_on_selector("#details dd", "(one) => one.clientWidth") > 100  # beside long names
        start = watched.page.locator("#pes").get_by_role("button", name="Start pe:nav again")
        assert start.text_content() == "Start"
        assert start.evaluate("(one) => getComputedStyle(one).borderTopStyle") == "solid"  # it looks like a button
        assert watched.page.query_selector('#details [data-order="clear pe:nav"]') is None
        assert watched.page.query_selector('#details [data-order="retire pe:nav"]') is None  # it does not work
        assert watched.page.query_selector('#details [data-order="unlock pe:nav"]') is None  # nothing has a key
        expect_axe_to_find_nothing(watched, "a PE with its orders")
        watched.panel("timeline")
        watched.page.wait_for_selector("#reconfigurations li")
        assert "Epoch 77" in (watched.page.text_content("#reconfigurations li") or "")
        assert watched.page.query_selector("#reconfiguration .lanes") is None
        assert watched.wrong == []


def test_the_report_of_a_flight_fits_a_phone(chromium, tmp_path):
    file = tmp_path / "landing.html"
    file.write_text(
        page("A flight", ["<h1>A flight</h1>", picture(200, "Ground track", ['<text x="9" y="20">N</text>'])])
    )
    watched = Watched(chromium, PHONE)
    watched.page.goto(file.as_uri())
    assert watched.page.evaluate(SIDEWAYS) <= 0
    assert watched.page.evaluate("innerWidth") == PHONE
    assert watched.page.evaluate(SMALL_TEXTS, LEAST_PX) == []


def test_two_fingers_change_the_size_of_the_graph_and_one_scrolls_it(chromium, server):
    phone = opened(chromium, server, PHONE)
    touch = phone.page.context.new_cdp_session(phone.page)
    touch.send("Emulation.setTouchEmulationEnabled", {"enabled": True, "maxTouchPoints": 2})
    box = phone.page.eval_on_selector(
        "#graph", "(one) => { const at = one.getBoundingClientRect(); return [at.x, at.y]; }"
    )
    x, y = box[0] + 150, box[1] + 150

    def fingers(kind, *places):
        points = [{"x": one, "y": two, "id": number} for number, (one, two) in enumerate(places)]
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    def size():
        return float(phone.page.eval_on_selector("#graph .folded", "(one) => one.style.zoom"))

    def pinch(begin, end):
        fingers("touchStart", (x - begin, y), (x + begin, y))
        for step in range(1, 11):
            apart = begin + (end - begin) * step / 10
            fingers("touchMove", (x - apart, y), (x + apart, y))
        fingers("touchEnd")

    assert size() == 1
    pinch(30, 90)
    assert size() == pytest.approx(3, rel=0.15)
    pinch(90, 45)
    assert size() == pytest.approx(1.5, rel=0.2)
    fingers("touchStart", (x, y + 100))
    for step in range(1, 11):
        fingers("touchMove", (x, y + 100 - 15 * step))
    fingers("touchEnd")
    phone.until("document.getElementById('graph').scrollTop > 50")
    assert size() == pytest.approx(1.5, rel=0.2)
    assert phone.wrong == []
