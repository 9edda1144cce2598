"""`heronry bundle build|sign|inspect`, and the key that signs."""

import json
from pathlib import Path

import pytest

from heronry_dg.loader import loads
from heronry_tools.cli import main
from heronry_tools.runtime.bundle_sending import slowest_bitrate

BUILD = ["--name", "nav", "--version", "3", "--image", "est:Speed"]


@pytest.fixture(autouse=True)
def _code(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    folder = Path("code")
    folder.mkdir()
    (folder / "est.py").write_text("class Speed: ...\n")
    (folder / "__pycache__").mkdir()
    (folder / "__pycache__" / "est.pyc").write_bytes(b"old")
    main(["key", "--signing", "fleet.signing"])


def refused(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    capsys.readouterr()
    assert main(words) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    return err


def test_a_bundle_is_built_signed_and_inspected(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bundle", "build", "code", "nav.bundle", *BUILD, "--wheel", "numpy>=1"]) == 0
    first = Path("nav.bundle").read_bytes()
    assert main(["bundle", "sign", "nav.bundle", "--key", "fleet.signing"]) == 0
    capsys.readouterr()
    assert main(["bundle", "inspect", "nav.bundle", "--key", "fleet.signing.pub", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["bundle"], told["version"], told["images"], told["wheels"]) == ("nav", 3, ["est:Speed"], ["numpy>=1"])
    assert list(told["files"]) == ["est.py"]
    assert told["key"] is not None
    assert main(["bundle", "inspect", "nav.bundle"]) == 0
    assert "needs:  Python 3." in capsys.readouterr().out
    assert main(["bundle", "build", "code", "nav.bundle", *BUILD, "--wheel", "numpy>=1"]) == 0
    assert Path("nav.bundle").read_bytes() == first


def test_a_bundle_inside_its_own_folder_does_not_hold_itself(capsys: pytest.CaptureFixture[str]) -> None:
    for _ in range(2):
        assert main(["bundle", "build", "code", "code/nav.bundle", *BUILD, "--json"]) == 0
        assert list(json.loads(capsys.readouterr().out.splitlines()[-1])["files"]) == ["est.py"]


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (["bundle", "build", "nosuch", "x.bundle", *BUILD], "nosuch is no folder"),
        (["bundle", "build", "code", "x.bundle", *BUILD[:-1], "est.py"], "its manifest says images"),
        (["bundle", "build", "code", "x.bundle", *BUILD[:-1], "other:Speed"], "has no other.py"),
        (["bundle", "build", "code", "x.bundle", *BUILD, "--wheel", "="], "names no package"),
        (["bundle", "build", "code", "no/x.bundle", *BUILD], "is not a folder"),
        (["bundle", "sign", "code", "--key", "fleet.signing"], "not an ordinary file"),
        (["bundle", "inspect", "code/est.py"], "it is no bundle"),
        (["key", "--signing", "fleet.signing"], "heronry overwrites no key"),
    ],
)
def test_what_cannot_be_done_is_said_in_one_sentence(
    words: list[str], why: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert why in refused(capsys, *words)
    assert not list(Path().glob("*.bundle"))


def test_the_slowest_bus_on_the_way_sets_the_pace() -> None:
    pe = "node_id: {}, buses: [{}], cpu: 1, ram: 1KiB, flash: 1KiB"
    nodes = {"near": (92, "fast"), "between": (93, "fast, slow"), "far": (94, "slow")}
    text = "dg: 1\nbuses: {fast: {bitrate: 1000000}, slow: {bitrate: 125000}}\nmanager: {bus: fast}\npes:\n"
    text += "".join(f"  {name}: {{{pe.format(*where)}}}\n" for name, where in nodes.items())
    spec = loads(text, "two.dg.yaml")
    assert {name: slowest_bitrate(spec, name) for name in nodes} == {
        "near": 1_000_000,
        "between": 1_000_000,
        "far": 125_000,
    }


def test_a_symbolic_link_is_not_followed(capsys: pytest.CaptureFixture[str]) -> None:
    Path("code/link.py").symlink_to("/etc/passwd")
    assert "is a symbolic link" in refused(capsys, "bundle", "build", "code", "x.bundle", *BUILD)


@pytest.mark.parametrize("make", [["key", "--signing", "code/here.signing"], ["key", "code/fleet.key"]])
def test_a_secret_key_in_the_folder_is_refused(make: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(make) == 0
    assert "holds a secret key" in refused(capsys, "bundle", "build", "code", "x.bundle", *BUILD)
    assert not Path("x.bundle").exists()


def test_a_folder_that_is_too_large_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with Path("code/large").open("wb") as stream:
        stream.truncate(17 << 20)
    assert "leave files out" in refused(capsys, "bundle", "build", "code", "x.bundle", *BUILD)


def test_a_wrong_signature_and_a_damaged_bundle_are_told(capsys: pytest.CaptureFixture[str]) -> None:
    main(["bundle", "build", "code", "nav.bundle", *BUILD])
    assert "it is not signed" in refused(capsys, "bundle", "inspect", "nav.bundle", "--key", "fleet.signing.pub")
    Path("nav.bundle").write_bytes(Path("nav.bundle").read_bytes()[:-30])
    assert "its archive is damaged" in refused(capsys, "bundle", "inspect", "nav.bundle")
