"""How late all messages are together, against closed forms."""

import numpy as np
import pytest

from dctorque_can.identify.beliefs import LATE, WHEELS_LATE, Message
from dctorque_can.identify.common_delay import with_common_delay
from dctorque_can.identify.regression import Belief, Posterior
from dctorque_can.identify.unknowns import late_name
from dctorque_can.pipeline.samples import Quantity

ENGINE = Message("engine", ("inputs.engine_speed.delay_ms",), (Quantity.ENGINE_SPEED,), LATE, 0.0)
TORQUE = Message("torque", ("inputs.engine_torque.delay_ms",), (Quantity.ENGINE_TORQUE,), LATE, 0.0)
SHAFT = Message("shaft", ("inputs.shaft1_speed.delay_ms",), (Quantity.SHAFT1_SPEED,), LATE, 0.0)
WHEEL = Message("wheel", ("inputs.wheel_speeds.fl.delay_ms",), (Quantity.WHEEL_SPEED_FL,), WHEELS_LATE, 0.0)


def known_by_differences(messages: list[Message], late_ms: list[float], apart_ms: float = 0.2) -> Posterior:
    """Return delays that are surely so far apart, and by 5 ms unsure together."""
    n = len(messages)
    covariance = (apart_ms * 1e-3) ** 2 * np.eye(n) + (5e-3) ** 2
    return Posterior([late_name(each) for each in messages], 1e-3 * np.array(late_ms), covariance, {}, {})


def delays_ms(found: Posterior) -> np.ndarray:
    return 1e3 * found.values


NONE = dict.fromkeys(map(late_name, (ENGINE, TORQUE, SHAFT, WHEEL)), 0.0)


def test_the_soonest_is_as_late_as_all_exponentials_together() -> None:
    messages = [ENGINE, SHAFT, WHEEL]
    found = with_common_delay(known_by_differences(messages, [12.0, 10.0, 16.0]), messages, NONE)
    soonest = 1.0 / (1.0 / LATE.value + 1.0 / LATE.value + 1.0 / WHEELS_LATE.value)
    assert delays_ms(found) == pytest.approx([soonest + 2.0, soonest, soonest + 6.0], abs=0.03)
    assert 1e3 * found.of(late_name(SHAFT)).sigma == pytest.approx(soonest, rel=0.02)


def test_a_unit_counts_once() -> None:
    messages = [ENGINE, TORQUE, SHAFT, WHEEL]
    one = with_common_delay(known_by_differences([ENGINE, SHAFT, WHEEL], [10.0] * 3), [ENGINE, SHAFT, WHEEL], NONE)
    two = with_common_delay(known_by_differences(messages, [10.0] * 4), messages, NONE)
    assert delays_ms(two)[2] == pytest.approx(delays_ms(one)[1])


def test_one_that_is_told_tells_all() -> None:
    told = Message(
        "wheel", ("inputs.wheel_speeds.fl.delay_ms",), (Quantity.WHEEL_SPEED_FL,), Belief(20.0, 0.1), 20.0
    )
    messages = [ENGINE, SHAFT, told]
    found = with_common_delay(known_by_differences(messages, [12.0, 10.0, 16.0]), messages, NONE)
    assert delays_ms(found) == pytest.approx([16.0, 14.0, 20.0], abs=0.05)
    assert 1e3 * found.of(late_name(ENGINE)).sigma < 0.4


def test_all_told_stay() -> None:
    told = Message("engine", ("inputs.engine_speed.delay_ms",), (Quantity.ENGINE_SPEED,), Belief(9.0, 4.0), 9.0)
    before = known_by_differences([told], [9.0])
    assert with_common_delay(before, [told], NONE) is before
