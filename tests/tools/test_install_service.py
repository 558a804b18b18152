"""tools/install-service: versions beside each other, and a way back. A stand-in makes the environments."""

import os
import subprocess
from pathlib import Path

import pytest

TOOL = Path(__file__).resolve().parents[2] / "tools" / "install-service"
PYTHON = """#!/bin/sh
# python3 -m venv FOLDER
mkdir -p "$3/bin"
cat > "$3/bin/pip" <<'END'
#!/bin/sh
[ "$3" != broken ] || exit 1
printf '#!/bin/sh\\necho dctorque %s\\n' "$3" > "$(dirname "$0")/dctorque"
[ "$3" = useless ] || chmod +x "$(dirname "$0")/dctorque"
END
chmod +x "$3/bin/pip"
"""


@pytest.fixture
def tool(tmp_path: Path):  # type: ignore[no-untyped-def]
    python = tmp_path / "python3"
    python.write_text(PYTHON)
    python.chmod(0o755)
    environment = os.environ | {"DCTORQUE_ROOT": str(tmp_path / "root"), "PYTHON": str(python)}

    def run(*arguments: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [str(TOOL), *arguments], env=environment, capture_output=True, text=True, timeout=600
        )

    return run


def version(tmp_path: Path) -> str:
    program = tmp_path / "root" / "opt" / "dctorque" / "bin" / "dctorque"
    return subprocess.run([str(program)], capture_output=True, text=True, check=True).stdout.strip()


def test_it_installs_upgrades_goes_back_and_removes(tool, tmp_path: Path) -> None:
    kept = tmp_path / "root" / "etc" / "dctorque" / "mycar.yaml"
    kept.parent.mkdir(parents=True)
    kept.touch()
    for name in ("one", "two", "three"):
        assert tool("install", name).returncode == 0
        assert version(tmp_path) == f"dctorque {name}"
    opt = tmp_path / "root" / "opt"
    assert sorted(path.name for path in (opt / "dctorque.versions").iterdir()) == ["2", "3", "before"]
    unit = tmp_path / "root" / "etc" / "systemd" / "system" / "dctorque@.service"
    assert unit.read_bytes() == (TOOL.parent / unit.name).read_bytes()
    assert tool("roll-back").stdout.startswith("using dctorque two")
    assert version(tmp_path) == "dctorque two"
    assert tool("roll-back").returncode == 0  # and forward again
    assert version(tmp_path) == "dctorque three"
    assert tool("remove").returncode == 0
    assert list(opt.iterdir()) == []
    assert not unit.exists()
    assert kept.exists()


@pytest.mark.parametrize("name", ["broken", "useless"])
def test_what_cannot_be_installed_or_started_is_not_used(tool, tmp_path: Path, name: str) -> None:
    assert tool("install", "one").returncode == 0
    assert tool("install", name).returncode != 0
    assert version(tmp_path) == "dctorque one"
    versions = tmp_path / "root" / "opt" / "dctorque.versions"
    assert [path.name for path in versions.iterdir()] == ["1"]


def test_what_it_did_not_make_is_left_alone(tool, tmp_path: Path) -> None:
    folder = tmp_path / "root" / "opt" / "dctorque"
    folder.mkdir(parents=True)
    for arguments in (["install", "one"], ["remove"]):
        done = tool(*arguments)
        assert done.returncode == 1
        assert "no link of this script" in done.stderr
    assert folder.is_dir()
    assert tool("roll-back").returncode == 1


def test_it_says_how_it_is_used(tool) -> None:
    done = tool("--help")
    assert done.returncode == 0
    assert "roll-back" in done.stdout
    assert tool().returncode != 0
    assert tool("install").returncode == 1
