"""Keys and tags: what they depend on, and the file of a key."""

import os
from hashlib import blake2s
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from heronry_wire.authentication import KEY_BYTES, Key, Place, Session, next_number
from heronry_wire.frame import WireError
from heronry_wire.identifiers import Command
from heronry_wire.key_file import KeyFileError, make_key, read_key
from heronry_wire.state_frames import joined_state, split_state

SECRET = bytes(range(KEY_BYTES))
KEY = Key(SECRET)
LEASE = bytes.fromhex("0003 0007 02 ABCDEF")
SAID = bytes.fromhex("18 05 0007 09")


def test_a_command_tag_is_keyed_blake2s_over_all_that_the_protocol_names() -> None:
    head = bytes.fromhex("7E 00 0003 00000101 0000000000000000")
    expected = blake2s(head + LEASE, key=SECRET, digest_size=6, person=b"hrn-cmd").digest()
    assert KEY.command_tag(126, Command.LEASE, Place(3, 257), LEASE).to_bytes(6, "big") == expected


def test_a_state_tag_is_keyed_blake2s_over_the_session_the_beat_and_the_digest() -> None:
    covered = bytes.fromhex("5C 7E 0003 00000101 00000009") + SAID + bytes.fromhex("ABCDEF")
    expected = blake2s(covered, key=SECRET, digest_size=3, person=b"hrn-stat").digest()
    tag = KEY.state_tag(92, Session(126, 3, 257), 9, SAID, 0xABCDEF)
    assert tag.to_bytes(3, "big") == expected


def test_a_state_tag_may_cover_an_emcy_besides() -> None:
    emergency = bytes.fromhex("03 FF 81 01 0001 0039")
    covered = bytes.fromhex("5C 7E 0003 00000101 00000009") + SAID + bytes.fromhex("ABCDEF") + emergency
    expected = blake2s(covered, key=SECRET, digest_size=3, person=b"hrn-stat").digest()
    tag = KEY.state_tag(92, Session(126, 3, 257), 9, SAID, 0xABCDEF, emergency=emergency)
    assert tag.to_bytes(3, "big") == expected


@pytest.mark.parametrize(
    ("page", "said", "digest"),
    [
        (bytes.fromhex("18 05 0007 09 ABCDEF"), bytes.fromhex("18 05 0007 09"), 0xABCDEF),
        (bytes.fromhex("58 0007 ABCDEF 00 2A"), bytes.fromhex("58 0007 00 2A"), 0xABCDEF),
    ],
)
def test_a_page_is_taken_apart_and_put_together_again(page: bytes, said: bytes, digest: int) -> None:
    assert split_state(page) == (said, digest)
    assert joined_state(said, digest) == page


@given(st.binary(max_size=100), st.binary(max_size=100))
def test_a_table_is_opened_with_the_key_that_sealed_it_and_only_as_it_was(table: bytes, other: bytes) -> None:
    sealed = KEY.sealed(table, 7)
    assert sealed.startswith(table)
    assert KEY.opened(sealed, 7) == table
    assert KEY.opened(sealed, 8) is None
    assert Key(bytes(KEY_BYTES)).opened(sealed, 7) is None
    assert KEY.opened(other, 7) is None
    assert KEY.opened(other + sealed, 7) == (None if other else table)


def test_a_seal_is_keyed_blake2s_of_the_challenge_and_the_whole_table() -> None:
    assert KEY.sealed(b"{}", 258)[2:] == blake2s(b"\0\0\1\2{}", key=SECRET, digest_size=32, person=b"hrn-tabl").digest()


def test_no_two_commands_have_one_tag() -> None:
    tags = [
        KEY.command_tag(126, Command.LEASE, Place(3, 257), LEASE),
        KEY.command_tag(127, Command.LEASE, Place(3, 257), LEASE),
        KEY.command_tag(126, Command.ACTIVATE, Place(3, 257), LEASE),
        KEY.command_tag(126, Command.LEASE, Place(4, 257), LEASE),
        KEY.command_tag(126, Command.LEASE, Place(3, 258), LEASE),
        KEY.command_tag(126, Command.LEASE, Place(3, 257), LEASE[:-1]),
        KEY.command_tag(126, Command.LEASE, Place(3, 257), LEASE, nonce=1),
        Key(bytes(KEY_BYTES)).command_tag(126, Command.LEASE, Place(3, 257), LEASE),
    ]
    assert len(set(tags)) == len(tags)


@given(st.integers(-1, 1 << 40), st.integers(0, 255))
def test_a_few_bits_stand_for_the_first_number_above_the_last(after: int, low: int) -> None:
    number = next_number(after, low, 256)
    assert number % 256 == low
    assert after < number <= after + 256


def test_a_key_has_its_length_and_is_never_printed() -> None:
    with pytest.raises(WireError, match="a key has 32 bytes, not 31"):
        Key(bytes(31))
    assert repr(KEY) == f"Key({KEY.fingerprint})"
    assert SECRET.hex() not in repr(KEY)


def test_a_made_key_is_for_its_owner_alone_and_is_read_back(tmp_path: Path) -> None:
    file = tmp_path / "fleet.key"
    made = make_key(file)
    assert file.stat().st_mode & 0o777 == 0o600
    assert read_key(file).fingerprint == made.fingerprint
    assert make_key(tmp_path / "other.key").fingerprint != made.fingerprint


def test_a_key_is_never_written_over(tmp_path: Path) -> None:
    file = tmp_path / "fleet.key"
    file.write_text("precious")
    with pytest.raises(KeyFileError, match="exists already"):
        make_key(file)
    assert file.read_text() == "precious"


def test_a_key_in_a_folder_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(KeyFileError, match="name a file in an existing folder"):
        make_key(tmp_path / "none" / "fleet.key")
    with pytest.raises(KeyFileError, match="make a key with 'heronry key FILE'"):
        read_key(tmp_path / "fleet.key")


@pytest.mark.parametrize("mode", [0o604, 0o640, 0o620, 0o602, 0o666])
def test_a_key_that_others_may_read_or_change_is_refused(tmp_path: Path, mode: int) -> None:
    file = tmp_path / "fleet.key"
    make_key(file)
    file.chmod(mode)
    with pytest.raises(KeyFileError, match=f"by others .mode {mode:04o}., so its key is no secret; make a new key"):
        read_key(file)


@pytest.mark.parametrize("content", [b"", b"0123", b"G" * 64, b"0" * 65, b"0" * 64 + b"\n\n", b"\xff" * 64])
def test_what_is_no_key_is_refused(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "fleet.key"
    make_key(file)
    file.write_bytes(content)
    with pytest.raises(KeyFileError, match="holds no key"):
        read_key(file)


def test_a_key_that_another_user_owns_is_no_secret(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "fleet.key"
    make_key(file)
    if os.geteuid() == 0:
        os.chown(file, 4711, -1)
    else:
        monkeypatch.setattr(os, "geteuid", lambda: 4711)
    with pytest.raises(KeyFileError, match=r"belongs to another user \(user ID \d+\), so its key is no secret"):
        read_key(file)


def test_a_pipe_is_no_key_and_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "fleet.key", 0o600)
    with pytest.raises(KeyFileError, match="holds no key"):
        read_key(tmp_path / "fleet.key")
