"""A learned policy in one cell: what it remembers between frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from common.errors import UntrainedTask
from common.messages import ActionStep, StereoFrame
from services.policy.learning.checkpoint import Checkpoint
from services.policy.learning.checkpoint_errors import WrongImageSize
from services.policy.learning.images import CAMERA_PX, Images, reduce_images
from services.policy.learning.onnx_signature import POSE_DIMS
from services.policy.policy import Observation
from services.policy.serving.backend import ROWS, Backend, Floats, StepInput
from services.policy.serving.decoding import (
    Decoding,
    choose_action,
    closed_probability,
    decide_grasp,
)


@dataclass(frozen=True)
class Model:
    """A network in memory, for any number of cells.

    Args:
        name: Under which it is served.
        checkpoint: Where it comes from.
        backend: What runs it.
        decoding: From a mixture to an action.
    """

    name: str
    checkpoint: Checkpoint
    backend: Backend
    decoding: Decoding = "most-likely"

    def warm_up(self) -> None:
        """Run the sizes that will be asked for, so that no episode waits for a first time."""
        for cells in (1, ROWS):
            self.backend.run(StepInput.blank(self.checkpoint.config.network, cells=cells))

    def make_policy(self) -> LearnedPolicy:
        """A policy for one cell."""
        return LearnedPolicy(self)


class LearnedPolicy:
    """One cell's policy: the LSTM's state, the actions it commanded, the grasp.

    Args:
        model: Shared with other cells.
    """

    needs_truth = False

    def __init__(self, model: Model) -> None:
        self.model = model
        self._scale = np.array(model.checkpoint.statistics.scale, dtype=np.float64)
        self.reset(seed=0, task=model.checkpoint.config.tasks[0])

    def reset(self, *, seed: int, task: str) -> None:
        """Forget the past and start an episode.

        Raises:
            UntrainedTask: The network was not trained for the task.
        """
        config = self.model.checkpoint.config
        if task not in config.tasks:
            raise UntrainedTask(self.model.name, task, config.tasks)
        # Stream 1 is the expert's, stream 0 the world's.
        self._random = np.random.default_rng([seed, 2])
        self._history = np.zeros((config.network.history.steps, POSE_DIMS), dtype=np.float32)
        self._steps = 0
        self._closed = False
        self._forget()

    def act(self, observation: Observation) -> list[ActionStep]:
        """One step for this cell alone."""
        return step_together([(self, self.observe(observation.frame))])[0]

    def observe(self, frame: StereoFrame) -> StepInput:
        """What the network is given for a frame.

        Raises:
            WrongImageSize: Not the camera's 128 x 128.
        """
        if self._steps % self.model.checkpoint.config.network.window == 0:
            # It was trained on windows that begin with nothing remembered.
            self._forget()
        images = read_images(frame)[None]
        px = self.model.checkpoint.config.image.px
        return StepInput(
            images=reduce_images(images, input_px=px),
            history=self._history[None],
            h=self._h[:, None],
            c=self._c[:, None],
        )

    def decide(
        self, log_weights: Floats, means: Floats, grasp_logit: float | None
    ) -> list[ActionStep]:
        """The action for what the network said, which becomes part of the history."""
        config = self.model.checkpoint.config
        action = choose_action(
            log_weights, means, decoding=self.model.decoding, random=self._random
        )
        self._closed = decide_grasp(
            closed_probability(action, grasp_logit), closed=self._closed, hysteresis=config.grasp
        )
        pose = action[:POSE_DIMS]
        if len(self._history):
            self._history = np.concatenate([self._history[1:], pose[None]])
        self._steps += 1
        commanded = (self._scale * pose).tolist()
        return [
            ActionStep(translation_m=commanded[:3], rotation_rad=commanded[3:], grasp=self._closed)
        ]

    def remember(self, h: Floats, c: Floats) -> None:
        """Keep the LSTM's state (layers, width)."""
        self._h, self._c = h, c

    def _forget(self) -> None:
        lstm = self.model.checkpoint.config.network.lstm
        self._h = np.zeros((lstm.layers, lstm.width), dtype=np.float32)
        self._c = np.zeros_like(self._h)


def step_together(seen: Sequence[tuple[LearnedPolicy, StepInput]]) -> list[list[ActionStep]]:
    """One step for several cells of one model; each gets the bits that it would get alone.

    Args:
        seen: Policies, each with what it `observe`d; at least one.
    """
    said = seen[0][0].model.backend.run(
        StepInput(
            images=np.concatenate([each.images for _, each in seen]),
            history=np.concatenate([each.history for _, each in seen]),
            h=np.concatenate([each.h for _, each in seen], axis=1),
            c=np.concatenate([each.c for _, each in seen], axis=1),
        )
    )
    actions: list[list[ActionStep]] = []
    for cell, (policy, _) in enumerate(seen):
        logit = None if said.grasp_logit is None else float(said.grasp_logit[cell])
        policy.remember(said.h[:, cell], said.c[:, cell])
        actions.append(policy.decide(said.log_weights[cell], said.means[cell], logit))
    return actions


def read_images(frame: StereoFrame) -> Images:
    """Both eyes of a frame, (2, 128, 128), left first.

    Raises:
        WrongImageSize: Not the camera's size.
    """
    if (frame.width, frame.height) != (CAMERA_PX, CAMERA_PX):
        raise WrongImageSize(frame.width, frame.height, CAMERA_PX)
    both = np.frombuffer(frame.left + frame.right, dtype=np.uint8)
    return both.reshape(2, CAMERA_PX, CAMERA_PX)
