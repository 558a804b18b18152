"""The summary of a run in sentences, where it could become long."""

from dctorque_can.report.run_lines import _listed


def test_a_few_logs_are_told_one_by_one_and_many_by_the_first_and_the_last() -> None:
    assert _listed([]) == "no file"
    assert _listed(["a.mcap", "b.mcap"]) == "a.mcap, b.mcap"
    many = [f"{k}.mcap" for k in range(9000)]
    assert _listed(many) == "9000 files, from 0.mcap to 8999.mcap"
