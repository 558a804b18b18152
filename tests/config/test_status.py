"""The `status:` section: where the status may be read."""

import pytest

from dctorque_can.config.edges import LONGEST_SOCKET
from dctorque_can.config.load import ConfigError


@pytest.mark.parametrize(
    ("metrics", "address"),
    [
        ("127.0.0.1:9642", ("127.0.0.1", 9642)),
        ("127.1.2.3:1", ("127.1.2.3", 1)),
        ("[::1]:65535", ("::1", 65535)),
    ],
)
def test_loopback_addresses_are_taken(load, metrics: str, address: tuple[str, int]) -> None:
    assert load({"status": {"metrics": metrics}}).status.metrics_address() == address


@pytest.mark.parametrize(
    "metrics",
    [
        *("0.0.0.0:9642", "192.168.1.1:9642", "[::]:9642", "::1:9642", "[127.0.0.1]:9642", "localhost:9642"),
        *("127.0.0.1", "127.0.0.1:", "127.0.0.1:0", "127.0.0.1:65536", "127.0.0.1:-1", ":9642", "", "9642"),
        *("[::ffff:192.168.1.1]:9642", "127.0.0.1:९६४२", "127.0.0.1:" + "9" * 5000),
    ],
)
def test_metrics_stay_on_the_loopback_interface(load, metrics: str) -> None:
    with pytest.raises(ConfigError) as caught:
        load({"status": {"metrics": metrics}})
    (problem,) = [each for each in caught.value.problems if each.severity == "error"]
    assert problem.key == "status.metrics"
    assert "must be a loopback address and a port, such as 127.0.0.1:9642" in problem.reason


def test_the_path_of_a_socket_has_the_limit_of_the_kernel(load) -> None:
    longest = "/" + "ä" * ((LONGEST_SOCKET - 1) // 2)
    assert load({"status": {"socket": longest}}).status.socket == longest
    for wrong in (longest + "ä", ""):
        with pytest.raises(ConfigError, match=r"status\.socket.*at most 107 bytes"):
            load({"status": {"socket": wrong}})
