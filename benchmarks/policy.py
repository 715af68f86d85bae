"""Success of a policy: every robot, and Abstract with tracking lag and with latency.

Run: python -m benchmarks.policy FOLDER [--trials 100] [--seed 1000000] [--jobs 2] [--write]
     python -m benchmarks.policy FOLDER --compare FOLDER2

FOLDER is a checkpoint, evaluated on the tasks it was trained for, or the name of a policy that
comes with LEGATO. Each row is one `legato eval --in-process`; `--write` puts the rows into the card
of the checkpoint. `--compare` runs another policy on the same seeds and gives McNemar's exact test
per row: of the seeds on which just one of the two succeeded, how unlikely is this split by chance?
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from scipy.stats import binomtest

from benchmarks.machine import describe_machine
from client.record import count_stages, describe_rate
from client.tables import format_table
from common.api import StageCounts
from common.messages import STAGES
from common.robots import list_robots
from common.statistics import wilson_interval95
from services.policy.learning.checkpoint import EvaluationRow, load_checkpoint, with_evaluation
from services.policy.serving.library import find_shipped

FREE_HAND = "abstract"
PACKAGES = ("mujoco-core", "pin", "piqp", "numpy", "numba", "onnxruntime")
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


@dataclass(frozen=True)
class Conditions:
    """What is made harder: arguments of `legato eval`, and words for a table."""

    name: str
    arguments: tuple[str, ...] = ()


NOMINAL = Conditions("nominal")
HARDER = (
    Conditions("tracking lag 80 ms", ("--tracking-lag-ms", "80")),
    Conditions("latency 100 ms", ("--action-latency-ms", "100")),
)


@dataclass(frozen=True)
class Row:
    """One row of the table, before it is run."""

    task: str
    robot: str
    conditions: Conditions


@dataclass(frozen=True)
class Result:
    """What came out of a row.

    Args:
        row: What was run.
        succeeded: Seed of a trial -> whether it succeeded; an aborted one did not.
        stages: How many trials reached each stage.
    """

    row: Row
    succeeded: dict[int, bool]
    stages: StageCounts

    @property
    def successes(self) -> int:
        """How many trials succeeded."""
        return sum(self.succeeded.values())

    @property
    def trials(self) -> int:
        """How many there were."""
        return len(self.succeeded)


def main() -> int:
    """Evaluate, print, and on request compare and write."""
    args = parse_arguments()
    policies = [args.policy] + ([args.compare] if args.compare else [])
    tasks = args.task or find_tasks(args.policy)
    rows = list_rows(tasks)
    print(describe_machine(PACKAGES))
    print(f"{args.trials} trials per row, seed {args.seed}, lockstep")
    results = run_all(policies, rows, trials=args.trials, seed=args.seed, jobs=args.jobs)
    for policy in policies:
        print(f"\n{describe_policy(policy)}\n{format_results(results[policy])}")
    if args.compare:
        print(f"\nfirst: {args.policy}, second: {args.compare}")
        print(format_comparison(results[args.policy], results[args.compare]))
    if args.write and (folder := find_folder(args.policy)):
        with_evaluation(folder, card_rows(results[args.policy], seed=args.seed))
        print(f"\nwritten to the card of {args.policy}")
    return 0


def parse_arguments() -> argparse.Namespace:
    """The arguments, checked."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("policy", metavar="FOLDER", help="checkpoint, or the name of a policy")
    parser.add_argument("--compare", metavar="FOLDER2", help="another one, on the same seeds")
    parser.add_argument("--task", action="append", help="(default: the checkpoint's, or lid)")
    parser.add_argument("--trials", type=int, default=100, help="per row (%(default)s)")
    parser.add_argument("--seed", type=int, default=1_000_000, help="(%(default)s)")
    parser.add_argument("--jobs", type=int, default=2, help="rows at a time (%(default)s)")
    parser.add_argument("--write", action="store_true", help="rows into the checkpoint's card")
    args = parser.parse_args()
    if args.write and find_folder(args.policy) is None:
        parser.error(f"--write: {args.policy} is no checkpoint")
    if args.compare == args.policy:
        parser.error("--compare: the same policy twice")
    return args


def find_folder(policy: str) -> Path | None:
    """Where a checkpoint is; None for a policy that is code."""
    folder = Path(policy)
    return folder.absolute() if folder.is_dir() else find_shipped().get(policy)


def find_tasks(policy: str) -> tuple[str, ...]:
    """What a checkpoint was trained for; the lid for a policy that is code."""
    folder = find_folder(policy)
    return ("lid",) if folder is None else load_checkpoint(folder).config.tasks


def describe_policy(policy: str) -> str:
    """Its name, and the hash of a checkpoint."""
    folder = find_folder(policy)
    return policy if folder is None else f"{policy}, {load_checkpoint(folder).sha256}"


def list_rows(tasks: Sequence[str]) -> list[Row]:
    """Every robot as it is, then the free hand under each harder condition."""
    return [
        *(Row(task, robot, NOMINAL) for task in tasks for robot in list_robots()),
        *(Row(task, FREE_HAND, conditions) for task in tasks for conditions in HARDER),
    ]


