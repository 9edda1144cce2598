"""Which names a module reads: a misspelt input is found in its first steps, and other unknown names are not."""

from collections.abc import Callable

import pytest

from heronry_agent.module import Context, Datum, Inputs, Module, Value
from heronry_agent.shell.module_runner import ModuleRunner, Orders, Result
from heronry_agent.shell.reading_watch import WATCHED_STEPS, ReadingWatch

Reads = Callable[[Inputs], object]
INPUTS = {"0": ("altitude", Datum(1.0, 1, 0)), "1": ("pressure", Datum(2.0, 1, 0))}


class Reader(Module):
    """Reads by the function that the test has put here."""

    reads: Reads

    def __init__(self, ctx: Context) -> None:
        super().__init__(ctx)

    def step(self, inputs: Inputs) -> dict[str, Value]:
        Reader.reads(inputs)
        return {}


def misspelt(reads: Reads, steps: int = WATCHED_STEPS) -> tuple[tuple[str, str], ...]:
    Reader.reads = staticmethod(reads)
    runner = ModuleRunner(lambda: 0)
    orders = Orders("reader", f"{__name__}:Reader", "only", 1, None, ("altitude", "pressure"), ("altitude", "pressure"))
    assert runner.start(0, orders, 0) is None
    result: object = None
    for _ in range(steps):
        result = runner.step(0, 0, 0, None, INPUTS)
    assert isinstance(result, Result)
    return result.misspelt


def both(first: str, second: str) -> Reads:
    return lambda inputs: (inputs.get(first), inputs.get(second))


@pytest.mark.parametrize(
    ("reads", "found"),
    [
        (both("altitude", "pressure"), ()),
        (both("altitude", "presure"), (("presure", "pressure"),)),
        (both("altitude", "battery"), ()),  # not similar
        (lambda inputs: [inputs.get(name) for name in ("altitude", "pressure", "presure")], ()),  # has it, too
        (lambda inputs: inputs.every("altitud"), (("altitud", "altitude"),)),
        (lambda inputs: (dict(inputs), inputs.get("presure")), ()),  # has gone through all
        (lambda inputs: (inputs.leaf("1"), inputs.get("presure")), ()),
        (lambda inputs: (inputs["altitude"], "presure" in inputs), (("presure", "pressure"),)),
    ],
)
def test_a_name_like_an_input_that_is_never_read_is_misspelt(reads: Reads, found: tuple[tuple[str, str], ...]) -> None:
    assert misspelt(reads) == found


def test_it_is_found_after_the_first_steps_and_stays_known() -> None:
    assert misspelt(both("altitude", "presure"), WATCHED_STEPS - 1) == ()
    assert misspelt(both("altitude", "presure"), WATCHED_STEPS + 5) == (("presure", "pressure"),)


def test_later_steps_get_plain_inputs() -> None:
    watch = ReadingWatch(("altitude",), ("altitude",))
    kinds = []
    for _ in range(WATCHED_STEPS + 1):
        kinds.append(type(watch.inputs(INPUTS)))
        watch.stepped()
    assert Inputs not in kinds[:WATCHED_STEPS]
    assert kinds[-1] is Inputs
    assert type(ReadingWatch((), ()).inputs({})) is Inputs
