"""The systemd unit that ships: exit codes, sockets, status, limits, and what is left open."""

import re
import shutil
import subprocess
from configparser import RawConfigParser
from pathlib import Path

import pytest

from dctorque_can.cli.exit_codes import ExitCode
from dctorque_can.daemon.status.client import RUNTIME, socket_of
from dctorque_can.daemon.status.listener import SOCKET_NAME

TOOLS = Path(__file__).resolve().parents[2] / "tools"
SECURITY = TOOLS.parent / "docs" / "security.md"
UNIT = "dctorque@.service"


def service_section(name: str) -> dict[str, str]:
    parser = RawConfigParser(comment_prefixes=("#",), delimiters=("=",), strict=False)
    parser.optionxform = str  # type: ignore[assignment,method-assign]
    parser.read(TOOLS / name)
    return dict(parser["Service"])


def test_what_does_not_get_better_is_not_started_again() -> None:
    unit = service_section(UNIT)
    assert {int(code) for code in unit["RestartPreventExitStatus"].split()} == {ExitCode.USAGE, ExitCode.CONFIG}
    assert int(unit["SuccessExitStatus"]) == ExitCode.INCOMPLETE
    assert unit["Restart"] == "on-failure"
    assert unit["ExecStartPre"].startswith("-")  # what is wrong with the file is told by the code of `run`


def test_only_the_drop_in_allows_the_network_and_of_it_the_loopback_interface() -> None:
    unit = service_section(UNIT)
    assert "INET" not in unit["RestrictAddressFamilies"]
    assert unit["IPAddressDeny"] == "any"
    assert service_section("dctorque-loopback.conf") == {
        "RestrictAddressFamilies": "AF_INET AF_INET6",
        "IPAddressDeny": "any",
        "IPAddressAllow": "localhost",
    }


def test_the_status_is_where_the_command_looks_for_it() -> None:
    unit = service_section(UNIT)
    assert socket_of("NAME") == Path("/run", unit["RuntimeDirectory"].replace("%i", "NAME"), SOCKET_NAME)
    assert Path("/run/dctorque") == RUNTIME
    assert unit["RuntimeDirectoryMode"] == "0750"
    assert unit["ExecReload"] == "/bin/kill -HUP $MAINPID"


def test_it_has_an_end_of_memory_and_tasks() -> None:
    unit = service_section(UNIT)
    assert unit["MemoryMax"] == "1500M"
    assert int(unit["TasksMax"]) == 64


def test_a_service_that_is_taken_over_stays_where_it_is() -> None:
    unit = service_section(UNIT)
    yes = (
        "DynamicUser",
        "NoNewPrivileges",
        "ProtectHome",
        "ProtectClock",
        "ProtectKernelModules",
        "RestrictSUIDSGID",
    )
    assert {unit[name] for name in yes} == {"yes"}
    assert unit["CapabilityBoundingSet"] == ""
    assert unit["ProtectSystem"] == "strict"
    assert [name for name in unit if name.endswith("Directory")] == [
        *("StateDirectory", "WorkingDirectory", "CacheDirectory", "RuntimeDirectory")
    ]
    assert "ReadWritePaths" not in unit


needs_systemd = pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="no systemd-analyze here")


def analyse(*arguments: str) -> str:
    done = subprocess.run(["systemd-analyze", *arguments], capture_output=True, text=True, timeout=600)
    return done.stdout + done.stderr


def exposure(text: str) -> float:
    found = re.search(r"Overall exposure level for .*: ([\d.]+)", text)
    assert found is not None, text
    return float(found[1])


@needs_systemd
def test_what_is_left_open_is_little_and_explained() -> None:
    text = analyse("security", "--offline=true", "--no-pager", str(TOOLS / UNIT))
    assert exposure(text) <= 1.5
    explained = SECURITY.read_text(encoding="utf-8")
    left = re.findall(r"^✗ (\S+?)=", text, re.MULTILINE)
    assert left
    assert [name for name in left if f"`{name}`" not in explained] == []


@needs_systemd
def test_with_the_drop_in_it_is_little_too(tmp_path: Path) -> None:
    shutil.copy(TOOLS / UNIT, tmp_path)
    (tmp_path / f"{UNIT}.d").mkdir()
    shutil.copy(TOOLS / "dctorque-loopback.conf", tmp_path / f"{UNIT}.d")
    assert exposure(analyse("security", "--offline=true", "--no-pager", str(tmp_path / UNIT))) <= 1.8


@needs_systemd
def test_systemd_finds_nothing_to_complain_of(tmp_path: Path) -> None:
    """But that the program is not installed where the tests run: for that another one stands in."""
    program = tmp_path / "dctorque"
    program.write_text("#!/bin/sh\n")
    program.chmod(0o755)
    unit = tmp_path / UNIT
    unit.write_text((TOOLS / UNIT).read_text().replace("/opt/dctorque/bin/dctorque", str(program)))
    for drop_in in ("dctorque-loopback.conf", "dctorque-realtime.conf"):
        (tmp_path / f"{UNIT}.d").mkdir(exist_ok=True)
        shutil.copy(TOOLS / drop_in, tmp_path / f"{UNIT}.d")
    assert analyse("verify", str(unit)) == ""


def test_what_runs_in_real_time_is_the_service_alone() -> None:
    """Neither the log writer, which it starts, nor compiling beforehand; and the kernel's own comes first."""
    text = (TOOLS / "dctorque-realtime.conf").read_text()
    unit = dict(line.split("=", 1) for line in text.splitlines() if "=" in line and not line.startswith("#"))
    assert unit["CPUSchedulingPolicy"] == "fifo"
    assert 1 <= int(unit["CPUSchedulingPriority"]) < 50  # threaded interrupts have 50
    assert unit["CPUSchedulingResetOnFork"] == "yes"
    ordinary = service_section("dctorque@.service")["ExecStartPre"].removeprefix("-")
    assert unit["ExecStartPre"] == f"-/usr/bin/chrt --reset-on-fork --other 0 {ordinary}"
    assert text.index("\nExecStartPre=\n") < text.index("\nExecStartPre=-")  # the unit's own is taken back first
