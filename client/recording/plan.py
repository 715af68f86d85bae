"""What is to be recorded, and where."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from client.commands import DemoRecord, Eval
from client.recording.variation import NOMINAL, Variation
from client.request import build_request
from common.api import EvaluationRequest
from common.datasets import DatasetSpec
from common.errors import InvalidValue, UnknownName

DEMONSTRATORS = ("expert", "expert-noisy")
_MAX_WORKERS = 1024


@dataclass(frozen=True)
class Plan:
    """One recording.

    Args:
        request: Task, robot, camera and seed, as an evaluation of one trial.
        episodes: Successful demonstrations that are wanted.
        workers: Processes.
        keep_failed: Whether failed ones are stored too.
        folder: Of the data set.
        variation: How trials differ from the nominal one.
    """

    request: EvaluationRequest
    episodes: int
    workers: int
    keep_failed: bool
    folder: Path
    variation: Variation = NOMINAL

    def describe(self) -> DatasetSpec:
        """The description of its data set.

        Raises:
            UnknownNames: There is no such task or robot.
            UnknownName: There is no such camera.
            MissingExtra: A package of a service is not installed.
        """
        # Here, because they import the physics engine and the solvers.
        from client.offline import check_request_here, list_software, missing_extra_told
        from services.recorder.columns import describe_dataset

        with missing_extra_told():
            check_request_here(self.request)
            software = list_software()
        return describe_dataset(
            task=self.request.tasks[0],
            robot=self.request.robots[0],
            camera=self.request.camera,
            recording={
                "policy": self.request.policy_names[0],
                "seed": self.request.seed,
                "mode": self.request.mode,
                "keep_failed": self.keep_failed,
                "variation": self.variation.model_dump(),
            },
            software=software,
        )


def make_plan(command: DemoRecord) -> Plan:
    """The plan that the arguments mean.

    Raises:
        InvalidValue: A number out of its range, or a name that cannot be one.
    """
    if command.episodes < 1:
        raise InvalidValue("--episodes", command.episodes, "at least 1")
    if not 0 <= command.workers <= _MAX_WORKERS:
        raise InvalidValue("--workers", command.workers, f"0 to {_MAX_WORKERS}")
    if command.policy not in DEMONSTRATORS:
        raise UnknownName("demonstrator", command.policy, DEMONSTRATORS)
    names = Eval(
        task=(command.task,),
        robot=(command.robot,),
        policy=(command.policy,),
        trials=1,
        seed=command.seed,
        camera=command.camera,
        tracking_lag_ms=command.tracking_lag_ms,
        action_latency_ms=command.action_latency_ms,
        randomise_camera=command.randomise_camera,
    )
    request = build_request(names, pictures=False)
    name = f"{command.task}-{command.robot}-{command.seed}"
    return Plan(
        request=request,
        episodes=command.episodes,
        workers=min(command.workers or _count_cores(), command.episodes),
        keep_failed=command.keep_failed,
        variation=Variation(
            tracking_lag_s=request.tracking_lag_s,
            action_latency_s=request.action_latency_s,
            randomise_camera=request.randomise_camera,
        ),
        folder=command.out or Path("runs") / "demonstrations" / name,
    )


def _count_cores() -> int:
    """Cores that this process may use; where the system does not say, all of them."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
