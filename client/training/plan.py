"""What is to be trained, and where."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from pydantic import ValidationError

from client.commands import Train
from client.training.errors import NoDemonstrations
from common.errors import InvalidValue

if TYPE_CHECKING:
    from services.policy.training.config import TrainingConfig

_PAPER_RATE = 1e-4


@dataclass(frozen=True)
class TrainingPlan:
    """One run.

    Args:
        task: Of the demonstrations.
        data: Folders of the data sets.
        episodes: How many of each are used; None = all.
        folder: Of the run.
        config: Network and optimiser.
        device: As it was asked for.
        threads: Of PyTorch on the CPU.
        validate_every: Updates between two validations.
        evaluate_trials: Closed-loop trials at each of them.
        evaluate_robots: Robots of those trials.
        tensorboard: Whether to log for it.
    """

    task: str
    data: tuple[Path, ...]
    episodes: int | None
    folder: Path
    config: TrainingConfig
    device: str
    threads: int
    validate_every: int
    evaluate_trials: int
    evaluate_robots: tuple[str, ...]
    tensorboard: bool

    @property
    def checkpoint(self) -> Path:
        """Where the policy is written."""
        return self.folder / "checkpoint"


def make_plan(command: Train) -> TrainingPlan:
    """The plan that the arguments mean.

    Raises:
        InvalidValue: A number out of its range.
        NoDemonstrations: There is no data set where it is looked for.
        UnknownName: There is no such task or robot.
    """
    # Here, because `legato --help` does without the packages of a service.
    from common.robots import load_robot
    from common.tasks import load_task

    load_task(command.task)
    robots = command.evaluate_robot or ("abstract",)
    for robot in robots:
        load_robot(robot)
    for option, value, least in (
        ("--threads", command.threads, 0),
        ("--validate-every", command.validate_every, 1),
        ("--evaluate-trials", command.evaluate_trials, 0),
        ("--episodes", command.episodes or 2, 2),
    ):
        if value < least:
            raise InvalidValue(option, value, f"at least {least}")
    default = Path("runs") / "demonstrations" / f"{command.task}-abstract-0"
    data = tuple(Path(folder) for folder in command.data) or (default,)
    for folder in data:
        if not folder.is_dir():
            raise NoDemonstrations(str(folder), command.task)
    name = f"{command.task}-{command.policy}-{command.size}-{command.seed}"
    return TrainingPlan(
        task=command.task,
        data=data,
        episodes=command.episodes,
        folder=command.out or Path("runs") / "training" / name,
        config=make_config(command),
        device=command.device,
        threads=command.threads or _share_of_cores(),
        validate_every=command.validate_every,
        evaluate_trials=command.evaluate_trials,
        evaluate_robots=tuple(robots),
        tensorboard=command.tensorboard,
    )


def _share_of_cores() -> int:
    """Of this process: torchrun says how many there are on this machine."""
    processes = int(os.environ.get("LOCAL_WORLD_SIZE", 1))
    return max(1, (os.cpu_count() or 1) // processes)


def make_config(command: Train) -> TrainingConfig:
    """Network and optimiser that the arguments mean.

    Raises:
        InvalidValue: A number out of its range.
    """
    from services.policy.learning.presets import load_preset
    from services.policy.training.config import OptimiserConfig, TrainingConfig

    network = load_preset(f"{command.policy}-{command.size}")
    loss = network.loss
    if command.invariant_weight is not None:
        if loss.invariant is None:
            expected = "left out: this method has no motion-invariant loss"
            raise InvalidValue("--invariant-weight", command.invariant_weight, expected)
        weighed = loss.invariant.model_copy(update={"weight": command.invariant_weight})
        loss = loss.model_copy(update={"invariant": weighed})
    rate = _PAPER_RATE if command.size == "paper" else OptimiserConfig().learning_rate
    changed = network.model_copy(update={"window": command.window, "loss": loss})
    foresees = network.loss.future is not None and command.pretraining > 0
    pretraining = {"frames": command.pretraining} if foresees else None
    try:
        return TrainingConfig.model_validate(
            {
                "network": changed.model_dump(),
                "pretraining": pretraining,
                "timesteps": command.timesteps,
                "batch_windows": command.batch,
                "optimiser": {"learning_rate": command.learning_rate or rate},
                "precision": command.precision,
                "seed": command.seed,
            }
        )
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(str(part) for part in first["loc"])
        raise InvalidValue(where, first.get("input"), first["msg"]) from error
