"""``tools/soak``: traffic that repeats itself, an account that finds what is missing, verdicts that can fail."""

import importlib
import socket
import struct
from pathlib import Path
from random import Random
from types import SimpleNamespace

import numpy as np
import pytest

from dctorque_can.pipeline.frames import Frames

TOOLS = Path(__file__).resolve().parents[2] / "tools"
MASK = 0b11
RATE_HZ = 1000.0


@pytest.fixture
def soaking(monkeypatch):
    """Give the modules of the tool, by name."""
    monkeypatch.syspath_prepend(str(TOOLS))
    return lambda name: importlib.import_module(f"soaking.{name}")


@pytest.fixture
def drive(soaking):
    """A drive of one second, each frame with its number in it."""
    records = np.zeros(500, soaking("traffic").RECORD)
    records["t_us"] = 2000 * np.arange(len(records))
    records["can_id"], records["length"] = 0x100, 8
    records["data"] = np.arange(len(records)).astype("<u8").view("u1").reshape(-1, 8)
    return records


def sent(soaking, drive, seconds=3.0, seed=1, **changes):
    traffic = soaking("traffic").Traffic(drive, RATE_HZ, seed)
    for name, value in changes.items():
        setattr(traffic.disturbance, name, value)
    return np.concatenate([traffic.due(1000 * ms) for ms in range(round(1000 * seconds))])


def of_the_car(records):
    return records[records["can_id"] == 0x100]


def numbers_of(records):
    numbered = records[records["can_id"] >= 0x400]
    return numbered["data"].copy().view("<u8").ravel().tolist()


def test_half_of_the_traffic_is_of_the_car_and_half_is_numbered(soaking, drive):
    records = sent(soaking, drive)
    assert len(of_the_car(records)) == pytest.approx(1500, abs=5)
    numbers = numbers_of(records)
    assert numbers == list(range(len(numbers)))
    assert len(numbers) == pytest.approx(1500, abs=5)
    assert (np.diff(records["t_us"]) >= 0).all()


@pytest.mark.parametrize(
    ("changes", "least", "most"),
    [
        ({"loss": 0.5}, 600, 900),
        ({"duplication": 0.5}, 2000, 2500),
        ({"silent": True}, 0, 0),
        ({"burst_s": 0.1}, 1350, 1505),
        ({"reordering": 0.3}, 1400, 1505),
        ({"flips": 0.5}, 1490, 1510),
        ({"flood": (0x100,), "flood_hz": 1000.0}, 4000, 5000),
    ],
)
def test_a_disturbance_does_what_it_is_called_and_repeats_itself(soaking, drive, changes, least, most):
    records = sent(soaking, drive, **changes)
    assert least <= len(of_the_car(records)) <= most
    assert numbers_of(records) == list(range(len(numbers_of(records))))
    assert records.tobytes() == sent(soaking, drive, **changes).tobytes()
    if not changes.get("silent"):
        assert records.tobytes() != sent(soaking, drive).tobytes()


def test_a_clock_that_is_set_moves_times_and_nothing_else(soaking, drive):
    as_ever, later = sent(soaking, drive), sent(soaking, drive, clock_us=3_600_000_000)
    assert (later["t_us"] - as_ever["t_us"] == 3_600_000_000).all()
    assert later["data"].tobytes() == as_ever["data"].tobytes()


def frames_of(records):
    frames = Frames.empty(len(records))
    frames.can_id[:], frames.length[:], frames.data[:] = records["can_id"], records["length"], records["data"]
    return frames


@pytest.fixture
def passed(soaking, drive):
    return sent(soaking, drive)


def test_every_frame_of_a_log_is_found(soaking, passed):
    places = soaking("account").Places(passed)
    assert places.take(frames_of(passed[:700])).tolist() == list(range(700))
    assert places.take(frames_of(passed[900:])).tolist() == list(range(900, len(passed)))
    assert (places.altered, places.twice) == (0, 0)
    assert np.flatnonzero(~places.taken).tolist() == list(range(700, 900))


@pytest.mark.parametrize("missing", [1, 2, 3, 40])
def test_frames_that_are_missing_inside_are_told_from_altered_ones(soaking, passed, missing):
    for first in range(300, 310):
        places = soaking("account").Places(passed)
        places.take(frames_of(np.delete(passed, range(first, first + missing))))
        assert (places.altered, places.twice) == (0, 0)
        gone = np.flatnonzero(~places.taken)
        assert len(gone) == missing
        assert set(gone) <= set(range(first - 2, first + missing + 2))  # frames beside it may be alike


def test_altered_and_repeated_frames_are_found(soaking, passed):
    places = soaking("account").Places(passed)
    wrong = passed.copy()
    car = np.flatnonzero(wrong["can_id"] == 0x100)[[10, 20, 500]]
    wrong["data"][car, 3] ^= 1
    places.take(frames_of(wrong))
    assert (places.altered, places.twice) == (3, 0)
    places.take(frames_of(passed[100:130]))
    assert places.twice >= 30


