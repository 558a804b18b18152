"""Who may have written a file of compiled code. Loading it runs it.

The rule: a file and its folder, and every folder above that, belong to root or to the user that runs, and nobody
else may write there. A group may where it is the owner's private one: of the same name, with nobody else in it. In
a folder above, others may write where only owners can replace what is there, as in /tmp (the sticky bit). For root
this means: what only root can write.
"""

from __future__ import annotations

import grp
import os
import pwd
import stat
from pathlib import Path


class UntrustedError(Exception):
    """Others may have written this; the message says what, and who."""


def check_folder(folder: Path) -> None:
    """Check that nobody else can put or replace anything in ``folder``.

    Args:
        folder: exists; without symbolic links (`Path.resolve`).

    Raises:
        UntrustedError: somebody else can.
        OSError: it cannot be looked at.
    """
    for path in (folder, *folder.parents):
        status = path.stat()
        if path != folder and status.st_mode & stat.S_ISVTX and status.st_uid in (0, os.geteuid()):
            continue
        _check(path, status)


def read_trusted(path: Path) -> bytes:
    """Return the content of a file in a folder that was checked.

    Raises:
        UntrustedError: somebody else may have written it.
        OSError: it cannot be read.
    """
    with os.fdopen(os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC), "rb") as file:
        status = os.fstat(file.fileno())
        if not stat.S_ISREG(status.st_mode):
            raise UntrustedError(f"{path} is no regular file")
        _check(path, status)
        return file.read()


def _check(path: Path, status: os.stat_result) -> None:
    if status.st_uid not in (0, os.geteuid()):
        raise UntrustedError(f"{path} belongs to {_user(status.st_uid)}")
    if status.st_mode & stat.S_IWOTH:
        raise UntrustedError(f"everybody may write to {path}")
    if status.st_mode & stat.S_IWGRP and not _is_private(status.st_uid, status.st_gid):
        raise UntrustedError(f"the group {_group(status.st_gid)} may write to {path}")


def _is_private(uid: int, gid: int) -> bool:
    """Return whether a group is the one that a user has for himself, as distributions make them."""
    if gid == 0 and uid == 0:
        return True
    try:
        user, group = pwd.getpwuid(uid), grp.getgrgid(gid)
    except KeyError:
        return False
    return user.pw_gid == gid and group.gr_name == user.pw_name and set(group.gr_mem) <= {user.pw_name}


def _user(uid: int) -> str:
    try:
        return pwd.getpwuid(uid).pw_name
    except KeyError:
        return f"user {uid}"


def _group(gid: int) -> str:
    try:
        return grp.getgrgid(gid).gr_name
    except KeyError:
        return str(gid)
