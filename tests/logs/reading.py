"""A log read by the code under test, in this process or one of its own, and by python-can."""

import subprocess
import sys

import can

from dctorque_can.logs.messages import ChannelNumbers, frames_from_messages
from dctorque_can.logs.reader import open_log
from dctorque_can.pipeline.frames import Frames

START = 1_700_000_000_000_000
READ = """
import sys
from dctorque_can.logs.reader import open_log
with open_log(sys.argv[1]) as log:
    print(sum(map(len, log.frames())), *log.problems, sep="\\n")
"""


def by_python_can(path) -> Frames:
    with can.LogReader(path) as reader:
        return frames_from_messages(list(reader), ChannelNumbers())


def read(path, batch=100_000):
    log = open_log(path)
    frames = Frames.concatenate(log.frames(batch))
    assert log.fraction == 1.0
    return frames, log


def read_apart(path):
    """Return the number of frames and the problems, read by another process, which must end well."""
    done = subprocess.run([sys.executable, "-c", READ, str(path)], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr[-2000:]
    count, *problems = done.stdout.splitlines()
    return int(count), problems
