"""A PE that lacks the code of a module tells that before its first page 1, and may still run everything else."""

from agent.one_pe import BEAT_NS, CONTROL, TABLE, OnePe
from heronry_agent.core.vocabulary import Note
from heronry_agent.shell.image_catalogues import is_here
from heronry_wire.frame import Malformed
from heronry_wire.identifiers import emcy_id, state_id
from heronry_wire.management import ElementKind, FaultCode, decode_emergency
from heronry_wire.sansio import Send
from heronry_wire.state_frames import StatePage1, decode_state


def test_it_tells_before_its_first_page_1() -> None:
    image = next(module.image for module in TABLE.modules if module.index == CONTROL)
    pe = OnePe(missing_images=frozenset((image,)))
    frames = [action.frame for action in pe.pass_time(30 * BEAT_NS) if isinstance(action, Send)]
    told = [i for i, frame in enumerate(frames) if frame.can_id == emcy_id(TABLE.node_id)]
    pages = [i for i, f in enumerate(frames) if f.can_id == state_id(TABLE.node_id)]
    first = next(i for i in pages if isinstance(decode_state(frames[i].data), StatePage1))
    emergency = decode_emergency(frames[told[0]].data)
    assert not isinstance(emergency, Malformed)
    assert (emergency.code, emergency.kind, emergency.index) == (FaultCode.MODULE_MISSING, ElementKind.MODULE, CONTROL)
    assert told[0] < first
    assert not any(isinstance(action, Note) and action.kind == "fault" for _, action in pe.done)


def test_code_is_found_without_being_imported() -> None:
    assert is_here("heronry_tools.aircraft.images.control:PitchControl")
    assert is_here("pitch_control")
    assert is_here("this_file_is_not_imported:Thing") is False
    assert is_here("heronry_tools.aircraft.images.nowhere:Thing") is False
    assert is_here("json.decoder.deeper:Thing") is False
    assert is_here("no_such_image") is False
