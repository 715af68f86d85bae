"""Evaluations while processes and links fail at random: every trial has one true end."""

from __future__ import annotations

import os
import sys
from collections import Counter, defaultdict
from pathlib import Path
from statistics import median

import pytest

from common.api import EvaluationRequest, Trial
from tests.chaos.agent import ChaosAgent
from tests.chaos.books import check_all
from tests.chaos.chronicle import Chronicle
from tests.chaos.memory import MemoryWatch
from tests.chaos.recovery import Recovery, measure_recovery
from tests.chaos.system import System, running_system
from tests.chaos.workload import FIRST_SEED, Workload, make_requests
from tests.deployments import wait_until_done

pytestmark = pytest.mark.processes

WAIT_S = 40.0
"""For each evaluation; reached only by a test that fails."""
CALM = EvaluationRequest(
    tasks=["cup"],
    robots=["abstract"],
    policy="expert",
    trials=4,
    seed=FIRST_SEED,
    pictures=False,
)
"""Runs before anything fails; two of its trials are run again among faults."""
CALM_TRIES = 10
"""A machine that stands still for longer than the lease is a fault, too."""
PAUSE_IN_TRIALS = 1.5
SHORTEST_PAUSE_S, LONGEST_PAUSE_S = 2.0, 12.0
"""Between faults: a process that was killed needs a second or two to come back."""
READY_AGAIN_S = 30.0
"""A bound for slow machines; what was measured is printed."""
LARGEST_MIB = 512.0
"""What `compose.yaml` allows each process."""
LARGEST_GROWTH_MIB = 64.0


@pytest.mark.long
@pytest.mark.parametrize("seed", [4], ids="seed-{}".format)
def test_a_few_evaluations_survive_faults(seed: int, tmp_path: Path, capsys):
    run(seed, tmp_path, capsys, evaluations=5)


@pytest.mark.chaos
@pytest.mark.parametrize("seed", [1], ids="seed-{}".format)
def test_thirty_evaluations_survive_faults(seed: int, tmp_path: Path, capsys):
    run(seed, tmp_path, capsys, evaluations=30)


def run(seed: int, folder: Path, capsys, *, evaluations: int) -> None:
    """Everything that is asserted, then the figures."""
    with Chronicle().kept() as chronicle:
        with running_system(folder, robots=("abstract", "panda"), cells=2) as system:
            trial_s, calm = time_a_trial(system)
            requests = [*calm, *make_requests(evaluations)]
            workload = Workload(system.client, requests)
            pause_s = min(LONGEST_PAUSE_S, max(SHORTEST_PAUSE_S, PAUSE_IN_TRIALS * trial_s))
            agent = ChaosAgent(system, seed=seed, mean_pause_s=pause_s, chronicle=chronicle)
            with MemoryWatch(lambda: system.supervisor.pids) as memory:
                with agent:
                    workload.run(deadline_s=WAIT_S * evaluations)
                recovery = measure_recovery(system, since_s=agent.last_s)
            trials = check_all(system.client, requests, folder)
            check_nothing_changed(workload, trials)
            check_traces(trials)
            check_memory(memory)
            assert recovery.ready_s < READY_AGAIN_S
            assert not system.supervisor.given_up
        assert chronicle.killed == []
    with capsys.disabled():
        sys.stdout.write(describe(agent, trials, recovery, memory))


def time_a_trial(system: System) -> tuple[float, list[EvaluationRequest]]:
    """The time that a trial takes [s] while nothing disturbs it, and what was run to find out.

    Faults come in proportion to it, or nothing would ever end by itself on a slow machine.
    """
    asked: list[EvaluationRequest] = []
    while len(asked) < CALM_TRIES:
        # No two evaluations are equal.
        asked.append(CALM.model_copy(update={"trials": CALM.trials + len(asked)}))
        evaluation = wait_until_done(system.client, system.client.submit(asked[-1]).id)
        trials = system.client.trials(evaluation.id)
        if times_s := [trial.result.wall_time_s for trial in trials if trial.result is not None]:
            return median(times_s), asked
    raise AssertionError("no trial comes to its end even when nothing is done to it")


def check_traces(trials: list[Trial]) -> None:
    """The same trial has the same trace, whatever happened around it."""
    traces: defaultdict[tuple[str, str, int], set[str]] = defaultdict(set)
    for trial in trials:
        if trial.result is not None:
            traces[trial.task, trial.robot, trial.seed].add(trial.result.trace_sha256)
    assert {len(found) for found in traces.values()} == {1}


def check_nothing_changed(workload: Workload, trials: list[Trial]) -> None:
    """What was once shown as ended was neither run again nor written anew."""
    final = {(trial.evaluation, trial.id): trial for trial in trials}
    assert workload.ended == {key: final[key] for key in workload.ended}


def check_memory(memory: MemoryWatch) -> None:
    """No process is large, and none grows by the faults of the others."""
    assert max(memory.peak_mib.values()) < LARGEST_MIB, memory.peak_mib
    grown = {
        key: growth for key, growth in memory.growth_mib.items() if growth > LARGEST_GROWTH_MIB
    }
    assert not grown


def describe(
    agent: ChaosAgent, trials: list[Trial], recovery: Recovery, memory: MemoryWatch
) -> str:
    """The figures, for people."""
    ends = Counter(trial.status for trial in trials)
    attempts = sum(len(trial.attempts) for trial in trials)
    ended = ", ".join(f"{count} {status}" for status, count in sorted(ends.items()))
    largest = max(memory.peak_mib, key=memory.peak_mib.__getitem__)
    return (
        f"\n{agent.count} faults, one per {agent.mean_pause_s:.1f} s; "
        f"{len(trials)} trials ({ended}) in {attempts} attempts\n"
        f"ready {recovery.ready_s:.2f} s and whole {recovery.whole_s:.2f} s after the last fault, "
        f"at a load of {os.getloadavg()[0]:.0f} on {os.cpu_count()} processors\n"
        f"largest process {largest} {memory.peak_mib[largest]:.0f} MiB, "
        f"largest growth {max(memory.growth_mib.values(), default=0.0):.0f} MiB\n"
    )