def test_what_only_one_of_two_sequences_has(soaking):
    unmatched = soaking("account")._unmatched
    words = np.arange(1000, dtype=np.uint64) * np.uint64(7919)
    left, right = np.delete(words, [*range(100, 140), 700]), np.delete(words, range(400, 410))
    only_left, only_right = unmatched(left, right)
    assert left[only_left].tolist() == words[400:410].tolist()
    assert right[only_right].tolist() == words[[*range(100, 140), 700]].tolist()
    assert unmatched(words, words) == ([], [])
    assert unmatched(words, words[:990]) == (list(range(990, 1000)), [])


def test_the_slope_of_the_memory(soaking):
    """Two megabytes in an hour, with a saw tooth on it."""
    at_s = np.arange(0.0, 3600.0, 2.0)
    kilobytes = 100_000 + 2048 * at_s / 3600 + 100 * (np.arange(len(at_s)) % 2)
    sample = soaking("service").Sample
    samples = [sample(t, 0, 1, "service", round(kb), 10) for t, kb in zip(at_s, kilobytes, strict=True)]
    slope, error = soaking("verdicts").slope_mb_per_hour(samples)
    assert slope == pytest.approx(2.0, abs=0.05)
    assert 0.0 < error < 0.05


class FakeRun:
    """What verdicts look at, of two processes that did as they should."""

    def __init__(self, soaking):
        life = soaking("service").Life
        first = life(0, 100, 0, 0.0, ended_s=100.0, ending="SIGKILL", killed="everything", fetched=1000)
        second = life(1, 101, 1200, 103.0, ended_s=1803.0, ending="SIGTERM", code=0, summary={}, fetched=2000)
        event = soaking("run").Event("kill -9 of everything", 0, 100.0, 100.0, 1000, 1000, "", 5.0, 5.5)
        sample = soaking("service").Sample
        samples = [sample(103.0 + t, 1, 101, "service", 100_000, 12) for t in range(0, 1700, 2)]
        self.service = SimpleNamespace(lives=[first, second], samples=samples)
        self.events, self.crashes = [event], []
        self.bus = SimpleNamespace(untaken=200, longest_late_s=lambda from_s, to_s: 0.0)
        account = soaking("account")
        lives = [
            account.LifeAccount(first, 1000, 900, missing=100, lost_ms=120.0, heard=50, unlogged=10),
            account.LifeAccount(second, 2000, 2000, heard=70),
        ]
        self.account = account.Account(3200, 0, 0, lives, [3.0])
        self.logs = [soaking("replayed").LogResult(Path("a.mcap"), estimates=500, sent=110)]

    def broken(self, soaking):
        found = soaking("verdicts").verdicts(self, self.account, self.logs, 0, 200.0)
        assert all(each.text for each in found)
        return {each.name for each in found if each.holds is not True}


def test_all_invariants_hold_where_all_is_well(soaking):
    assert FakeRun(soaking).broken(soaking) == set()


def alter(name, value, of="account"):
    def change(run):
        setattr(getattr(run, of) if of else run, name, value)

    return change


def with_life(number, **values):
    def change(run):
        for name, value in values.items():
            setattr(run.account.lives[number], name, value)

    return change


def with_log(**values):
    def change(run):
        for name, value in values.items():
            setattr(run.logs[0], name, value)

    return change


def growing(run):
    run.service.samples = [
        type(sample)(sample.at_s, 1, 101, "service", 100_000 + round(sample.at_s), 12 + round(sample.at_s / 300))
        for sample in run.service.samples
    ]


@pytest.mark.parametrize(
    ("change", "broken"),
    [
        (alter("crashes", ["ended by itself"], of=""), {"no crash"}),
        (lambda run: run.service.lives[1].told.append((1.0, "Traceback (most …")), {"no crash"}),
        (lambda run: setattr(run.service.lives[1], "code", 1), {"no crash"}),
        (with_log(not_finite=1), {"every estimate is a number"}),
        (with_life(1, missing=1), {"every received frame is in a log or counted"}),
        (with_life(1, missing=-1), {"every received frame is in a log or counted"}),
        (alter("altered", 1), {"every frame once, as it was, in order"}),
        (alter("twice", 1), {"every frame once, as it was, in order"}),
        (with_life(0, lost_ms=221.0), {"kill -9 loses no more than is said"}),
        (with_log(different=1), {"each log replays alone, bit for bit"}),
        (with_log(problems=["torn"]), {"each log replays alone, bit for bit"}),
        (with_log(unlike=1), {"what was published is what the logs say"}),
        (with_life(0, unheard=2), {"what was published is what the logs say"}),
        (with_life(1, unheard=1), {"what was published is what the logs say"}),
        (with_life(1, unlogged=1), {"what was published is what the logs say"}),
        (growing, {"memory is flat", "descriptors are flat"}),
        (lambda run: setattr(run.events[0], "valid_after_s", None), {"every fault is recovered from"}),
        (alter("log_again_s", [None]), {"every fault is recovered from"}),
    ],
)
def test_an_invariant_that_does_not_hold_is_told(soaking, change, broken):
    run = FakeRun(soaking)
    change(run)
    assert run.broken(soaking) == broken


