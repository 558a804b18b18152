"""What the kernel may leave out where frames are not logged, and when it must not."""

import socket
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import can
import numpy as np
import pytest
from can.interfaces.socketcan import SocketcanBus
from can.interfaces.socketcan import socketcan as stock
from can.interfaces.virtual import VirtualBus
from hypothesis import given
from hypothesis import strategies as st

from dctorque_can.config.load import Config, load_config
from dctorque_can.daemon.log.plan import plan_for
from dctorque_can.daemon.service import Service
from dctorque_can.daemon.wire.kernel_filter import MOST, OPEN_S, KernelFilter, Wanted
from dctorque_can.pipeline.frames import EVERY_BIT, EXTENDED_ID, Address, Frames, group_mask
from dctorque_can.resources import shipped_config

ENGINE, OURS, OTHER = 0x100, 0x6F0, 0x400
GROUP = 0x18FEF100 | EXTENDED_ID


def of(*can_ids: int) -> Frames:
    frames = Frames.empty(len(can_ids))
    frames.can_id[:] = can_ids
    return frames


@dataclass
class Kernel:
    """A bus of SocketCAN on a local socket, which has no filters; these are only noted."""

    bus: SocketcanBus
    asked: list[Any] = field(default_factory=list)


@pytest.fixture
def kernel(monkeypatch: pytest.MonkeyPatch) -> Iterator[Kernel]:
    wire, end = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    monkeypatch.setattr(stock, "create_socket", lambda: end)
    monkeypatch.setattr(stock, "bind_socket", lambda sock, channel: None)
    with SocketcanBus("pair") as bus, wire:
        noted = Kernel(bus)

        def note(filters: Any) -> None:
            noted.asked.append(filters)
            bus._is_filtered = True

        monkeypatch.setattr(bus, "_apply_filters", note)
        bus.set_filters(None)
        noted.asked.clear()
        yield noted


identifiers = st.one_of(
    st.integers(0, 0x7FF),
    st.integers(0, 0x1FFF_FFFF).map(lambda number: number | EXTENDED_ID),
    st.integers(0, 0xFF).map(lambda source: GROUP | source),
)


@given(identifiers, st.integers(0, 2))
def test_what_passes_the_filters_of_a_bus_is_what_is_mapped_on_it_or_sent_by_us(can_id: int, number: int) -> None:
    """By python-can's own filter, which does what the kernel's does."""
    inputs = [Address(ENGINE), Address(GROUP, group_mask(GROUP)), Address(0x200, EVERY_BIT, channel=1)]
    wanted = Wanted(inputs, {OURS}).on_channel(number)
    with VirtualBus("filters") as bus:
        bus.set_filters(wanted.filters())
        extended = bool(can_id & EXTENDED_ID)
        message = can.Message(arbitration_id=can_id & ~EXTENDED_ID, is_extended_id=extended)
        passes = bus._matches_filters(message)
    assert passes == (any(each.has(can_id, number) for each in inputs) or can_id == OURS)


def test_the_kernel_leaves_out_nothing_before_the_first_mapped_frame(kernel: Kernel) -> None:
    """Else nobody could tell that frames come of which none is mapped, or only somebody else's on our own."""
    it = KernelFilter(kernel.bus, Wanted([Address(ENGINE)], {OURS}))
    it.heard(of(OTHER, OURS), 0.0)
    assert (it.on, it.used, kernel.asked) == (False, False, [])
    it.heard(of(OTHER, ENGINE), 0.1)
    assert (it.on, it.used) == (True, True)
    assert [each["can_id"] for each in kernel.asked[0]] == [ENGINE, OURS]


def test_everything_is_received_again_when_nothing_passes(kernel: Kernel) -> None:
    it = KernelFilter(kernel.bus, Wanted([Address(ENGINE)]))
    it.heard(of(ENGINE), 10.0)
    it.quiet(10.0 + 0.9 * OPEN_S)
    assert it.on
    it.quiet(10.0 + OPEN_S)
    assert not it.on
    assert kernel.asked[1] is None
    it.heard(of(OTHER), 12.0)
    assert not it.on
    it.heard(of(ENGINE), 12.5)
    assert it.on
    assert len(kernel.asked) == 3


def test_a_kernel_that_refuses_filters_gives_everything(kernel: Kernel, monkeypatch: pytest.MonkeyPatch) -> None:
    """A local socket knows nothing of CAN; python-can would then filter what it receives itself."""
    monkeypatch.undo()
    it = KernelFilter(kernel.bus, Wanted([Address(ENGINE)]))
    it.heard(of(ENGINE), 0.0)
    assert (it.on, it.used) == (False, False)
    assert kernel.bus.filters is None


@pytest.mark.parametrize("why", ["no inputs", "too many", "a filter of the user", "another interface"])
def test_no_filter_is_set_where_it_cannot_be_right(kernel: Kernel, why: str) -> None:
    wanted = Wanted(
        [Address(number) for number in range({"no inputs": 0, "too many": MOST + 1}.get(why, 1))], {OURS}
    )
    bus: can.BusABC = kernel.bus
    if why == "a filter of the user":
        bus.set_filters([{"can_id": ENGINE, "can_mask": 0x7FF}])
    if why == "another interface":
        bus = VirtualBus("no kernel")
    kernel.asked.clear()
    it = KernelFilter(bus, wanted)
    it.heard(of(0), 0.0)
    assert (it.on, it.used, kernel.asked) == (False, False, [])
    bus.shutdown()


@pytest.fixture(scope="module")
def car() -> Config:
    return load_config(shipped_config("paper_car"), {"output.enabled": "true"})


@pytest.mark.parametrize("logged", ["everything", "estimates alone", "nothing"])
def test_with_every_frame_in_the_log_nothing_is_left_to_the_kernel(car: Config, logged: str) -> None:
    config = load_config(shipped_config("paper_car"), {"output.enabled": "true", "logging.frames": "false"})
    config = car if logged == "everything" else config
    plan = None if logged == "nothing" else plan_for(config)
    service = Service(config, [lambda: VirtualBus("wanted")], plan, lambda is_error, text: None)
    (bus,) = service._links.buses
    if logged == "everything":
        assert bus.wanted is None
        return
    assert bus.wanted is not None
    names = {term.message for given in config.inputs for term in given.signals}
    mapped = {message.frame_id for message in config.database.messages if message.name in names}
    sent = {message.frame_id for message in config.output.database.messages}
    assert {each["can_id"] for each in bus.wanted.filters()} >= mapped
    assert {each["can_id"] for each in bus.wanted.filters()} - mapped <= sent
    assert np.isin([0x6F0], list(bus.wanted.can_ids)).all()
