"""The pure parts of the benchmark of policies: rows, parsing, tables, the paired test."""

from __future__ import annotations

import json

import pytest

from benchmarks.policy import (
    HARDER,
    NOMINAL,
    Conditions,
    Result,
    Row,
    card_rows,
    compute_mcnemar,
    format_comparison,
    format_results,
    list_rows,
    parse_result,
)
from client.record import EvaluationRecord, to_json
from common.api import StageCounts
from common.robots import list_robots
from tests.client_samples import make_cell, make_evaluation, make_trial


def won(*seeds: int, of: int = 4, robot: str = "panda", conditions: Conditions = NOMINAL) -> Result:
    succeeded = {seed: seed in seeds for seed in range(of)}
    stages = StageCounts(grasped=of, lifted=3, placed=len(seeds), released=len(seeds))
    return Result(Row("lid", robot, conditions), succeeded, stages)


def test_every_robot_is_run_and_the_free_hand_under_each_condition():
    rows = list_rows(["lid", "cup"])
    for task in ("lid", "cup"):
        of_task = [row for row in rows if row.task == task]
        nominal = [row.robot for row in of_task if row.conditions == NOMINAL]
        assert sorted(nominal) == sorted(list_robots())
        harder = [(row.robot, row.conditions) for row in of_task if row.conditions != NOMINAL]
        assert harder == [("abstract", conditions) for conditions in HARDER]


def test_what_the_command_line_prints_is_read_by_seed():
    trials = [
        make_trial(0, seed=11),
        make_trial(1, seed=12, index=1, status="failure"),
        make_trial(2, seed=13, index=2, status="aborted"),
    ]
    record = EvaluationRecord(make_evaluation(cells=[make_cell()]), trials, lambda *_: b"")
    row = Row("lid", "panda", NOMINAL)
    result = parse_result(row, json.dumps(to_json(record)))
    assert result.row == row
    assert result.succeeded == {11: True, 12: False, 13: False}
    assert (result.successes, result.trials) == (1, 3)
    assert result.stages == make_cell().stages


def test_the_mean_is_over_robots_only_and_has_no_interval():
    results = [
        won(0, 1, 2, 3, robot="abstract"),
        won(0, 1),
        won(0, robot="spot"),
        won(robot="abstract", conditions=HARDER[0]),
    ]
    lines = [line.split("  ") for line in format_results(results).splitlines()]
    table = [[cell.strip() for cell in line if cell.strip()] for line in lines]
    assert table[2] == ["lid", "abstract", "nominal", "4/4", "100 % [51-100]", "4/3/4/4"]
    assert table[3] == ["lid", "panda", "nominal", "2/4", "50 % [15-85]", "4/3/2/2"]
    assert table[5] == ["lid", "abstract", "tracking lag 80 ms", "0/4", "0 % [0-49]", "4/3/0/0"]
    assert table[6:] == [["lid", "mean of 2 robots", "nominal", "3/8", "37.5 %", "8/6/3/3"]]


@pytest.mark.parametrize(
    ("first", "second", "b", "c", "p"),
    [
        ([0, 1, 2], [0, 1, 2], 0, 0, 1.0),
        # All of six fair coins alike: 2 / 2^6.
        ([0, 1, 2, 3, 4, 5, 9], [9], 6, 0, 2 / 64),
        # At least five of six alike: 2 (1 + 6) / 2^6.
        ([0, 1, 2, 3, 4], [5], 5, 1, 14 / 64),
        ([5], [0, 1, 2, 3, 4], 1, 5, 14 / 64),
        ([0, 1], [2, 3], 2, 2, 1.0),
    ],
)
def test_mcnemar_counts_the_pairs_that_differ(
    first: list[int], second: list[int], b: int, c: int, p: float
):
    assert compute_mcnemar(won(*first, of=10), won(*second, of=10)) == (b, c, pytest.approx(p))


def test_other_seeds_are_not_compared():
    with pytest.raises(ValueError, match="same seeds"):
        compute_mcnemar(won(of=4), won(of=5))


def test_the_comparison_has_a_row_per_condition():
    lines = format_comparison([won(0, 1, 2, of=10)], [won(2, of=10)]).splitlines()
    assert lines[2].split() == ["lid", "panda", "nominal", "3/10", "1/10", "2", "0", "0.5"]


def test_the_card_says_conditions_seed_and_stages():
    (row,) = card_rows([won(0, 1, robot="abstract", conditions=HARDER[1])], seed=7)
    assert (row.robot, row.task, row.successes, row.trials) == ("abstract", "lid", 2, 4)
    assert row.low95 < 0.5 < row.high95
    assert row.conditions == ("latency 100 ms; seed 7; grasped/lifted/placed/released 4/3/2/2")