def run_all(
    policies: Sequence[str], rows: Sequence[Row], *, trials: int, seed: int, jobs: int
) -> dict[str, list[Result]]:
    """Run every row with every policy, some at a time."""

    def run(order: tuple[str, Row]) -> Result:
        policy, row = order
        result = run_row(policy, row, trials=trials, seed=seed)
        done = f"{result.successes}/{result.trials}"
        print(policy, row.task, row.robot, row.conditions.name, done, file=sys.stderr)
        return result

    orders = [(policy, row) for row in rows for policy in policies]
    with ThreadPoolExecutor(jobs) as pool:
        running = [pool.submit(run, order) for order in orders]
        try:
            results = [each.result() for each in running]
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
    pairs = list(zip(orders, results, strict=True))
    return {policy: [r for (named, _), r in pairs if named == policy] for policy in policies}


def run_row(policy: str, row: Row, *, trials: int, seed: int) -> Result:
    """Run one row in a process of its own.

    Raises:
        RuntimeError: It did not end well; says what it wrote.
    """
    # A folder is told from a name by its separators.
    given = str(Path(policy).absolute()) if Path(policy).is_dir() else policy
    command = [
        *(sys.executable, "-m", "client.main", "eval", "--in-process", "--json"),
        *("--policy", given, "--task", row.task, "--robot", row.robot),
        *("--trials", str(trials), "--seed", str(seed), *row.conditions.arguments),
    ]
    environment = {**os.environ, **ONE_THREAD}
    said = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    if said.returncode != 0:
        raise RuntimeError(f"{' '.join(command)} ended with {said.returncode}:\n{said.stderr}")
    return parse_result(row, said.stdout)


def parse_result(row: Row, text: str) -> Result:
    """What `legato eval --json` printed for a row."""
    said = json.loads(text)
    (cell,) = said["cells"]
    succeeded = {trial["seed"]: trial["status"] == "success" for trial in said["trials"]}
    return Result(row, succeeded, StageCounts.model_validate(cell["stages"]))


def format_results(results: Sequence[Result]) -> str:
    """The table of one policy, with the mean over the robots of each task.

    The mean has no interval: the robots share their seeds, so their trials are not independent.
    """
    headers = ("task", "robot", "conditions", "success", "rate [95 %]", "/".join(STAGES))
    return format_table(
        headers, [*(_result_cells(result) for result in results), *_mean_cells(results)]
    )


def _result_cells(result: Result) -> tuple[str, ...]:
    row, successes, trials = result.row, result.successes, result.trials
    rate = describe_rate(successes / trials, wilson_interval95(successes, trials))
    return (
        *(row.task, row.robot, row.conditions.name, f"{successes}/{trials}", rate),
        count_stages(result.stages),
    )


def _mean_cells(results: Sequence[Result]) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = []
    for task in dict.fromkeys(result.row.task for result in results):
        robots = [
            result
            for result in results
            if (result.row.task, result.row.conditions) == (task, NOMINAL)
            and result.row.robot != FREE_HAND
        ]
        successes, trials = sum(r.successes for r in robots), sum(r.trials for r in robots)
        stages = StageCounts(**{s: sum(getattr(r.stages, s) for r in robots) for s in STAGES})
        name = f"mean of {len(robots)} robots"
        count = f"{successes}/{trials}"
        rate = f"{100 * successes / trials:.1f} %"
        rows.append((task, name, NOMINAL.name, count, rate, count_stages(stages)))
    return rows


def compute_mcnemar(first: Result, second: Result) -> tuple[int, int, float]:
    """McNemar's exact test of two policies on the same seeds.

    With b seeds on which only the first succeeded and c on which only the second did, the two-sided
    p-value of b successes in b + c fair coin tosses; 1 if b + c = 0.

    Returns:
        b, c and the p-value.

    Raises:
        ValueError: The seeds differ.
    """
    if first.succeeded.keys() != second.succeeded.keys():
        raise ValueError("the two results are not of the same seeds")
    pairs = [(won, second.succeeded[seed]) for seed, won in first.succeeded.items()]
    b, c = pairs.count((True, False)), pairs.count((False, True))
    return b, c, float(binomtest(b, b + c).pvalue) if b + c else 1.0


def format_comparison(first: Sequence[Result], second: Sequence[Result]) -> str:
    """Two policies row by row."""
    headers = ("task", "robot", "conditions", "first", "second", "only first", "only second", "p")
    cells: list[tuple[str, ...]] = []
    for one, other in zip(first, second, strict=True):
        b, c, p = compute_mcnemar(one, other)
        row, trials = one.row, one.trials
        cells.append(
            (
                *(row.task, row.robot, row.conditions.name),
                *(f"{one.successes}/{trials}", f"{other.successes}/{trials}"),
                *(str(b), str(c), f"{p:.3g}"),
            )
        )
    return format_table(headers, cells)


def card_rows(results: Sequence[Result], *, seed: int) -> list[EvaluationRow]:
    """The results as a checkpoint's card keeps them."""
    return [
        EvaluationRow.of(
            robot=result.row.robot,
            task=result.row.task,
            successes=result.successes,
            trials=result.trials,
            conditions=(
                f"{result.row.conditions.name}; seed {seed}; "
                f"{'/'.join(STAGES)} {count_stages(result.stages)}"
            ),
        )
        for result in results
    ]


if __name__ == "__main__":
    sys.exit(main())
