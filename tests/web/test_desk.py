"""The planner's process gives what `heronry plan` and `heronry why` give, and a question that is stale ends it."""

import asyncio
import json
from random import Random

import pytest

from heronry_dg.loader import load
from heronry_dg.plan import configuration_of
from heronry_dg.shipped import shipped_spec_path
from heronry_dg.situation import elements
from heronry_pcs.plan_script import module_graph
from heronry_pcs.script_difference import difference
from heronry_tools.cli import main as heronry
from heronry_tools.web.desk import Desk
from heronry_tools.web.questions import Questions
from thoroughness import mostly_soak
from web.flight import big_blue


def printed(capsys, *words):
    assert heronry(list(words)) == 0
    return json.loads(capsys.readouterr().out)


def drawn(seed):
    random = Random(seed)
    down = random.sample(elements(big_blue()), random.randint(0, 3))
    return down, random.choice(list(big_blue().phases))


def plan_command(down, phase):
    flags = [word for element in down for word in ("--down", element)]
    return ["plan", "big_blue", "--json", "--phase", phase, *flags]


@pytest.mark.parametrize("seed", mostly_soak(range(30), [3]))
def test_the_plan_is_that_of_the_command(seed, capsys):
    down, phase = drawn(seed)
    told = Desk(big_blue()).answer({"ask": "plan", "down": down, "phase": phase})
    assert told["plan"] == printed(capsys, *plan_command(down, phase))
    running = {key for key, state in told["graph"]["nodes"].items() if state in ("served", "degraded")}
    assert {key for key in running if key.startswith("module:")} == {
        f"module:{name}" for name in told["plan"]["modules"]
    }


def test_what_is_less_than_the_best_upstream_is_told_as_the_command_tells_it(capsys):
    down = ["pe:nav", "pe:air", "pe:flight"]
    told = Desk(big_blue()).answer({"ask": "plan", "down": down, "phase": "glide"})
    assert told["shortfalls"].keys() == big_blue().functions.keys()
    assert told["shortfalls"]["parachute"]
    assert told["plan"]["functions"]["parachute"]["value"] == 100  # of the mode of its output alone
    flags = [word for element in down for word in ("--down", element)]
    for name in ("parachute", "experiment"):
        assert heronry(["why", "big_blue", name, "--json", "--phase", "glide", *flags]) in (0, 1)
        assert json.loads(capsys.readouterr().out)["shortfalls"] == told["shortfalls"][name]


def test_a_script_gives_the_plan_that_it_makes_of_what_runs():
    spec = load(shipped_spec_path("elevator_and_chute"))
    desk = Desk(spec)
    running, rest = (desk.answer({"ask": "plan", "priorities": changed})["plan"] for changed in ([], ["parachute=0"]))
    graphs = (module_graph(spec, configuration_of(one)) for one in (running, rest))
    script = {"ask": "script", "script": difference(*graphs), "modules": running["modules"]}
    told = desk.answer(script)["plan"]
    assert told["modules"] == rest["modules"]
    assert not told["functions"]["parachute"]["served"]
    wrong = desk.answer({**script, "script": f"{spec.name}.DeleteComponent ( nothing );"})
    assert wrong["refused"].startswith("the script would be refused: line 1: PCS")
    assert desk.answer({**script, "down": ["pe:tail_pe"]})["refused"].startswith("the script would be refused: rule ")
    assert "modules.x" in desk.answer({**script, "modules": {"x": {}}})["refused"]


def test_why_is_that_of_the_command(capsys):
    question = {"ask": "why", "function": "elevator", "down": ["pe:tail_pe"], "phase": None}
    spec = load(shipped_spec_path("elevator_and_chute"))
    told = Desk(spec).answer(question)
    assert told["why"] == printed(capsys, "why", "elevator_and_chute", "elevator", "--down", "pe:tail_pe", "--json")


@pytest.mark.parametrize(
    ("question", "sentence"),
    [
        ({"ask": "plan", "down": ["pe:nap"]}, "did you mean 'nav'?"),
        ({"ask": "plan", "phase": "war"}, "no phase is named 'war'"),
        ({"ask": "why", "function": "flaps"}, "no function is named 'flaps'"),
        ({"ask": "the oracle"}, "the planner's process does not know this question"),
        ({"ask": "plan", "down": [1, 2]}, "lists of texts"),
        ({"ask": "plan", "limits": "bus:can0"}, "lists of texts"),
        ({"ask": "why", "function": "elevator", "phase": ["glide"]}, "of a wrong kind"),
        ({"ask": "script", "script": "", "modules": {}, "priorities": {"elevator": 1}}, "of a wrong kind"),
    ],
)
def test_what_cannot_be_asked_is_refused(question, sentence):
    assert sentence in Desk(big_blue()).answer(question)["refused"]


JUNK = (None, True, 7, -1, 1e30, "", "pe:nav", "\u20ac" * 300, [], ["pe:nav"], [[]], {}, {"x": {}}, {"pe": "nav"})


def spoilt(value, random):
    """A copy of a question with one of its values replaced."""
    if not isinstance(value, dict | list) or not value or random.random() < 0.2:
        return random.choice(JUNK)
    keys = list(value) if isinstance(value, dict) else range(len(value))
    at, copy = random.choice(keys), value.copy()
    copy[at] = spoilt(value[at], random)
    return copy


def test_no_question_is_answered_by_a_traceback():
    spec, random = load(shipped_spec_path("elevator_and_chute")), Random(7)
    desk = Desk(spec)
    now = {"down": ["pe:tail_pe"], "limits": ["pe:tail_pe=50%"], "phase": None, "priorities": ["parachute=0"]}
    running = desk.answer({"ask": "plan"})["plan"]["modules"]
    script = f"{spec.name}.PruneEdges ();"
    asked = [
        {"ask": "why", "function": "elevator", **now},
        {"ask": "script", "script": script, "modules": running, **now},
        {"ask": "script", "script": script, "modules": running},
    ]
    for _ in range(300):
        question = spoilt(spoilt(random.choice(asked), random), random)
        if isinstance(question, dict):
            assert json.dumps(desk.answer(question))


def asked(questions, *then):
    async def run():
        try:
            return [await one(questions) for one in then]
        finally:
            await questions.close()

    return asyncio.run(run())


QUESTION = {"ask": "plan", "down": [], "phase": None}
SMALL = shipped_spec_path("elevator_and_chute")


def test_a_question_that_is_stale_ends_the_search_and_the_next_is_answered():
    async def cancelled(questions):
        await questions.warm()
        number = questions._process.pid
        task = asyncio.create_task(questions.ask(QUESTION))
        await asyncio.sleep(0)
        await asyncio.sleep(0)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        return number

    async def answered(questions):
        return await questions.ask(QUESTION), questions._process.pid

    first, (told, second) = asked(Questions(load(SMALL), SMALL), cancelled, answered)
    assert "plan" in told
    assert first != second


def test_a_spec_that_has_changed_is_told(tmp_path):
    file = tmp_path / "own.dg.yaml"
    file.write_bytes(SMALL.read_bytes())
    spec = load(file)
    file.write_bytes(SMALL.read_bytes() + b"\nphases: {one: }\n")
    (told,) = asked(Questions(spec, file), lambda questions: questions.ask(QUESTION))
    assert "has changed" in told["refused"]


def test_a_process_that_ends_is_told(tmp_path):
    spec = load(SMALL)
    (told,) = asked(Questions(spec, tmp_path / "gone.dg.yaml"), lambda questions: questions.ask(QUESTION))
    assert "the planner's process has ended" in told["refused"]
