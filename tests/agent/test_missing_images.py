"""A PE that lacks the code of a module tells that before its first page 1, and may still run everything else."""

import pytest

from agent.one_pe import BEAT_NS, CONTROL, TABLE, OnePe
from heronry_agent.core.vocabulary import Note
from heronry_agent.module import AbsentError, Inputs
from heronry_agent.shell.image_catalogues import why_not_here
from heronry_wire.frame import Malformed
from heronry_wire.identifiers import emcy_id, state_id
from heronry_wire.management import ElementKind, FaultCode, decode_emergency
from heronry_wire.sansio import Send
from heronry_wire.state_frames import StatePage1, decode_state


def test_it_tells_before_its_first_page_1() -> None:
    image = next(module.image for module in TABLE.modules if module.index == CONTROL)
    pe = OnePe(missing_images={image: "there is no such file"})
    frames = [action.frame for action in pe.pass_time(30 * BEAT_NS) if isinstance(action, Send)]
    told = [i for i, frame in enumerate(frames) if frame.can_id == emcy_id(TABLE.node_id)]
    pages = [i for i, f in enumerate(frames) if f.can_id == state_id(TABLE.node_id)]
    first = next(i for i in pages if isinstance(decode_state(frames[i].data), StatePage1))
    emergency = decode_emergency(frames[told[0]].data)
    assert not isinstance(emergency, Malformed)
    assert (emergency.code, emergency.kind, emergency.index) == (FaultCode.MODULE_MISSING, ElementKind.MODULE, CONTROL)
    assert told[0] < first
    notes = [action for _, action in pe.done if isinstance(action, Note)]
    assert not any(note.kind == "fault" for note in notes)
    assert [note.text for note in notes if note.kind == "image"] == [
        f"{image} cannot be run here: there is no such file"
    ]
    assert pe.core.modules.failures.last(CONTROL).reason == "there is no such file"


def test_code_is_found_without_being_imported() -> None:
    assert why_not_here("heronry_tools.aircraft.images.control:PitchControl") is None
    assert why_not_here("pitch_control") is None
    assert why_not_here("not_imported:Thing") == (
        "image 'not_imported:Thing': there is no not_imported here; install it, or set PYTHONPATH"
    )
    for absent in ("heronry_tools.aircraft.images.nowhere:Thing", "json.decoder.deeper:Thing"):
        assert "there is no" in (why_not_here(absent) or "")
    assert (
        why_not_here("no_such_image")
        == "there is no image 'no_such_image'; write package.module:Class for code of your own"
    )


def test_an_input_that_is_not_supplied_is_told_with_a_remedy() -> None:
    with pytest.raises(AbsentError, match=r"^no fresh value of 'speed' is supplied; ask with inputs\.get\('speed'\)"):
        Inputs({})["speed"]
    assert "speed" not in Inputs({})
