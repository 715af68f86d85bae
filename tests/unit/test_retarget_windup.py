"""Nothing runs away: neither the set-point from the hand, nor the command from the robot."""

import numpy as np
import pytest

from common.braking import braking_distance
from common.clock import TICK_S
from common.messages import ActionStep
from common.se3 import distance
from services.retarget.reference import GripperReference, Lead
from services.retarget.whole_body import WholeBodyRetargeter, list_limits
from tests.retarget_runs import BODIES, make_retargeter, rest, robot_model, step

LEAD_M, LEAD_RAD = 0.15, 0.6


def _make_reference(locate_hand):
    """A reference that starts at the hand and waits for it."""
    return GripperReference(locate_hand(), lead=Lead(LEAD_M, LEAD_RAD, locate_hand))


def _push_on(retargeter, reference, actions, translation_m, rotation_rad):
    """A policy that asks for the same step again and again; the last reference."""
    for _ in range(actions):
        reference.take([step(translation_m, rotation_rad)])
        for _ in range(10):
            tick = reference.advance()
            retargeter.follow(tick)
    return tick


@pytest.mark.parametrize(
    ("actions", "translation_m", "rotation_rad"),
    [(50, [0.03, 0.0, 0.01], [0.0, 0.0, 0.0]), (25, [0.0, 0.0, 0.0], [0.0, 0.0, 0.1])],
)
@pytest.mark.parametrize("name", BODIES)
def test_a_setpoint_waits_for_the_hand(name, actions, translation_m, rotation_rad):
    retargeter = make_retargeter(name)
    reference = _make_reference(lambda: retargeter.T_world_hand)
    tick = _push_on(retargeter, reference, actions, translation_m, rotation_rad)
    error_m, error_rad = distance(retargeter.T_world_hand, tick.T_world_end)
    # The hand may give way a little in the ticks between two actions.
    assert error_m <= 1.3 * LEAD_M
    assert error_rad <= 1.3 * LEAD_RAD


def test_a_policy_that_turns_round_is_obeyed_at_once():
    retargeter = make_retargeter("panda")
    reference = _make_reference(lambda: retargeter.T_world_hand)
    _push_on(retargeter, reference, 80, [0.03, 0.0, 0.0], [0.0, 0.0, 0.0])
    stretched = retargeter.T_world_hand[0, 3]
    _push_on(retargeter, reference, 12, [-0.03, 0.0, 0.0], [0.0, 0.0, 0.0])
    # 36 cm back, of which the lead was still ahead.
    assert retargeter.T_world_hand[0, 3] < stretched - 0.15


@pytest.mark.parametrize("name", BODIES)
def test_a_command_waits_for_a_robot_that_is_stuck(name):
    model = robot_model(name)
    retargeter = WholeBodyRetargeter(model)
    stuck = list(model.spec.start_positions)
    T = retargeter.T_world_hand.copy()
    T[:3, 3] += [0.3, 0.3, 0.1]
    room = [
        limit.lead + braking_distance(limit.velocity, limit.acceleration, TICK_S)
        for limit in list_limits(model)
    ]
    for _ in range(500):
        motion = retargeter.follow(rest(T), stuck)
        ahead = np.abs(np.array(motion.positions) - stuck)
        assert (ahead <= np.array(room) + 1e-9).all()
    # Let go, it goes on from there.
    measured = motion.positions
    for _ in range(500):
        motion = retargeter.follow(rest(T), measured)
        measured = motion.positions
    before, after = model.compute_tool_pose(np.array(stuck)), retargeter.T_world_hand
    assert distance(after, T)[0] < 0.3 * distance(before, T)[0]


def test_latency_is_no_lead():
    """A robot that does all it is told, late, is never held back."""
    model = robot_model("panda")
    spec = model.spec.model_copy(update={"command_latency_s": 0.05})
    late = WholeBodyRetargeter(type(model)(spec))
    prompt = WholeBodyRetargeter(model)
    T = late.T_world_hand.copy()
    T[:3, 3] += [0.2, 0.1, 0.1]
    told = [list(spec.start_positions)] * 6
    for _ in range(200):
        one = late.follow(rest(T), told[-6])
        told.append(one.positions)
        other = prompt.follow(rest(T))
        assert one.positions == other.positions


def test_the_hand_is_located_when_a_step_is_taken_and_only_then():
    located = []

    def locate_hand():
        located.append(np.eye(4))
        return located[-1]

    reference = GripperReference(np.eye(4), lead=Lead(LEAD_M, LEAD_RAD, locate_hand))
    reference.advance()
    assert len(located) == 0
    reference.take([step([0.01, 0.0, 0.0])] * 2)
    for tick in range(30):
        reference.advance()
        assert len(located) == (1 if tick < 10 else 2)


def test_a_single_step_is_never_cut():
    reference = _make_reference(lambda: np.eye(4))
    action = ActionStep(translation_m=[0.1, 0, 0], rotation_rad=[0, 0, 0.5], grasp=False)
    reference.take([action])
    for _ in range(10):
        tick = reference.advance()
    assert tick.T_world_end[0, 3] == pytest.approx(0.1)
