"""Hypothesis strategies that build any valid message."""

from __future__ import annotations

import math

from hypothesis import strategies as st

from common import messages as m

finite = st.floats(allow_nan=False, allow_infinity=False)
positive = st.floats(min_value=0, allow_nan=False, allow_infinity=False)
name = st.from_regex(r"[A-Za-z0-9][A-Za-z0-9_.@-]{0,20}", fullmatch=True)
step = st.integers(0, 2**53)


def vector(n: int, numbers: st.SearchStrategy[float] = finite) -> st.SearchStrategy[list[float]]:
    return st.lists(numbers, min_size=n, max_size=n)


def unit(values: list[float]) -> list[float]:
    return [value / math.hypot(*values) for value in values]


quaternion = vector(4, st.floats(-1, 1)).filter(lambda q: math.hypot(*q) > 0.1).map(unit)
pose = st.builds(lambda p, q: p + q, vector(3), quaternion)
joints = st.lists(st.floats(-1000, 1000), min_size=1, max_size=64)
header = st.builds(
    m.Header,
    cell=name,
    episode=st.text(max_size=40),
    epoch=step,
    source=name,
    seq=step,
    step=st.integers(-1, 2**53),
    t_sim_s=finite,
    t_mono_ns=step,
)
reply = {"header": header, "for_step": step, "request_t_mono_ns": step}
motors = vector(2)
samples = st.lists(positive, min_size=1, max_size=10)
share = st.floats(0, 1)
distribution = st.builds(m.Distribution, median=finite, p95=finite, p99=finite, largest=finite)


@st.composite
def stereo(draw: st.DrawFn) -> m.StereoFrame:
    width, height = draw(st.integers(1, 32)), draw(st.integers(1, 32))
    pixels = st.binary(min_size=width * height, max_size=width * height)
    return m.StereoFrame(
        header=draw(header),
        camera=draw(name),
        width=width,
        height=height,
        left=draw(pixels),
        right=draw(pixels),
        due_step=draw(st.integers(-1, 10**6)),
    )


@st.composite
def picture(draw: st.DrawFn) -> m.EpisodePicture:
    width, height = draw(st.integers(1, 16)), draw(st.integers(1, 16))
    channels = draw(st.sampled_from([1, 3]))
    size = width * height * channels
    return m.EpisodePicture(
        header=draw(header),
        moment=draw(name),
        view=draw(st.sampled_from(["scene", "left", "right"])),
        width=width,
        height=height,
        channels=channels,
        pixels=draw(st.binary(min_size=size, max_size=size)),
    )


result = st.builds(
    m.TrialResult,
    outcome=st.sampled_from(["success", "failure", "aborted"]),
    reason=st.text(max_size=50),
    failed_conditions=st.lists(st.text(max_size=20), max_size=4),
    ticks=step,
    sim_time_s=positive,
    wall_time_s=positive,
    stages=st.builds(
        m.StagesReached,
        grasped=st.booleans(),
        lifted=st.booleans(),
        placed=st.booleans(),
        released=st.booleans(),
    ),
    goal_distance_m=positive,
    hand_error_m=distribution,
    hand_error_rad=distribution,
    hand_scaling_mean=share,
    hand_scaling_least=share,
    limited_share=share,
    solver_failures=step,
    solve_time_s=distribution,
    inference_s=distribution,
    wall_times=st.builds(
        m.WallTimes,
        physics_s=finite,
        camera_s=finite,
        waiting_s=finite,
        solve_s=finite,
        inference_s=finite,
    ),
    held_ticks=step,
    missed_frames=step,
    resends=step,
    trace_sha256=st.text("0123456789abcdef", min_size=64, max_size=64),
)
problem = st.builds(
    m.Problem, code=st.text(), happened=st.text(), expected=st.text(), action=st.text()
)
checkpoint = st.builds(
    m.CheckpointDescription,
    sha256=st.text("0123456789abcdef", min_size=64, max_size=64),
    folder=st.text(min_size=1, max_size=30),
    method=name,
    tasks=st.lists(name, min_size=1, max_size=3),
    runtime=st.text(max_size=20),
    device=st.text(max_size=10),
    decoding=st.sampled_from(["most-likely", "sample"]),
)

