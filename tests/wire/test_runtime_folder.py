"""The folder of a user's sockets: whose it is, and which one is refused."""

import os
from pathlib import Path

import pytest

from heronry_wire.runtime_folder import RuntimeFolderError, owned_folder, runtime_folder, trusted_folder


def test_it_is_below_the_runtime_directory_of_this_user(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    assert runtime_folder() == tmp_path / "heronry"


@pytest.mark.parametrize("named", [None, "", "/no/such/folder"])
def test_without_one_it_has_the_users_number(named: str | None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("XDG_RUNTIME_DIR", raising=False)
    if named is not None:
        monkeypatch.setenv("XDG_RUNTIME_DIR", named)
    assert runtime_folder().name == f"heronry-{os.getuid()}"


def test_the_runtime_directory_of_another_user_counts_as_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setattr(os, "getuid", lambda: 4711)
    assert runtime_folder().name == "heronry-4711"


def test_it_is_made_for_this_user_alone(tmp_path: Path) -> None:
    folder = owned_folder(tmp_path / "heronry")
    assert folder.stat().st_mode & 0o777 == 0o700
    assert owned_folder(folder) == trusted_folder(folder) == folder


def test_a_folder_that_is_not_there_is_nobodys(tmp_path: Path) -> None:
    assert trusted_folder(tmp_path / "none") == tmp_path / "none"


@pytest.mark.parametrize("use", [owned_folder, trusted_folder])
def test_what_another_user_made_or_may_write_is_refused(
    use: "type[Path]", tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "heronry"
    folder.mkdir()
    (tmp_path / "link").symlink_to(folder)
    with pytest.raises(RuntimeFolderError, match="does not belong to you"):
        use(tmp_path / "link")
    folder.chmod(0o770)
    with pytest.raises(RuntimeFolderError, match="other users can write to it"):
        use(folder)
    folder.chmod(0o700)
    monkeypatch.setattr(os, "getuid", lambda: 4711)
    with pytest.raises(RuntimeFolderError, match="does not belong to you"):
        use(folder)


def test_what_cannot_be_made_or_looked_at_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    for use, what in ((owned_folder, "made"), (trusted_folder, "looked at")):
        with pytest.raises(RuntimeFolderError, match=rf"file.* cannot be {what} \(Not a directory\)"):
            use(tmp_path / "file" / "heronry")
