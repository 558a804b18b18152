"""Where compiled code is kept, and what is said when there is no place for it."""

import os
from pathlib import Path

import pytest
from numba.core import config

from dctorque_can.compiling import places
from dctorque_can.compiling.places import checked, own_folder
from dctorque_can.compiling.sources import code_digest, digest_of


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(config, "CACHE_DIR", "")
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    return tmp_path / "home"


def test_the_first_of_three_folders_that_is_named(home: Path, tmp_path: Path, monkeypatch) -> None:
    assert own_folder() == home / ".cache" / "dctorque" / code_digest()
    monkeypatch.setenv("XDG_CACHE_HOME", "not/absolute")  # to be ignored, says its specification
    assert own_folder() == home / ".cache" / "dctorque" / code_digest()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert own_folder() == tmp_path / "xdg" / "dctorque" / code_digest()
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path / "numba"))
    assert own_folder() == tmp_path / "numba" / "dctorque" / code_digest()


def test_a_folder_is_made_for_the_user_alone_whatever_the_umask(tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        place = checked(tmp_path / "a" / "b")
    finally:
        os.umask(before)
    assert place.problem is None
    assert [path.stat().st_mode & 0o777 for path in (place.folder, place.folder.parent)] == [0o755, 0o755]


def test_a_folder_that_cannot_be_made_is_a_problem_in_words(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    place = checked(tmp_path / "file" / "code")
    assert place.problem == f"there is no place for compiled code: {tmp_path}/file/code: File exists"


def test_a_folder_that_others_can_write_is_a_problem_in_words(tmp_path: Path) -> None:
    folder = tmp_path / "code"
    folder.mkdir()
    folder.chmod(0o777)
    assert checked(folder).problem == (
        f"compiled code in {folder} is not used: everybody may write to {folder}, and could put other code there"
    )


def test_a_link_is_judged_by_where_it_leads(tmp_path: Path) -> None:
    target = tmp_path / "target"
    target.mkdir()
    target.chmod(0o777)
    (tmp_path / "link").symlink_to(target)
    assert "everybody may write" in str(checked(tmp_path / "link").problem)


def test_the_digest_is_of_every_source_and_of_the_circumstances(tmp_path: Path) -> None:
    for name in ("compiled.py", "compiling/kept_code.py", "driveline/a.py", "logs/mcap/b.py", "cli/c.py"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("1\n")
    first = digest_of(tmp_path, "numba 1")
    assert digest_of(tmp_path, "numba 2") != first
    for name in ("compiled.py", "compiling/kept_code.py", "driveline/a.py", "logs/mcap/b.py"):
        (tmp_path / name).write_text("2\n")
        assert digest_of(tmp_path, "numba 1") != first
        (tmp_path / name).write_text("1\n")
    (tmp_path / "cli" / "c.py").write_text("2\n")
    assert digest_of(tmp_path, "numba 1") == first


def test_shipped_code_lies_in_the_package() -> None:
    assert places.shipped().parent.parent.parent == Path(places.__file__).parents[1]