STRATEGIES: dict[type[m.Message], st.SearchStrategy[m.Message]] = {
    m.RobotState: st.builds(
        m.RobotState,
        header=header,
        positions=joints,
        velocities=joints,
        due_frame_step=st.integers(-1, 10**6),
    ),
    m.RobotCommand: st.builds(m.RobotCommand, **reply, positions=joints, velocities=joints),
    m.RetargetStatus: st.builds(
        m.RetargetStatus,
        **reply,
        T_world_reference=pose,
        T_world_tool=pose,
        hand_error_m=samples,
        hand_error_rad=samples,
        hand_scaling=st.lists(share, min_size=1, max_size=10),
        scaling=st.lists(share, max_size=8),
        active_limits=st.lists(st.text(max_size=10), max_size=4),
        limited_ticks=step,
        solve_time_s=samples,
        solver_failures=step,
    ),
    m.MotorState: st.builds(
        m.MotorState,
        header=header,
        positions_rad=motors,
        velocities_rad_s=motors,
        currents_a=motors,
        due_frame_step=st.integers(-1, 10**6),
    ),
    m.MotorCommand: st.builds(
        m.MotorCommand, **reply, positions_rad=motors, current_limit_a=positive
    ),
    m.GripperState: st.builds(
        m.GripperState,
        **reply,
        opening_m=positive,
        grasp=st.booleans(),
        moving=st.booleans(),
        gripped=st.booleans(),
    ),
    m.StereoFrame: stereo(),
    m.PolicyAction: st.builds(
        m.PolicyAction,
        **reply,
        steps=st.lists(
            st.builds(
                m.ActionStep,
                translation_m=vector(3, st.floats(-0.5, 0.5)),
                rotation_rad=vector(3, st.floats(-1.8, 1.8)),
                grasp=st.booleans(),
                meant=st.none()
                | st.builds(m.Motion, translation_m=vector(3), rotation_rad=vector(3)),
            ),
            min_size=1,
            max_size=4,
        ),
        inference_s=positive,
    ),
    m.GroundTruth: st.builds(
        m.GroundTruth,
        header=header,
        T_world_tool=pose,
        objects=st.dictionaries(st.text(max_size=8), pose, max_size=3),
        opening_m=finite,
    ),
    m.SafetyStop: st.builds(m.SafetyStop, header=header, by=name, reason=st.text(max_size=200)),
    m.SafetyReset: st.builds(m.SafetyReset, header=header, by=name),
    m.SafetyState: st.builds(
        m.SafetyState,
        header=header,
        status=st.sampled_from(["stopped", "running", "stopping"]),
        fault=st.none() | problem,
        emergency_stop=st.booleans(),
        counts=st.builds(
            m.SafetyCounts,
            foreign_messages=step,
            coasted_ticks=step,
            position_clamps=step,
            velocity_clamps=step,
            acceleration_clamps=step,
        ),
    ),
    m.EpisodeConfigure: st.builds(
        m.EpisodeConfigure,
        header=header,
        task=name,
        robot=name,
        policy=name,
        seed=step,
        mode=st.sampled_from(["lockstep", "realtime"]),
        nodes=st.dictionaries(name, name, max_size=4),
        camera=name,
        action_latency_s=st.floats(0, 1),
        tracking_lag_s=st.floats(0, 1),
        randomise_camera=st.booleans(),
        node_deadline_s=st.floats(min_value=0.1, max_value=600),
        full_grid=st.booleans(),
        pictures=st.booleans(),
    ),
    m.EpisodeReady: st.builds(
        m.EpisodeReady, header=header, node=name, kind=name, problem=st.none() | problem
    ),
    m.EpisodeStart: st.builds(m.EpisodeStart, header=header),
    m.EpisodeAbort: st.builds(m.EpisodeAbort, header=header, reason=st.text()),
    m.EpisodeEvent: st.builds(
        m.EpisodeEvent,
        header=header,
        event=st.sampled_from(["started", "succeeded", "failed", "aborted"]),
        detail=st.text(),
    ),
    m.EpisodePicture: picture(),
    m.EpisodeResult: st.builds(m.EpisodeResult, header=header, result=result),
    m.PolicyLoad: st.builds(
        m.PolicyLoad,
        header=header,
        request=name,
        node=name,
        policy=name,
        folder=st.text(min_size=1, max_size=30),
    ),
    m.PolicyLoaded: st.builds(
        m.PolicyLoaded,
        header=header,
        request=name,
        node=name,
        policy=name,
        checkpoint=st.none() | checkpoint,
        problem=st.none() | problem,
    ),
    m.NodeDescription: st.builds(
        m.NodeDescription,
        header=header,
        kind=name,
        node=name,
        code_version=st.text(),
        packages=st.dictionaries(name, st.text(), max_size=3),
        host=st.text(),
        pid=step,
        started_unix_s=positive,
        offers=st.dictionaries(name, st.lists(name, max_size=3), max_size=3),
        checkpoints=st.dictionaries(name, checkpoint, max_size=2),
    ),
    m.NodeMetrics: st.builds(
        m.NodeMetrics,
        header=header,
        node=name,
        handled=step,
        published=step,
        rejected=step,
        superseded=step,
        stale=step,
        gaps=step,
        handle_time_s=positive,
    ),
}

any_message = st.one_of(*STRATEGIES.values())
rotation_vector = st.lists(
    st.one_of(st.floats(-3, 3), st.floats(-1e-7, 1e-7)), min_size=3, max_size=3
).filter(lambda w: math.hypot(*w) < math.pi - 1e-3)
