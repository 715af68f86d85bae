"""Actions composed again: where the set-point and the reference of an episode must have been."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from common.datasets.spec import DatasetSpec
from common.datasets.store import Episode
from common.errors import InvalidValue
from common.se3 import Array, apply_differential, distance, exp3, log3, make_pose, pose_from_wire


def replay_setpoints(episode: Episode) -> list[Array]:
    """Set-points T_world_setpoint (4, 4) at every row, from the start pose and the actions.

    S_0 is the reference at the first row, where it rests; S_{k+1} = S_k [Exp r_k, p_k; 0, 1].
    """
    setpoints = [pose_from_wire(episode["reference_pose"][0].tolist())]
    for action in episode["action"][:-1].tolist():
        setpoints.append(apply_differential(setpoints[-1], action[:3], action[3:]))
    return setpoints


def replay_errors(episode: Episode, spec: DatasetSpec) -> tuple[Array, Array]:
    """Distance between the recorded references and those that the actions lead to.

    Between two set-points the reference moves straight at constant speed. A row holds it one tick
    before its frame, and later by what the robot is told late and by the latency of its actions.

    Returns:
        (rows,) distances [m] and angles [rad].
    """
    recorded = (pose_from_wire(wire) for wire in episode["reference_pose"].tolist())
    pairs = zip(recorded, _replay_references(episode, spec), strict=True)
    errors = np.array([distance(ours, theirs) for ours, theirs in pairs])
    return errors[:, 0], errors[:, 1]


def _replay_references(episode: Episode, spec: DatasetSpec) -> Iterator[Array]:
    setpoints = replay_setpoints(episode)
    steps = episode["frame_step"].tolist()
    period_ticks = round(spec.tick_rate_hz / spec.rate_hz)
    latency_s = episode.info.details.get("action_latency_s", 0.0)
    if not isinstance(latency_s, int | float):
        raise InvalidValue("action_latency_s of the episode", latency_s, "a time in seconds")
    delay_ticks = 1 + spec.reference_delay_ticks + round(latency_s * spec.tick_rate_hz)
    for step in steps:
        ticks = max(0, step - steps[0] - delay_ticks)
        number, rest = divmod(ticks, period_ticks)
        number = min(number, len(setpoints) - 1)
        following = setpoints[min(number + 1, len(setpoints) - 1)]
        yield _between(setpoints[number], following, rest / period_ticks)


def _between(T_a: Array, T_b: Array, tau: float) -> Array:
    """The pose at share tau of the straight way, in world axes."""
    w = log3(T_b[:3, :3] @ T_a[:3, :3].T)
    p = T_a[:3, 3] + tau * (T_b[:3, 3] - T_a[:3, 3])
    return make_pose(exp3(tau * w) @ T_a[:3, :3], p)
