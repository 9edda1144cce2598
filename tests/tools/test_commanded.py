"""The oracles' own reading of what managers command."""

from heronry_dg.loader import load
from heronry_dg.shipped import shipped_spec_path
from heronry_manager.core.tables.compilation import Compiler
from heronry_tools.recording.commanded import Commanded
from heronry_wire.configuration_slice import slice_digest
from heronry_wire.management import Activate, Lease, Prepare, SliceBody, SliceHead, Step


def test_what_one_node_was_sent_is_not_taken_for_what_another_is_to_run() -> None:
    """Digests have 24 bits. Ground is beyond a radio: its slice may come after ACTIVATE, and is not known before."""
    spec = load(shipped_spec_path("big_blue"))
    wing, ground = spec.pes["wing"].node_id, spec.pes["ground"].node_id
    body = b"wings"
    identities = Compiler(spec).identities
    commanded = Commanded(spec, [Compiler(spec).table(pe) for pe in spec.pes])
    for message in (
        Prepare(1, 1, 5),
        SliceHead(wing, 1, len(body), slice_digest(identities[wing], body)),
        SliceBody(wing, 1, 1, body),
        Prepare(1, 2, 5),
        SliceHead(ground, 2, len(body), slice_digest(identities[wing], body)),
        Activate(1, 2, Step.GO_ALL, 5),
    ):
        assert commanded.take(0, message) is None


def test_an_epoch_that_ran_is_known_again_although_another_one_has_its_low_byte() -> None:
    """A manager that is gone has prepared 257, for no PE; the next one goes on with 1."""
    commanded = Commanded(load(shipped_spec_path("big_blue")))
    for term, epoch, digest in ((1, 1, 5), (3, 257, 6)):
        commanded.take(0, Prepare(term, epoch, digest))
        commanded.take(0, Activate(term, epoch, Step.GO_ALL, digest))
    assert commanded.current is not None
    assert commanded.current.number == 257
    commanded.take(0, Lease(4, 1, Step.GO_ALL, 5))
    assert commanded.current.number == 1


def test_an_epoch_that_a_higher_term_takes_over_before_any_pe_has_activated_it_is_adopted() -> None:
    """A deposed manager has activated 1; what runs by that, beyond a radio, is for the next active manager to adopt."""
    commanded = Commanded(load(shipped_spec_path("big_blue")))
    for message in (Prepare(1, 1, 5), Activate(1, 1, Step.GO_ALL, 5)):
        commanded.take(0, message, is_active=False)
    commanded.take(0, Prepare(3, 2, 6))
    commanded.take(0, Activate(3, 2, Step.GO_ALL, 6))
    commanded.take(0, Lease(4, 1, Step.GO_ALL, 5))
    commanded.take(0, Lease(4, 2, Step.GO_ALL, 6))
    assert [commanded.epochs[epoch].is_adopted for epoch in (1, 2)] == [True, False]


def test_slices_of_an_epoch_are_not_refused_because_another_one_has_had_its_number() -> None:
    """A manager whose disk accepted no write may begin again with numbers that it has used."""
    commanded = Commanded(load(shipped_spec_path("elevator_and_chute")))
    for message in (Prepare(1, 97, 5), Activate(1, 97, Step.GO_ALL, 5)):
        commanded.take(0, message)
    assert commanded.take(0, Prepare(3, 97, 6)) is None
    assert commanded.take(0, SliceHead(92, 97, 0, 7)) is None
    assert commanded.epochs[97].digest == 5
    commanded.take(0, Activate(3, 97, Step.GO_ALL, 6))
    assert commanded.epochs[97].digest == 6
