"""The policy that a run trains: written as a checkpoint, evaluated in closed loop."""

from __future__ import annotations

import sys
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from client.commands import Eval
from client.offline import run_in_process
from client.progress import SilentProgress
from client.request import build_request
from client.training.card import make_card
from client.training.plan import TrainingPlan
from client.training.progress import RunProgress
from common.api import CellSummary

if TYPE_CHECKING:
    from services.policy.learning.checkpoint_card import CheckpointCard
    from services.policy.training.data import TrainingData
    from services.policy.training.run import RunResult
    from services.policy.training.trainer import Trainer

SEED = 1_000_000
"""Of closed-loop trials; demonstrations are recorded with others."""
_IN_TRAINING = "in-training"


class TrainedPolicy:
    """What comes out of a run.

    Args:
        plan: Of the run.
        data: That it is trained on.
        progress: Is told what trials gave.
        stop: Ends trials when set.
    """

    def __init__(
        self,
        plan: TrainingPlan,
        data: TrainingData,
        *,
        progress: RunProgress,
        stop: threading.Event,
    ) -> None:
        self._plan, self._data = plan, data
        self._progress, self._stop = progress, stop

    def evaluate(self, trainer: Trainer, update: int) -> float:
        """Success rate of the network as it is, over all robots of the plan."""
        card = make_card(sys.argv[1:], self._data.origin, steps=update)
        folder = self._plan.folder / _IN_TRAINING
        self._save(folder, trainer, card)
        cells = self._run_trials(folder)
        self._progress.evaluated(update, describe_cells(cells))
        trials = sum(cell.trials for cell in cells)
        return sum(cell.successes for cell in cells) / max(1, trials)

    def finish(self, result: RunResult, timesteps: int) -> str:
        """Write the checkpoint, with its evaluation if one is asked for; say what there is."""
        from services.policy.learning.checkpoint import EvaluationRow, with_evaluation

        card = make_card(
            sys.argv[1:],
            self._data.origin,
            steps=result.update,
            timesteps=timesteps,
            trained_s=result.trained_s,
            last=result.last,
            validation=result.validation,
        )
        folder = self._plan.checkpoint
        digest = self._save(folder, result.trainer, card)
        words = [
            f"{folder}: {digest[:12]}",
            f"{result.update} updates",
            f"{self._data.origin.episodes} demonstrations",
            f"{result.trained_s / 60:.1f} min",
        ]
        if self._plan.evaluate_trials and not self._stop.is_set():
            cells = self._run_trials(folder)
            rows = [
                EvaluationRow.of(
                    robot=cell.robot,
                    task=cell.task,
                    successes=cell.successes,
                    trials=cell.trials,
                    conditions=f"seed {SEED}",
                )
                for cell in cells
            ]
            with_evaluation(folder, rows)
            words.append(describe_cells(cells))
        return ", ".join(words)

    def _save(self, folder: Path, trainer: Trainer, card: CheckpointCard) -> str:
        from services.policy.learning.checkpoint import (
            CheckpointConfig,
            ImageSpec,
            save_checkpoint,
        )

        network = self._plan.config.network
        config = CheckpointConfig(
            network=network,
            image=ImageSpec(px=network.encoder.input_px),
            tasks=(self._plan.task,),
            seed=self._plan.config.seed,
        )
        return save_checkpoint(
            folder, trainer.network, config=config, statistics=trainer.statistics, card=card
        )

    def _run_trials(self, folder: Path) -> Sequence[CellSummary]:
        request = build_request(
            Eval(
                task=(self._plan.task,),
                robot=self._plan.evaluate_robots,
                policy=(folder.name,),
                trials=self._plan.evaluate_trials,
                seed=SEED,
            ),
            pictures=False,
        )
        with SilentProgress() as progress:
            record = run_in_process(
                request,
                progress=progress,
                stop=self._stop,
                checkpoints={folder.name: folder.absolute()},
            )
        return record.evaluation.cells


def describe_cells(cells: Sequence[CellSummary]) -> str:
    """Successes by robot, e.g. `abstract 18/20  panda 15/20`."""
    return "  ".join(f"{cell.robot} {cell.successes}/{cell.trials}" for cell in cells)
