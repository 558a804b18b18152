"""The systemd unit that ships knows the exit codes, and which sockets it allows."""

from configparser import RawConfigParser
from pathlib import Path

from dctorque_can.cli.exit_codes import ExitCode

TOOLS = Path(__file__).resolve().parents[2] / "tools"


def service_section(name: str) -> dict[str, str]:
    parser = RawConfigParser(comment_prefixes=("#",), delimiters=("=",))
    parser.optionxform = str  # type: ignore[assignment,method-assign]
    parser.read(TOOLS / name)
    return dict(parser["Service"])


def test_what_does_not_get_better_is_not_started_again() -> None:
    unit = service_section("dctorque@.service")
    assert {int(code) for code in unit["RestartPreventExitStatus"].split()} == {ExitCode.USAGE, ExitCode.CONFIG}
    assert int(unit["SuccessExitStatus"]) == ExitCode.INCOMPLETE
    assert unit["Restart"] == "on-failure"
    assert unit["ExecStartPre"].startswith("-")  # what is wrong with the file is told by the code of `run`


def test_only_the_drop_in_allows_the_network_and_of_it_the_loopback_interface() -> None:
    assert "INET" not in service_section("dctorque@.service")["RestrictAddressFamilies"]
    assert service_section("dctorque-loopback.conf") == {
        "RestrictAddressFamilies": "AF_INET AF_INET6",
        "IPAddressDeny": "any",
        "IPAddressAllow": "localhost",
    }


def test_what_runs_in_real_time_is_the_service_alone() -> None:
    """Neither the log writer, which it starts, nor compiling beforehand; and the kernel's own comes first."""
    text = (TOOLS / "dctorque-realtime.conf").read_text()
    unit = dict(line.split("=", 1) for line in text.splitlines() if "=" in line and not line.startswith("#"))
    assert unit["CPUSchedulingPolicy"] == "fifo"
    assert 1 <= int(unit["CPUSchedulingPriority"]) < 50  # threaded interrupts have 50
    assert unit["CPUSchedulingResetOnFork"] == "yes"
    ordinary = service_section("dctorque@.service")["ExecStartPre"].removeprefix("-")
    assert unit["ExecStartPre"] == f"-/usr/bin/chrt --other 0 {ordinary}"
    assert text.index("\nExecStartPre=\n") < text.index("\nExecStartPre=-")  # the unit's own is taken back first
