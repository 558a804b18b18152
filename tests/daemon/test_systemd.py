"""When systemd is told what."""

import pytest

from dctorque_can.daemon import systemd
from dctorque_can.daemon.systemd import Systemd


class Notifier:
    def __init__(self) -> None:
        self.told: list[str] = []

    def notify(self, state: str) -> None:
        self.told.append(state)


def test_the_watchdog_is_fed_three_times_a_limit_and_the_state_told_now_and_then(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    notifier = Notifier()
    monkeypatch.setattr(systemd, "SystemdNotifier", lambda: notifier)
    monkeypatch.setenv("NOTIFY_SOCKET", "/nowhere")
    monkeypatch.setenv("WATCHDOG_USEC", "3000000")
    service = Systemd()
    told: dict[float, list[str]] = {}
    for now_s in (10.0, 10.75, 11.0, 11.75, 12.0, 12.75):
        notifier.told.clear()
        service.keep_time(now_s, int(100 * now_s), lambda: "estimating")
        told[now_s] = list(notifier.told)
    fed = "WATCHDOG=1"
    assert told == {
        10.0: [fed, "STATUS=estimating, 500 frames/s, 1000 in all"],
        10.75: [],
        11.0: [fed],
        11.75: [],
        12.0: [fed, "STATUS=estimating, 100 frames/s, 1200 in all"],
        12.75: [],
    }


def test_without_systemd_nobody_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NOTIFY_SOCKET", raising=False)
    monkeypatch.setattr(systemd, "SystemdNotifier", lambda: pytest.fail("opens a socket for nothing"))
    Systemd().ready()
