"""SIGTERM ends ``dctorque run`` at any moment, whatever its bus is doing."""

import os
import pty
import signal
import subprocess
import sys
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from dctorque_can.logs.reader import open_log
from dctorque_can.resources import shipped_config

HANG_S = 900  # so late that no load of the machine explains it
WEDGED = """
import ctypes, sys, can
from can.interfaces.virtual import VirtualBus

class Wedged(VirtualBus):
    def _recv_internal(self, timeout):
        print("within the driver", file=sys.stderr, flush=True)
        while True:
            ctypes.CDLL(None).sleep(1000)

can.Bus = lambda **arguments: Wedged("wedged")
from dctorque_can.cli.main import main
main()
"""


class Run:
    """``dctorque run`` on an slcan adapter that is a pseudo-terminal."""

    def __init__(self, environment: dict[str, str], folder: Path, *start: str) -> None:
        self.master, self.slave = pty.openpty()
        tty.setraw(self.slave)
        os.set_blocking(self.master, False)
        arguments = ["run", str(shipped_config("paper_car")), "-i", "slcan", "--channel", os.ttyname(self.slave)]
        settings = ["--set", "can.options={sleep_after_open: 0}", "--set", "output.enabled=true"]
        self.log = folder / "x.mcap"
        self.err: list[str] = []
        self.process = subprocess.Popen(
            [sys.executable, "-W", "error", *start, *arguments, *settings, "--log", str(self.log), "--wait"],
            cwd=folder,
            env=environment,
            stderr=subprocess.PIPE,
            text=True,
        )

    def read_until(self, text: str) -> None:
        assert self.process.stderr is not None
        while not self.err or text not in self.err[-1]:
            line = self.process.stderr.readline()
            assert line, self.err
            self.err.append(line)

    def stop(self) -> tuple[int, str]:
        self.process.send_signal(signal.SIGTERM)
        began_s = time.monotonic()
        _, err = self.process.communicate(timeout=HANG_S)
        print(f"ended after {time.monotonic() - began_s:.2f} s")
        assert "Traceback" not in err
        return self.process.returncode, err

    def pull_out(self) -> None:
        os.close(self.master)
        os.close(self.slave)
        self.master = self.slave = -1


@pytest.fixture
def run(environment: dict[str, str], tmp_path: Path) -> Iterator[Callable[..., Run]]:
    started: list[Run] = []

    def start(*how: str) -> Run:
        started.append(Run(environment, tmp_path, *(how or ("-m", "dctorque_can.cli"))))
        return started[-1]

    yield start
    for one in started:
        if one.process.poll() is None:
            one.process.kill()
        one.process.communicate()
        if one.master >= 0:
            one.pull_out()


def test_while_it_listens(run: Callable[..., Run]) -> None:
    daemon = run()
    daemon.read_until("estimating on")
    assert daemon.stop()[0] == 0


def test_after_half_a_line_and_after_the_adapter_was_pulled_out(run: Callable[..., Run]) -> None:
    """While it tries to open the bus again, and pauses between the tries."""
    daemon = run()
    daemon.read_until("estimating on")
    os.write(daemon.master, b"t10\r")
    daemon.read_until("damaged line")
    daemon.pull_out()
    daemon.read_until("the bus is gone")
    code, err = daemon.stop()
    assert code == 0
    assert "lost 1 times, back 0 times" in err
    assert "1 damaged lines" in err


def test_while_opening_blocks(run: Callable[..., Run]) -> None:
    """An adapter that reads nothing, and whose buffer is full, does not even take the command to open."""
    daemon = run()
    fill(daemon.slave)
    daemon.read_until("waiting for it")
    assert daemon.stop()[0] == 0


def test_while_the_driver_does_not_return(run: Callable[..., Run]) -> None:
    daemon = run("-c", WEDGED)
    daemon.read_until("within the driver")
    code, err = daemon.stop()
    assert code == 128 + signal.SIGTERM
    assert "does not return" in err
    while not complete(daemon.log):  # by its writer
        time.sleep(0.05)


def fill(descriptor: int) -> None:
    """Write until nothing more fits; the kernel makes room a few times, as it moves what is there."""
    os.set_blocking(descriptor, False)
    for _ in range(50):
        with suppress(BlockingIOError):
            while True:
                os.write(descriptor, b"x")
        time.sleep(0.02)


def complete(log: Path) -> bool:
    if not log.read_bytes().endswith(b"\x89MCAP0\r\n"):
        return False
    with open_log(log) as reader:
        assert list(reader.frames()) == []
    return True
