"""One fault at a time in the middle of a trial: what it costs, and how long."""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass
from datetime import UTC, datetime

import pytest

from common.aborts import Cause
from common.api import EvaluationRequest, Trial
from tests.chaos.chronicle import Chronicle
from tests.chaos.faults import Fault
from tests.chaos.recovery import Recovery, measure_recovery
from tests.chaos.system import System, running_system
from tests.deployments import wait_for_running_trial, wait_until_done

pytestmark = [pytest.mark.processes, pytest.mark.chaos]

LEFT, ROUTER = frozenset({Cause.NODE_LEFT}), frozenset({Cause.ROUTER_LEFT})
STOPPED = frozenset({Cause.CONTROL_STOPPED})
SILENT = frozenset({Cause.NODE_LEFT, Cause.NODE_TIMEOUT})
"""Whichever comes first on a busy machine: the end of the lease, or of the cell's patience."""
TRIAL_S = 12.0
"""Of simulated time: a fast machine is not to come to the end before a loss is noticed."""
NONE = frozenset[Cause]()
NODES = ("sim-0", "retarget-abstract", "gripper", "policy")

EXPECTED: tuple[tuple[Fault, frozenset[Cause]], ...] = (
    *((Fault("kill", node), LEFT) for node in NODES),
    (Fault("kill", "router"), ROUTER),
    (Fault("kill", "control"), STOPPED),
    (Fault("stop", "policy", 0.3), NONE),
    (Fault("stop", "control", 0.3), NONE),
    *((Fault("stop", node, 2.0), SILENT) for node in NODES),
    (Fault("stop", "router", 2.0), ROUTER),
    (Fault("stop", "control", 2.0), ROUTER),
    (Fault("cut", "retarget-abstract"), LEFT),
    (Fault("cut", "control"), ROUTER),
    (Fault("stall", "policy", 2.0), SILENT),
    (Fault("stall", "control", 2.0), ROUTER),
    (Fault("unplug", "sim-0", 2.0), LEFT),
    (Fault("unplug", "control", 2.0), ROUTER),
)
"""What happens, and the causes for which the attempt that it hits is aborted; none: it goes on."""


@dataclass(frozen=True)
class Cost:
    """What a fault costs.

    Args:
        fault: Which.
        aborted_after_s: From its beginning to the end of the attempt; None if that went on.
        recovery: From its end.
    """

    fault: Fault
    aborted_after_s: float | None
    recovery: Recovery

    def __str__(self) -> str:
        after_s = self.aborted_after_s
        aborted = "     -" if after_s is None else f"{after_s:6.2f}"
        return (
            f"{self.fault!s:32} {aborted} {self.recovery.ready_s:6.2f} {self.recovery.whole_s:6.2f}"
        )


def test_each_fault_aborts_with_its_cause_and_is_recovered_from(tmp_path, capsys):
    """One system, one evaluation per fault."""
    costs: list[Cost] = []
    with (
        Chronicle().kept() as chronicle,
        running_system(tmp_path, robots=("abstract",), cells=1, trial_s=TRIAL_S) as system,
    ):
        for seed, (fault, causes) in enumerate(EXPECTED):
            costs.append(hit_one_trial(system, fault, causes, seed, chronicle))
    with capsys.disabled():
        sys.stdout.write("\n".join(["", HEADING, *map(str, costs), ""]))


HEADING = f"{'fault':32} {'abort s':>6} {'ready s':>6} {'whole s':>6}"


def hit_one_trial(
    system: System, fault: Fault, causes: frozenset[Cause], seed: int, chronicle: Chronicle
) -> Cost:
    """Run one trial, let a fault happen in its first attempt, and check what comes of it."""
    request = EvaluationRequest(
        tasks=["cup"], robots=["abstract"], policy="expert", trials=1, seed=seed, pictures=False
    )
    evaluation = system.client.submit(request).id
    wait_for_running_trial(system.client, evaluation)
    time.sleep(0.3)
    chronicle.note(str(fault))
    began = datetime.now(UTC)
    end = fault.begin(system)
    if end is not None:
        time.sleep(fault.duration_s)
        end()
    over_s = time.monotonic()
    recovery = measure_recovery(system, since_s=over_s)
    wait_until_done(system.client, evaluation)
    (trial,) = system.client.trials(evaluation)
    return Cost(fault, check_attempts(trial, causes, began), recovery)


def check_attempts(trial: Trial, causes: frozenset[Cause], began: datetime) -> float | None:
    """The first attempt was aborted for one of the causes, the second was not; when [s]."""
    assert trial.status == "failure", trial
    assert trial.reason == f"time limit of {TRIAL_S:.0f} s"
    if not causes:
        assert len(trial.attempts) == 1, trial.attempts
        return None
    first, _ = trial.attempts
    assert first.outcome == "aborted"
    assert first.reason.partition(":")[0] in causes, first.reason
    assert first.finished_at is not None
    return (first.finished_at - began).total_seconds()
