from __future__ import annotations

import itertools

import numpy as np
import pytest

from common import messages as m
from common.se3 import apply_differential, distance, exp3, make_pose, pose_from_wire, pose_to_wire
from services.policy.expert import ExpertPolicy
from services.policy.min_jerk import MinJerkSegment, min_jerk
from services.policy.policy import Observation
from services.policy.reactor import PolicyReactor
from services.policy.registry import BUILT_IN
from tests.strangers import STRANGER, by_stranger, dropped, strangers_told

CELL = "sim-0"


def header(step: int = 0) -> m.Header:
    return m.Header(cell=CELL, epoch=1, source=CELL, step=step, t_mono_ns=7 + step)


def configure(policy: str = "expert", task: str = "lid") -> m.EpisodeConfigure:
    return m.EpisodeConfigure(
        header=header(),
        task=task,
        robot="abstract",
        policy=policy,
        seed=3,
        mode="lockstep",
        nodes={"sim": CELL, "policy": "policy"},
    )


def frame(step: int) -> m.StereoFrame:
    return m.StereoFrame(
        header=header(step),
        camera="t265",
        width=1,
        height=1,
        left=b"0",
        right=b"0",
        due_step=step,
    )


def truth(step: int, T_world_tool: np.ndarray | None = None) -> m.GroundTruth:
    start = make_pose(np.eye(3), [0.1, -0.3, 0.8]) if T_world_tool is None else T_world_tool
    return m.GroundTruth(
        header=header(step),
        T_world_tool=pose_to_wire(start),
        objects={
            "pot": [0.68, 0.0, 0.72, 1, 0, 0, 0],
            "lid": [0.62, -0.25, 0.70, 1, 0, 0, 0],
            "stove": [0.68, 0.0, 0.70, 1, 0, 0, 0],
        },
        opening_m=0.1036,
    )


def test_min_jerk_starts_and_ends_at_rest():
    h = 1e-5
    assert min_jerk(0.0) == 0.0
    assert min_jerk(1.0) == pytest.approx(1.0)
    assert min_jerk(h) / h < 1e-8
    assert (1.0 - min_jerk(1.0 - h)) / h < 1e-8


@pytest.mark.parametrize(("way_m", "angle_rad"), [(0.3, 0.0), (0.0, 0.7), (0.2, 0.6)])
def test_a_segment_keeps_its_speed_limits_and_arrives(way_m: float, angle_rad: float):
    T_start = make_pose(exp3([0.1, 0.2, 0.3]), [0.0, 0.0, 0.5])
    T_end = make_pose(T_start[:3, :3] @ exp3([0.0, angle_rad, 0.0]), [way_m, 0.0, 0.5])
    segment = MinJerkSegment(T_start, T_end, speed_m_s=0.25, turn_rad_s=1.2, period_s=0.1)
    poses = [segment.pose(i) for i in range(segment.steps + 3)]
    steps = [distance(a, b) for a, b in itertools.pairwise(poses)]
    assert max(s[0] for s in steps) <= 0.025 + 1e-9
    assert max(s[1] for s in steps) <= 0.12 + 1e-9
    np.testing.assert_allclose(poses[segment.steps], T_end, atol=1e-12)
    np.testing.assert_allclose(poses[-1], T_end, atol=1e-12)


def test_an_even_segment_never_slows_down_to_rest():
    T_start, T_end = make_pose(np.eye(3), [0.0, 0.0, 0.5]), make_pose(np.eye(3), [0.3, 0.0, 0.5])
    segment = MinJerkSegment(
        T_start, T_end, speed_m_s=0.25, turn_rad_s=1.2, period_s=0.1, evenness=0.4
    )
    poses = [segment.pose(i) for i in range(segment.steps + 1)]
    steps_m = [distance(a, b)[0] for a, b in itertools.pairwise(poses)]
    mean_m = 0.3 / segment.steps
    assert min(steps_m) >= 0.4 * mean_m
    assert max(steps_m) <= 0.025 + 1e-9
    np.testing.assert_allclose(poses[-1], T_end, atol=1e-12)


