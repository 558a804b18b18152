"""Whose compiled code is loaded: only what nobody but root or the user could have written."""

import os
from pathlib import Path

import pytest

from dctorque_can.compiling import trust
from dctorque_can.compiling.trust import UntrustedError, check_folder, read_trusted

SOMEBODY = 12345


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    made = tmp_path / "above" / "code"
    made.mkdir(parents=True, mode=0o755)
    made.chmod(0o755)
    made.parent.chmod(0o755)
    return made


@pytest.fixture
def code(folder: Path) -> Path:
    file = folder / "loop.nbc"
    file.write_bytes(b"code")
    file.chmod(0o644)
    return file


@pytest.fixture
def as_root_sees(monkeypatch: pytest.MonkeyPatch):
    """Let files that this test made be those of an ordinary user, and the process be root's."""

    def pretend(uid: int) -> None:
        real = trust._check

        def check(path: Path, status: os.stat_result) -> None:
            owner = SOMEBODY if status.st_uid == os.getuid() and path.is_file() else status.st_uid
            real(path, os.stat_result((*status[:4], owner, *status[5:])))

        monkeypatch.setattr(trust, "_check", check)
        monkeypatch.setattr(os, "geteuid", lambda: uid)

    return pretend


def test_what_only_the_user_can_write_is_read(folder: Path, code: Path) -> None:
    check_folder(folder)
    assert read_trusted(code) == b"code"


@pytest.mark.parametrize("mode", [0o757, 0o777])
def test_a_folder_for_everybody_is_refused(folder: Path, mode: int) -> None:
    folder.chmod(mode)
    with pytest.raises(UntrustedError, match="everybody may write to"):
        check_folder(folder)


def test_a_folder_for_everybody_is_refused_even_if_it_is_sticky(folder: Path) -> None:
    """There others cannot replace files, but add them."""
    folder.chmod(0o1777)
    with pytest.raises(UntrustedError, match="everybody may write to"):
        check_folder(folder)


def test_a_parent_in_which_others_may_replace_the_folder_is_refused(folder: Path) -> None:
    folder.parent.chmod(0o777)
    with pytest.raises(UntrustedError, match=f"everybody may write to {folder.parent}"):
        check_folder(folder)
    folder.parent.chmod(0o1777)  # as /tmp
    check_folder(folder)


def test_a_group_may_write_only_if_it_is_the_private_one(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder.chmod(0o775)
    monkeypatch.setattr(trust, "_is_private", lambda uid, gid: False)
    with pytest.raises(UntrustedError, match=r"the group .* may write to"):
        check_folder(folder)
    monkeypatch.setattr(trust, "_is_private", lambda uid, gid: True)
    check_folder(folder)


def test_a_private_group_has_the_name_of_its_user_and_nobody_else_in_it(monkeypatch: pytest.MonkeyPatch) -> None:
    user = trust.pwd.struct_passwd(("ann", "x", 7, 70, "", "/home/ann", "/bin/sh"))
    monkeypatch.setattr(trust.pwd, "getpwuid", lambda uid: user)
    groups = {
        70: trust.grp.struct_group(("ann", "x", 70, [])),
        71: trust.grp.struct_group(("ann", "x", 71, [])),
        72: trust.grp.struct_group(("staff", "x", 70, [])),
        73: trust.grp.struct_group(("ann", "x", 70, ["ann", "bob"])),
    }
    monkeypatch.setattr(trust.grp, "getgrgid", lambda gid: groups[gid])
    assert trust._is_private(7, 70)
    assert not trust._is_private(7, 71)  # not the user's primary group
    monkeypatch.setattr(trust.grp, "getgrgid", lambda gid: groups[72])
    assert not trust._is_private(7, 70)  # another name
    monkeypatch.setattr(trust.grp, "getgrgid", lambda gid: groups[73])
    assert not trust._is_private(7, 70)  # somebody else in it


def test_a_file_that_others_may_write_is_refused(code: Path) -> None:
    code.chmod(0o646)
    with pytest.raises(UntrustedError, match="everybody may write to"):
        read_trusted(code)


@pytest.mark.parametrize("uid", [0, 54321])
def test_nobody_reads_what_belongs_to_another_user(code: Path, as_root_sees, uid: int) -> None:
    as_root_sees(uid)
    with pytest.raises(UntrustedError, match=f"belongs to user {SOMEBODY}"):
        read_trusted(code)


def test_a_link_is_not_followed(folder: Path, code: Path) -> None:
    link = folder / "link.nbc"
    link.symlink_to(code)
    with pytest.raises(OSError, match="symbolic links"):
        read_trusted(link)


def test_a_pipe_does_not_hold_the_process(folder: Path) -> None:
    pipe = folder / "pipe.nbc"
    os.mkfifo(pipe, 0o600)
    with pytest.raises(UntrustedError, match="no regular file"):
        read_trusted(pipe)