def test_frames_that_are_counted_may_be_missing(soaking):
    run = FakeRun(soaking)
    with_life(1, missing=5, dropped=7, unlogged=2)(run)
    assert run.broken(soaking) == set()


def test_a_kill_without_a_log_process_is_told_apart(soaking):
    """Where the log process was killed a moment before, nothing could be confirmed."""
    run = FakeRun(soaking)
    with_life(0, lost_ms=1500.0)(run)
    event = soaking("run").Event("kill -9 of the log process", 0, 98.6, 98.6, 990, 990, "", 0.1, 0.1)
    run.events.insert(0, event)
    run.account.log_again_s.insert(0, 2.0)
    assert run.broken(soaking) == set()
    found = soaking("verdicts").verdicts(run, run.account, run.logs, 0, 200.0)
    text = next(each.text for each in found if "kill -9" in each.name)
    assert text == "everything, 1400 ms after the log process: lost 100 frames"


def test_each_fault_of_traffic_ends_as_it_began(soaking, drive):
    """The clock stays as it was set; nothing else outlasts its fault."""
    faults = soaking("faults")
    traffic = soaking("traffic").Traffic(drive, RATE_HZ, 1)
    traffic.disturbance.clock_us = 7
    seen = []
    stage = faults.Stage(
        SimpleNamespace(traffic=traffic), None, Random(3), lambda seconds: seen.append(traffic.disturbance)
    )
    for fault in (faults.loss, faults.bit_flips, faults.babble, faults.silence, faults.bursts, faults.all_at_once):
        fault(stage)
        assert traffic.disturbance == soaking("traffic").Disturbance(clock_us=7)
        assert seen.pop() != traffic.disturbance


def test_frames_go_through_the_loopback_bus_both_ways(soaking, drive, tmp_path, monkeypatch):
    """As the service has it: by the interface of python-can; what was fetched is known, also of a dead process."""
    monkeypatch.syspath_prepend(str(TOOLS / "soaking" / "interface"))
    soak_bus = importlib.import_module("soak_bus")
    traffic = soaking("traffic").Traffic(drive, RATE_HZ, 1)
    bus = soaking("loopback").Loopback(traffic, tmp_path, 0x6F0, MASK)
    bus.start()
    try:
        with soak_bus.SoakBus(str(tmp_path / "bus")) as fetched_by:
            messages = [fetched_by.recv(60.0) for _ in range(300)]
            fetched_by.send(soak_bus.can.Message(arbitration_id=0x6F0, data=bytes(8), is_extended_id=False))
            fetched_by.send(soak_bus.can.Message(arbitration_id=0x6F0, data=b"\x03" * 8, is_extended_id=False))
            while not bus.valid_s:
                bus.check()
        fetched = bus.fetched()
        bus.down()
        with pytest.raises(OSError, match=r"No such file"):
            soak_bus.SoakBus(str(tmp_path / "bus"))
    finally:
        bus.stop()
    passed = bus.all_passed()
    assert fetched == 300
    assert [bytes(message.data) for message in messages] == [record.tobytes() for record in passed["data"][:300]]
    assert [message.arbitration_id for message in messages] == passed["can_id"][:300].tolist()
    assert bus.all_heard()["data"][:, 0].tolist() == [0, 3]


class PairedSocket:
    """Stands for a raw CAN socket: one end of a pair of datagram sockets."""

    def __init__(self, end):
        self._end = end

    def __getattr__(self, name):
        return getattr(self._end, name)

    def bind(self, address):
        self.bound = address

    def setsockopt(self, *option):
        pass


def test_frames_of_a_can_socket(soaking, drive, tmp_path, monkeypatch):
    """Frames as the kernel has them, both ways; of those that a full queue does not take, none is passed."""
    vcan = soaking("vcan")
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    monkeypatch.setattr(vcan.socket, "AF_CAN", -1, raising=False)
    monkeypatch.setattr(vcan.socket, "CAN_RAW", -1, raising=False)
    monkeypatch.setattr(vcan.socket, "socket", lambda *kind: PairedSocket(ours))
    traffic = soaking("traffic").Traffic(drive, RATE_HZ, 1)
    bus = vcan.Vcan(traffic, tmp_path, 0x6F0, MASK, "vcan7")
    frame = struct.Struct("=IB3x8s")
    theirs.send(frame.pack(0x6F0, 8, b"\x03" + bytes(7)))
    theirs.send(frame.pack(0x6F1, 2, b"\x01\x02"))
    bus.start()
    while bus.passed < 20 or bus.untaken == 0:  # nobody reads until the queue is full
        bus.check()
    bus.stop()
    sent = [theirs.recv(16) for _ in range(bus.passed)]
    passed = bus.all_passed()
    assert bus.connection() == ["-i", "socketcan", "--channel", "vcan7"]
    assert [frame.unpack(content) for content in sent] == [
        (record["can_id"], record["length"], record["data"].tobytes()) for record in passed
    ]
    heard = bus.all_heard()
    assert heard["can_id"].tolist() == [0x6F0, 0x6F1]
    assert heard["data"][1].tolist() == [1, 2, 0, 0, 0, 0, 0, 0]
    assert bus.valid_s > 0.0
    theirs.close()
