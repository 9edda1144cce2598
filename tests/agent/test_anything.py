"""Any input in any order: the core never raises, and its invariants hold."""

from hypothesis import given, settings
from hypothesis import strategies as st

from agent.one_pe import (
    FAR,
    FLYING,
    GATEWAY_TABLE,
    NEIGHBOUR,
    NODE,
    RUN_MONITOR,
    RUN_SERVO_2,
    TABLE,
    neighbour_state,
    rate_frame,
    slice_messages,
)
from heronry_agent.core.agent import AgentCore
from heronry_agent.core.vocabulary import Event, StartFailed, StepFailed, StepModule, Stepped
from heronry_wire.configuration_slice import Slice
from heronry_wire.frame import Frame
from heronry_wire.identifiers import Command, management_id, state_id
from heronry_wire.management import Activate, Alive, Control, Lease, Operation, Ping, Step
from heronry_wire.pe_table import PeTable
from heronry_wire.sansio import Received, Tick
from lab.peers import command_frame
from thoroughness import part_of

SLICES = (FLYING, Slice((RUN_SERVO_2, RUN_MONITOR), remote={0: NEIGHBOUR, 1: FAR}), Slice())

identifiers = st.one_of(
    st.integers(0, 0x7FF),
    st.sampled_from([management_id(m, c) for m in (126, 127) for c in Command]),
    st.sampled_from(
        [0, 128, 300, 1536, 1537, 1629, *(state_id(n) for n in (92, 93, 94)), *range(1884, 1890), *range(1920, 1924)]
    ),
)
frames = st.builds(
    Frame, identifiers, st.binary(max_size=8), st.booleans(), st.just(value=False), st.just(value=False)
) | st.builds(Frame, identifiers, st.binary(min_size=8, max_size=8))

epochs = st.integers(0, 4) | st.sampled_from([0x7FFF, 0x8000, 0xFFFF])
steps = st.sampled_from(Step)
terms = st.integers(1, 3)
nodes = st.sampled_from([0, NEIGHBOUR, NODE, FAR])


@st.composite
def commands(draw: st.DrawFn) -> list[Frame]:
    """Frames of true commands: single ones, or a whole slice, some of its frames lost, doubled or out of order."""
    manager, term, epoch = draw(st.sampled_from([126, 127])), draw(terms), draw(epochs)
    messages = draw(
        st.one_of(
            st.builds(lambda step: [Lease(term, epoch, step, 1000 + epoch)], steps),
            st.builds(lambda step: [Activate(term, epoch, step, 1000 + epoch)], steps),
            st.builds(lambda who: [Alive(term, 0, who)], st.frozensets(st.sampled_from([NEIGHBOUR, NODE, FAR]))),
            st.builds(lambda node: [Ping(term, node, 0)], nodes),
            st.builds(
                lambda node, a, b: [Control(term, node, Operation.ACKNOWLEDGE, a, b)],
                nodes,
                st.integers(0, 3),
                st.integers(0, 5),
            ),
            st.sampled_from(SLICES).flatmap(
                lambda wanted: st.lists(st.sampled_from(slice_messages(wanted, epoch, 1000 + epoch, term)), max_size=20)
            ),
            st.sampled_from(SLICES).map(lambda wanted: slice_messages(wanted, epoch, 1000 + epoch, term)),
        )
    )
    return [command_frame(message, manager) for message in messages]


@st.composite
def reconfigurations(draw: st.DrawFn) -> list[Frame]:
    """A whole and correct reconfiguration, with the other frames that a PE hears meanwhile."""
    manager, epoch, wanted = draw(st.sampled_from([126, 127])), draw(epochs), draw(st.sampled_from(SLICES))
    term = draw(terms)
    orders = [Activate(term, epoch, step, 1000 + epoch) for step in sorted(draw(st.sets(steps, min_size=1)))]
    messages = [Alive(term, 0, frozenset({NODE})), *slice_messages(wanted, epoch, 1000 + epoch, term), *orders]
    return [command_frame(message, manager) for message in messages] + [neighbour_state(epoch), rate_frame(1.0)]


outputs = st.dictionaries(
    st.sampled_from(["demand", "alarm", "rate"]), st.one_of(st.floats(), st.integers(), st.text(max_size=3)), max_size=3
)
own_events = st.one_of(
    st.just(Tick()),
    st.builds(Stepped, st.integers(0, 5), st.integers(0, 9), outputs),
    st.builds(StepFailed, st.integers(0, 5), st.integers(0, 9), st.just("oops")),
    st.builds(StartFailed, st.integers(0, 5), st.just("oops")),
)
happenings = st.one_of(
    reconfigurations(),
    commands(),
    frames.map(lambda frame: [frame]),
    own_events.map(lambda event: [event]),
    st.integers(0, 200_000_000),  # let time pass
)


@settings(max_examples=part_of(300), deadline=None)
@given(st.sampled_from([TABLE, GATEWAY_TABLE]), st.lists(happenings, max_size=40), st.data())
def test_the_core_takes_anything(table: PeTable, story: list, data: st.DataObject) -> None:
    now_ns = 0
    core = AgentCore(table, 0, now_ns)

    def give(event: Event) -> None:
        actions = core.step(now_ns, event)
        core.validate()
        for action in actions:
            if isinstance(action, StepModule) and data.draw(st.integers(0, 3)):
                reports = (("device:left", 1),) if data.draw(st.booleans()) else ()
                give(Stepped(action.module, action.release, data.draw(outputs), (1.0,), reports))

    for happening in story:
        if isinstance(happening, int):
            end_ns = now_ns + happening
            while core.next_deadline_ns() <= end_ns:
                now_ns = max(now_ns, core.next_deadline_ns())
                give(Tick())
            now_ns = end_ns
            continue
        for item in happening:
            port = data.draw(st.integers(0, len(table.ports) - 1)) if len(table.ports) > 1 else 0
            give(Received(port, item) if isinstance(item, Frame) else item)