def test_the_expert_moves_its_setpoint_by_its_own_actions_only():
    """Whatever the tool really does, actions compose to the path the expert meant."""
    expert = ExpertPolicy()
    expert.reset(seed=3, task="lid")
    T = pose_from_wire(truth(0).T_world_tool)
    heights = []
    for i in range(60):
        (step,) = expert.act(Observation(frame(10 * i), truth(10 * i)))
        T = apply_differential(T, step.translation_m, step.rotation_rad)
        heights.append(T[2, 3])
        assert np.linalg.norm(step.translation_m) < 0.04
    # It has gone to the lid and pitched down, though the reported tool never moved.
    assert T[0, 0] < 0.85
    assert abs(T[1, 3] + 0.25) < 0.03
    assert np.all(np.isfinite(heights))


def test_demonstrators_differ_and_repeat():
    def actions(seed: int) -> list[list[float]]:
        expert = ExpertPolicy()
        expert.reset(seed=seed, task="lid")
        return [
            expert.act(Observation(frame(10 * i), truth(10 * i)))[0].translation_m
            for i in range(20)
        ]

    assert actions(1) == actions(1)
    assert actions(1) != actions(2)


def test_an_unknown_policy_or_task_is_a_problem_not_a_crash():
    reactor = PolicyReactor(node="policy")
    for wrong in (configure(policy="exprt"), configure(task="lidd")):
        (ready,) = reactor.handle([wrong])
        assert isinstance(ready, m.EpisodeReady)
        assert ready.problem is not None
        assert ready.problem.code == "E-UNKNOWN-NAME"
        assert not reactor.serves(CELL)


def test_the_expert_acts_once_per_frame_when_truth_and_frame_are_there():
    reactor = PolicyReactor(node="policy")
    (ready,) = reactor.handle([configure()])
    assert isinstance(ready, m.EpisodeReady)
    assert ready.problem is None
    assert list(reactor.handle([frame(0)])) == []
    (action,) = reactor.handle([truth(0)])
    assert isinstance(action, m.PolicyAction)
    assert action.for_step == 0
    assert action.request_t_mono_ns == 7
    # A resent pair is answered once, with the same action; a new frame needs its own truth.
    assert list(reactor.handle([frame(0), truth(0)])) == [action]
    assert list(reactor.handle([frame(10)])) == []


def test_a_strangers_pictures_and_truth_are_not_looked_at(caplog):
    reactor = PolicyReactor(node="policy")
    reactor.handle([configure()])
    assert list(reactor.handle([by_stranger(frame(0)), truth(0)])) == []
    assert list(reactor.handle([by_stranger(truth(0))])) == []
    (action,) = reactor.handle([frame(0)])
    assert isinstance(action, m.PolicyAction)
    # Not from memory either.
    assert list(reactor.handle([by_stranger(frame(0))])) == []
    assert list(reactor.handle([frame(0)])) == [action]
    assert dropped(reactor) == {"camera/stereo": 2, "truth": 1}
    assert strangers_told(caplog) == [STRANGER]


@pytest.mark.parametrize("name", sorted(BUILT_IN))
def test_policies_without_truth_never_get_it(name: str):
    seen: list[Observation] = []
    policy = BUILT_IN[name]()
    original = policy.act

    def act(observation: Observation) -> list[m.ActionStep]:
        seen.append(observation)
        return original(observation)

    policy.act = act  # type: ignore[method-assign]
    reactor = PolicyReactor(node="policy", policies={name: lambda: policy})
    reactor.handle([configure(policy=name)])
    reactor.handle([truth(0), frame(0)])
    assert len(seen) == 1
    assert (seen[0].truth is not None) == policy.needs_truth
