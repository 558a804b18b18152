"""What recordings lack for what stayed unknown."""

from dataclasses import replace

from dctorque_can.config.load import Config
from dctorque_can.evidence.moments import Moments
from dctorque_can.evidence.series import Signal
from dctorque_can.identify.kissing_points import kissing_points
from dctorque_can.identify.manoeuvres import Missing, missing
from dctorque_can.identify.regression import Belief
from dctorque_can.identify.resistances import drives
from dctorque_can.identify.results import Result
from dctorque_can.pipeline.samples import Quantity

RATIO = "vehicle.gears.2.ratio"


def unknown(key: str) -> Result:
    return Result(key, "ratios", "", Belief(1.0, 0.1), Belief(1.0, 0.1), refused=False)


def test_a_launch_with_clutch_2_is_missing(owned_drive: Moments, owned_truth: Config) -> None:
    lacks, unclear = missing(
        drives([owned_drive], owned_truth), owned_truth, kissing_points([owned_drive], owned_truth)
    )
    (only,) = lacks
    assert str(only).startswith(
        "no launch with clutch 2 in these logs; it would tell clutch_phase.clutch2.kissing_point"
    )
    assert unclear == []


def test_what_is_there_and_tells_nothing_is_named(owned_drive: Moments, owned_truth: Config) -> None:
    lacks, unclear = missing(drives([owned_drive], owned_truth), owned_truth, [unknown(RATIO)])
    assert lacks == []
    assert unclear == [RATIO]


def test_a_shorter_drive_has_too_little(owned_drive: Moments, owned_truth: Config) -> None:
    series = owned_drive.series
    first = {quantity: Signal(each.t_s[:0], each.value[:0]) for quantity, each in series.signals.items()}
    first[Quantity.ENGINE_SPEED] = series.signals[Quantity.ENGINE_SPEED]
    nothing = replace(owned_drive, series=replace(series, signals=first), _known={})
    lacks, _ = missing(drives([nothing], owned_truth), owned_truth, [unknown(RATIO)])
    assert lacks == [Missing("steady driving in gear 2", 0.0, 10.0, (RATIO,))]


def test_what_is_known_lacks_nothing(owned_drive: Moments, owned_truth: Config) -> None:
    known = replace(unknown("clutch_phase.clutch2.kissing_point"), after=Belief(1.0, 0.01))
    assert missing(drives([owned_drive], owned_truth), owned_truth, [known]) == ([], [])


def test_seconds_are_told() -> None:
    assert str(Missing("steady driving in gear 2", 1.24, 10.0, ("a", "b"))) == (
        "only 1.2 s of steady driving in gear 2 in these logs, 10 s would do; it would tell a, b"
    )
