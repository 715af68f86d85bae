"""What a policy is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from common.messages import ActionStep, GroundTruth, StereoFrame


@dataclass(frozen=True)
class Observation:
    """What a policy is given ten times a second.

    Args:
        frame: The stereo pair.
        truth: Poses of the scene, only for policies that declare `needs_truth`.
    """

    frame: StereoFrame
    truth: GroundTruth | None


class Policy(Protocol):
    """Decides one cell's actions. One instance serves one cell; its state ends with `reset`."""

    needs_truth: bool
    """True for scripted experts. Learned policies never see ground truth."""

    def reset(self, *, seed: int, task: str) -> None:
        """Forget the past and start an episode.

        Args:
            seed: Decides every random choice of the episode.
            task: Which task is to be done.

        Raises:
            UnknownName: The policy does not know the task.
        """
        ...

    def act(self, observation: Observation) -> list[ActionStep]:
        """Next differential pose(s) of the gripper set-point, in the set-point's frame."""
        ...
