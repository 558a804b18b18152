"""A step of the system clock while a bus is silent."""

import can
import pytest

from dctorque_can.daemon.wire.steady_recv import receive_by_steady_clock

from ..clock import Clock
from . import test_link


def test_a_clock_that_is_set_back_while_the_bus_is_silent_does_not_hold_up_receiving(
    clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    """python-can's own `recv` would ask its interface to wait for an hour."""
    monkeypatch.setattr("dctorque_can.daemon.wire.steady_recv.time", clock)
    system_s = iter([1e9, 1e9 - 3600.0, 1e9 - 3599.0])
    monkeypatch.setattr(can.bus, "time", lambda: next(system_s))
    bus = test_link.Polling(clock, pause_s=0.03)
    receive_by_steady_clock(bus)
    with bus:
        assert bus.recv(0.1) is test_link.MESSAGE
        began_s = clock.now_s
        assert bus.recv(0.1) is None
        assert clock.now_s - began_s == pytest.approx(0.1)
        began_s = clock.now_s
        assert bus.recv(0.0) is None
        assert clock.now_s - began_s == pytest.approx(0.0)


def test_filters_hold() -> None:
    with can.Bus(interface="virtual", channel="steady") as sender:
        filters = [{"can_id": 0x101, "can_mask": 0x7FF}]
        with can.Bus(interface="virtual", channel="steady", can_filters=filters) as bus:
            receive_by_steady_clock(bus)
            sender.send(can.Message(arbitration_id=0x100))
            sender.send(can.Message(arbitration_id=0x101))
            message = bus.recv(900.0)
    assert message is not None
    assert message.arbitration_id == 0x101
