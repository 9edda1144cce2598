"""A bundle of code: the same files give the same bytes, and whatever is wrong with one is told in one sentence."""

import json
import stat
import struct
import zipfile
from importlib import import_module
from io import BytesIO
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from heronry_wire import bundle_needs
from heronry_wire.bundle import (
    HEAD,
    MAGIC,
    MANIFEST,
    MOST_BYTES,
    MOST_UNPACKED,
    Bundle,
    BundleError,
    ForeignBundleError,
    LargeBundleError,
    pack,
    unpack,
)
from heronry_wire.bundle_needs import check_here
from heronry_wire.bundle_signing import check_signature, make_signing_key, read_public_key, sign

FILES = {"est/__init__.py": b"", "est/speed.py": b"class Speed: ...\n", "est/table.csv": b"1,2\n"}
IMAGES = ("est.speed:Speed",)


def made(**changed) -> Bundle:
    return pack(**{"name": "nav", "version": 3, "images": IMAGES, "files": FILES, "wheels": (), **changed})


def archive_of(*members: tuple[str, bytes], **manifest) -> bytes:
    """An unsigned bundle with the manifest of `made`, some of its keys replaced, and other members."""
    said = json.loads(made().manifest.to_json()) | manifest
    stream = BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        archive.writestr(MANIFEST, json.dumps(said))
        for name, content in members or FILES.items():
            archive.writestr(name, content)
    return HEAD.pack(MAGIC, bytes(8), bytes(64)) + stream.getvalue()


def test_what_is_packed_is_read_again_and_is_the_same_each_time() -> None:
    bundle = made()
    assert bundle == unpack(bundle.content) == made(files=dict(reversed(FILES.items())))
    assert (bundle.manifest.name, bundle.manifest.version, bundle.manifest.images) == ("nav", 3, IMAGES)
    assert set(bundle.manifest.files) == set(FILES)
    assert not bundle.is_signed
    assert len(bundle.digest) == 64


