"""`legato train`: from demonstrations to a checkpoint."""

from __future__ import annotations

import os
import sys
import threading
from typing import TYPE_CHECKING

from client.commands import Train
from client.interrupts import INTERRUPTED, postpone_interrupts
from client.offline import missing_extra_told
from client.training.errors import OtherTask
from client.training.plan import TrainingPlan, make_plan
from client.training.progress import RunProgress, open_run_progress
from common.errors import MissingExtra

if TYPE_CHECKING:
    from services.policy.training.run import RunResult


def run(command: Train) -> int:
    """Train what is missing of the run, write the checkpoint, tell where it is."""
    # Threads that wait for each other by spinning starve each other on busy cores.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    try:
        import torch
    except ModuleNotFoundError as error:
        raise MissingExtra("torch", "train") from error
    from services.policy.training.device import leads, leave

    with missing_extra_told():
        plan = make_plan(command)
    torch.set_num_threads(plan.threads)
    stop = threading.Event()
    try:
        with postpone_interrupts(stop), open_run_progress(leads=leads()) as progress:
            result = _train(plan, progress, stop)
    finally:
        leave()
    if not result.done:
        sys.stderr.write("interrupted; run the same command again to go on\n")
        return INTERRUPTED
    return 0


def _train(plan: TrainingPlan, progress: RunProgress, stop: threading.Event) -> RunResult:
    from client.training.policy import TrainedPolicy
    from services.policy.training.data import load_training_data
    from services.policy.training.device import place
    from services.policy.training.run import Intervals, Run

    placement = place(plan.device)
    data = load_training_data(plan.data, plan.config, episodes=plan.episodes)
    if data.origin.tasks != (plan.task,):
        raise OtherTask(plan.task, data.origin.tasks)
    policy = TrainedPolicy(plan, data, progress=progress, stop=stop)
    running = Run(
        plan.folder,
        plan.config,
        data,
        placement=placement,
        progress=progress,
        intervals=Intervals(validate=plan.validate_every),
        evaluate=policy.evaluate if plan.evaluate_trials else None,
        tensorboard=plan.tensorboard,
    )
    result = running.go_on(stop)
    if result.done and placement.leads:
        running.draw()
        sys.stdout.write(policy.finish(result, running.count_timesteps(result.update)) + "\n")
    return result
