"""What holds for the whole test session: which package is tested, and where compiled code is cached.

The tests import the *installed* package (``--import-mode=importlib`` puts nothing on ``sys.path``). So that
nobody tests yesterday's copy by accident, an installed copy that differs from this checkout is refused.
"""

import os
import shutil
import signal
import time
from importlib.util import find_spec
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as a shell's background job, with all that tests start
    signal.signal(signal.SIGINT, signal.default_int_handler)

ROOT = Path(__file__).resolve().parents[1]
CACHE_LIFETIME_S = 24 * 3600.0

# Time limits say more about the load of the machine than about the code.
settings.register_profile(
    "project",
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow],
    derandomize="CI" in os.environ,
    print_blob=True,
)
settings.load_profile("project")


def installed_package() -> Path:
    spec = find_spec("dctorque_can")
    if spec is None or spec.origin is None:
        raise pytest.UsageError("dctorque_can is not installed: run pip install '.[test]' first")
    return Path(spec.origin).resolve().parent


def differences(package: Path) -> list[str]:
    """Return the files of the checkout that are missing or different in the installed ``package``."""
    if package == ROOT / "dctorque_can":
        return []
    pairs = {path: package / path.relative_to(ROOT / "dctorque_can") for path in sources(ROOT / "dctorque_can")}
    for folder in ("config", "dbc"):
        files = (path for path in (ROOT / folder).rglob("*") if path.is_file())
        pairs |= {path: package / "shipped" / path.relative_to(ROOT) for path in files}
    return [
        str(path.relative_to(ROOT))
        for path, copy in pairs.items()
        if not copy.is_file() or path.read_bytes() != copy.read_bytes()
    ]


def sources(package: Path) -> list[Path]:
    return sorted(package.rglob("*.py"))


def compiled_code_cache() -> Path:
    """Return the cache directory of this checkout's tests, without what no session has used for long."""
    cache = ROOT / ".pytest_cache" / "numba"
    cache.mkdir(parents=True, exist_ok=True)
    for folder in cache.glob("dctorque/*"):
        if time.time() - folder.stat().st_mtime > CACHE_LIFETIME_S:
            shutil.rmtree(folder, ignore_errors=True)  # another session may be doing the same
    return cache


def take_over_compiled_code(cache: Path) -> None:
    """Begin with what the user has compiled of these very sources: the README's demo comes before its tests."""
    from dctorque_can.compiling.sources import code_digest

    users = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "dctorque" / code_digest()
    own = cache / "dctorque" / code_digest()
    if users.is_dir() and not own.exists():
        shutil.copytree(users, own, dirs_exist_ok=True)  # another session may be doing the same


PACKAGE = installed_package()
# Before anything imports numba, and inherited by the processes that tests start.
os.environ["NUMBA_CACHE_DIR"] = str(compiled_code_cache())


def pytest_configure(config: pytest.Config) -> None:
    different = differences(PACKAGE)
    if different:
        shown = ", ".join(different[:3]) + (", …" if len(different) > 3 else "")
        raise pytest.UsageError(
            f"the installed {PACKAGE} differs from this checkout ({shown}): run pip install '.[test]' again"
        )
    take_over_compiled_code(Path(os.environ["NUMBA_CACHE_DIR"]))


def pytest_report_header() -> str:
    return f"package under test: {PACKAGE}"


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    marked = [item for item in items if item.get_closest_marker("socketcan")]
    if not marked or Path("/sys/class/net/vcan0").exists():
        return
    if config.getoption("markexpr") == "socketcan":  # asked for by name: skipping would look like success
        raise pytest.UsageError("there is no vcan0 here: tools/with-vcan pytest -m socketcan")
    for item in marked:
        item.add_marker(pytest.mark.skip(reason="no vcan0 here: tools/with-vcan pytest -m socketcan"))