def test_python_imports_from_a_bundle(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "slot"
    file.write_bytes(made(files={"from_a_bundle.py": b"X = 7\n"}, images=("from_a_bundle:X",)).content)
    monkeypatch.syspath_prepend(file)
    assert import_module("from_a_bundle").X == 7


@pytest.mark.parametrize(
    "place", ["../evil.py", "/etc/evil.py", "a/../../b.py", "a//b.py", "./a.py", "c:/a.py", "a\\b.py"]
)
def test_no_file_of_a_bundle_lies_outside_of_its_folder(place: str) -> None:
    with pytest.raises(BundleError, match="would lie outside of its folder"):
        unpack(archive_of((place, b"")))


def linked(kind: int, name: str = "est/link.py") -> bytes:
    stream = BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        archive.writestr(MANIFEST, made().manifest.to_json())
        member = zipfile.ZipInfo(name)
        member.create_system, member.external_attr = 3, kind << 16
        archive.writestr(member, "/etc/passwd")
    return HEAD.pack(MAGIC, bytes(8), bytes(64)) + stream.getvalue()


REFUSED = {
    "it is no bundle": b"PK\3\4" + bytes(200),
    "it is no bundle: ": MAGIC,
    "its archive is damaged": HEAD.pack(MAGIC, bytes(8), bytes(64)) + b"no archive",
    "is a symbolic link": linked(stat.S_IFLNK | 0o777),
    "is not an ordinary file": linked(stat.S_IFIFO | 0o644),
    "two files of one name": archive_of(("est/a.py", b""), ("est/A.py", b"")),
    "do not name the same files": archive_of(("est/speed.py", b"")),
    "is not the one of which its manifest has the digest": archive_of(*(FILES | {"est/table.csv": b"1,3\n"}).items()),
    "has no other/place.py": archive_of(images=["other.place:Thing"]),
    "its manifest names no image": archive_of(images=[]),
    "its manifest says bundle": archive_of(bundle="../x"),
    "its manifest says python": archive_of(python="4"),
    "its manifest says images": archive_of(images=["est.speed"]),
    "its version 0 is not a number": archive_of(version=0),
    "its version true is not a number": archive_of(version=True),
    "no list where one belongs": archive_of(wheels="numpy"),
    "no list of files": archive_of(files=[]),
    "has other keys": archive_of(more=1),
}


@pytest.mark.parametrize("why", REFUSED)
def test_a_bundle_that_is_wrong_is_refused_in_one_sentence(why: str) -> None:
    with pytest.raises(BundleError, match=why) as raised:
        unpack(REFUSED[why])
    assert "\n" not in str(raised.value)


def test_a_bundle_without_a_manifest_or_with_one_that_is_no_json_is_refused() -> None:
    for first, why in (("est/speed.py", "no manifest"), (MANIFEST, "not JSON")):
        stream = BytesIO()
        with zipfile.ZipFile(stream, "w") as archive:
            archive.writestr(first, b"{")
        with pytest.raises(BundleError, match=why):
            unpack(HEAD.pack(MAGIC, bytes(8), bytes(64)) + stream.getvalue())


def test_a_bundle_that_is_too_large_is_refused_before_it_is_unpacked() -> None:
    with pytest.raises(LargeBundleError, match="at most 1048576"):
        unpack(bytes(MOST_BYTES + 1))
    with pytest.raises(LargeBundleError, match="leave files out"):
        made(files=FILES | {"bomb": bytes(MOST_UNPACKED)})


@given(st.data())
def test_a_flipped_bit_is_never_taken_for_another_bundle(data: st.DataObject) -> None:
    content = bytearray(made().content)
    bit = data.draw(st.integers(8 * HEAD.size, 8 * len(content) - 1))
    content[bit // 8] ^= 1 << bit % 8
    try:
        read = unpack(bytes(content))
    except BundleError:
        return
    assert read.manifest == made().manifest  # a bit that means nothing to code, as the time of a member; it is signed


@given(st.binary(max_size=400))
def test_no_bytes_raise_anything_else(content: bytes) -> None:
    for prefix in (b"", HEAD.pack(MAGIC, bytes(8), bytes(64))):
        with pytest.raises(BundleError):
            unpack(prefix + content)


# Signatures


@pytest.fixture
def keys(tmp_path: Path) -> Path:
    file = tmp_path / "fleet.signing"
    make_signing_key(file)
    return file


def public(file: Path):
    return read_public_key(file.with_name(f"{file.name}.pub"))


def test_a_signed_bundle_is_believed_by_who_has_the_public_key(keys: Path) -> None:
    bundle = sign(made(), keys)
    assert bundle == unpack(bundle.content)
    check_signature(bundle, public(keys))
    assert keys.stat().st_mode & 0o777 == 0o600


@given(st.data())
def test_no_changed_bit_keeps_its_signature(tmp_path_factory: pytest.TempPathFactory, data: st.DataObject) -> None:
    folder = tmp_path_factory.mktemp("keys")
    make_signing_key(folder / "k")
    content = bytearray(sign(made(), folder / "k").content)
    bit = data.draw(st.integers(0, 8 * len(content) - 1))
    content[bit // 8] ^= 1 << bit % 8
    with pytest.raises(BundleError):
        check_signature(unpack(bytes(content)), public(folder / "k"))


def test_an_unsigned_one_or_one_of_another_key_is_refused(keys: Path, tmp_path: Path) -> None:
    other = tmp_path / "other"
    make_signing_key(other)
    with pytest.raises(ForeignBundleError, match="it is not signed"):
        check_signature(made(), public(keys))
    with pytest.raises(ForeignBundleError, match=r"it is signed with the key [0-9a-f]{16}, not with"):
        check_signature(sign(made(), other), public(keys))


def test_key_files_that_are_none_say_what_to_do(keys: Path, tmp_path: Path) -> None:
    with pytest.raises(BundleError, match="exists, and heronry overwrites no key"):
        make_signing_key(keys)
    lone = tmp_path / "lone"
    lone.with_name("lone.pub").touch()
    with pytest.raises(BundleError, match="exists"):
        make_signing_key(lone)
    assert not lone.exists()
    with pytest.raises(BundleError, match="No such file or directory; name a file"):
        make_signing_key(tmp_path / "nosuch" / "key")
    with pytest.raises(BundleError, match="it holds a heronry-signing-key"):
        read_public_key(keys)
    with pytest.raises(BundleError, match="it holds no heronry-public-key"):
        read_public_key(lone.with_name("lone.pub"))
    with pytest.raises(BundleError, match="No such file"):
        read_public_key(tmp_path / "nosuch")
    keys.chmod(0o640)
    with pytest.raises(BundleError, match="mode 0640"):
        sign(made(), keys)


# What a bundle needs


def test_another_python_and_a_missing_wheel_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    check_here(made(wheels=("python-can>=4",)).manifest)
    with pytest.raises(ForeignBundleError, match="it needs nosuch-wheel, which is not here"):
        check_here(made(wheels=("nosuch-wheel",)).manifest)
    with pytest.raises(ForeignBundleError, match=r"it needs python-can<1, and .* is here"):
        check_here(made(wheels=("python-can<1",)).manifest)
    with pytest.raises(BundleError, match="names no package"):
        check_here(made(wheels=("=5=",)).manifest)
    monkeypatch.setattr(bundle_needs, "this_python", lambda: "3.99")
    with pytest.raises(ForeignBundleError, match=r"it is for Python 3\.\d+, and this is 3\.99"):
        check_here(made().manifest)


def test_the_head_is_as_the_page_says() -> None:
    assert HEAD.size == struct.calcsize("<8s8s64s") == 80
