"""Whatever a guard is told, its set-points keep to the limits."""

from __future__ import annotations

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from common.braking import stopping_speed
from common.clock import TICK_S
from common.safety import Guard, RobotLimits, SafetyLatch, Setpoint
from common.safety.limits import AxisLimits

axis = st.builds(
    lambda width, v, a, harder: AxisLimits(-width, width, v, a, a * harder),
    st.floats(0.05, 3.0),
    st.floats(0.1, 3.0),
    st.floats(0.5, 30.0),
    st.floats(1.0, 5.0),
)
commands = st.lists(
    st.none() | st.tuples(st.floats(-5.0, 5.0), st.floats(-5.0, 5.0)), min_size=1, max_size=60
)


# Generating many numbers is slow on a busy machine, which says nothing about the guard.
@settings(suppress_health_check=[HealthCheck.too_slow])
@given(axis, commands, st.integers(0, 60))
def test_set_points_keep_to_the_limits(
    limit: AxisLimits, told: list[tuple[float, float] | None], stop_at: int
):
    guard = Guard(RobotLimits((limit,), free_hand=False), [0.0], latch=SafetyLatch())
    guard.start()
    q, v = 0.0, 0.0
    for tick, command in enumerate([*told, *[None] * 40]):
        if tick == stop_at:
            guard.stop()
        if command is not None:
            guard.offer(Setpoint([command[0]], [command[1]]), made_s=tick * TICK_S)
        (q_next,), (v_next,) = guard.step(tick * TICK_S)
        assert abs(v_next) <= limit.velocity * (1 + 1e-5)
        assert abs(v_next - v) <= limit.stop_acceleration * TICK_S * (1 + 1e-5) + 1e-12
        assert abs(q_next - (q + v_next * TICK_S)) <= 2e-6
        assert abs(q_next) <= limit.upper + 1e-4
        room = limit.upper - q_next if v_next > 0 else limit.upper + q_next
        # From wherever it is, it can be stopped within the range.
        assert abs(v_next) <= stopping_speed(max(0.0, room), limit.acceleration, TICK_S) + (
            limit.acceleration * TICK_S * (1 + 1e-5)
        )
        q, v = q_next, v_next
