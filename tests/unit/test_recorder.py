"""The recorder without a bus: messages in, whole episodes out."""

from __future__ import annotations

import logging

import numpy as np
import pytest

from common import messages as m
from common.datasets import EpisodeMetadata, EpisodeStore, EpisodeWriter
from common.errors import UnknownName
from services.recorder.columns import describe_dataset
from services.recorder.events import EpisodeIncomplete, RecordedEpisode
from services.recorder.reactor import RecorderReactor
from tests.client_samples import make_result

CELL = "sim-0"
POSE = [0.1, -0.3, 0.8, 1.0, 0.0, 0.0, 0.0]
OBJECTS = ("lid", "pot", "stove")


def header(step: int = 0, *, epoch: int = 1, cell: str = CELL) -> m.Header:
    return m.Header(cell=cell, episode="e", epoch=epoch, step=step, t_sim_s=step * 0.01)


def configure(*, epoch: int = 1, mode: str = "lockstep", cell: str = CELL) -> m.EpisodeConfigure:
    return m.EpisodeConfigure(
        header=header(epoch=epoch, cell=cell),
        task="lid",
        robot="abstract",
        policy="expert",
        seed=5,
        mode=mode,
        nodes={"sim": cell},
    )


def pose(x: float) -> list[float]:
    return [x, *POSE[1:]]


def action(
    frame: int, *, dx: float = 0.01, grasp: bool = False, meant: m.Motion | None = None
) -> m.PolicyAction:
    step = m.ActionStep(
        translation_m=[dx, 0.0, 0.0], rotation_rad=[0.0] * 3, grasp=grasp, meant=meant
    )
    at = header(10 * frame)
    return m.PolicyAction(
        header=at, for_step=at.step, request_t_mono_ns=0, steps=[step], inference_s=0.0
    )


def state(step: int) -> m.RobotState:
    return m.RobotState(header=header(step), positions=pose(step), velocities=[0.0] * 6)


def status(step: int) -> m.RetargetStatus:
    return m.RetargetStatus(
        header=header(step),
        for_step=step,
        request_t_mono_ns=0,
        T_world_reference=pose(2.0 + step),
        T_world_tool=POSE,
        hand_error_m=[0.0],
        hand_error_rad=[0.0],
        solve_time_s=[0.0],
        hand_scaling=[1.0],
        scaling=[],
        active_limits=[],
        limited_ticks=0,
        solver_failures=0,
    )


def frame_messages(frame: int) -> list[m.Message]:
    """All that is published from one frame to the next, the action apart."""
    at = header(10 * frame)
    pixels = 128 * 128
    return [
        m.StereoFrame(
            header=at,
            camera="t265",
            width=128,
            height=128,
            left=bytes([frame]) * pixels,
            right=bytes([100 + frame]) * pixels,
            due_step=at.step,
        ),
        m.GroundTruth(
            header=at,
            T_world_tool=pose(1.0 + frame),
            objects={name: pose(10.0 + frame) for name in OBJECTS},
            opening_m=0.1,
        ),
        state(at.step),
        m.GripperState(
            header=at,
            for_step=at.step,
            request_t_mono_ns=0,
            opening_m=0.01 * frame,
            grasp=False,
            moving=False,
            gripped=frame == 2,
        ),
        *(state(at.step + tick) for tick in range(1, 10)),
        status(at.step + 9),
    ]


def result(outcome: str = "success", *, epoch: int = 1) -> m.EpisodeResult:
    return m.EpisodeResult(header=header(epoch=epoch), result=make_result(outcome=outcome))


def play(actions: list[m.PolicyAction], *, without: tuple[type, int] | None = None):
    """Messages of an episode in the order of the bus, one kind left out at one frame."""
    published: list[m.Message] = [configure()]
    for frame, taken in enumerate(actions):
        published += [*frame_messages(frame), taken]
    published.append(result())
    if without is None:
        return published
    kind, step = without
    return [p for p in published if not (isinstance(p, kind) and p.header.step == step)]


def record(published, *, recorder: RecorderReactor | None = None) -> list:
    recorder = recorder or RecorderReactor()
    return [event for message in published for event in recorder.handle([message])]


MOVES = [action(0), action(1, dx=0.02), action(2, grasp=True), action(3, dx=0.04, grasp=True)]


def test_a_row_is_a_frame_and_the_action_computed_from_it():
    (event,) = record(play(MOVES))
    assert isinstance(event, RecordedEpisode)
    assert (event.idle_rows, event.configure.seed, event.result.outcome) == (0, 5, "success")
    columns = event.rows.columns
    assert columns["images"].shape == (4, 2, 128, 128)
    assert columns["images"][:, 0, 5, 7].tolist() == [0, 1, 2, 3]
    assert columns["images"][:, 1, 127, 127].tolist() == [100, 101, 102, 103]
    assert columns["action"][:, 0].tolist() == [0.01, 0.02, 0.01, 0.0]
    assert columns["intended"].tolist() == columns["action"].tolist()
    assert columns["grasp"].tolist() == [0, 0, 1, 1]
    assert columns["tool_pose"][:, 0].tolist() == [1.0, 2.0, 3.0, 4.0]
    assert columns["reference_pose"][:, 0].tolist() == [1.0, 11.0, 21.0, 31.0]
    assert columns["robot_positions"][:, 0].tolist() == [0.0, 10.0, 20.0, 30.0]
    assert columns["opening_m"].tolist() == [0.0, 0.01, 0.02, 0.03]
    assert columns["gripped"].tolist() == [0, 0, 1, 0]
    assert columns["frame_step"].tolist() == columns["state_step"].tolist() == [0, 10, 20, 30]
    assert columns["object_pot"][:, 0].tolist() == [10.0, 11.0, 12.0, 13.0]


def test_what_a_disturbed_demonstrator_meant_is_kept_beside_what_it_did():
    meant = m.Motion(translation_m=[0.03, 0.0, 0.0], rotation_rad=[0.0, 0.1, 0.0])
    (event,) = record(play([MOVES[0], action(1, dx=0.02, meant=meant), *MOVES[2:]]))
    columns = event.rows.columns
    assert columns["action"][:, 0].tolist() == [0.01, 0.02, 0.01, 0.0]
    assert columns["intended"][:, 0].tolist() == [0.01, 0.03, 0.01, 0.0]
    assert columns["intended"][:, 4].tolist() == [0.0, 0.1, 0.0, 0.0]


def test_what_is_recorded_fits_its_data_set(tmp_path):
    (event,) = record(play(MOVES))
    spec = describe_dataset(
        task="lid", robot="abstract", camera="t265", recording={"seed": 0}, software={}
    )
    about = EpisodeMetadata(trial=0, seed=5, outcome="success", details={})
    with EpisodeWriter.open(tmp_path, spec) as out:
        out.append(event.rows, about)
    assert np.array_equal(EpisodeStore.open(tmp_path)[0]["action"], event.rows.columns["action"])
    privileged = {column.name for column in spec.columns if column.privileged}
    assert privileged == {f"object_{name}" for name in OBJECTS}
    assert (spec.rate_hz, spec.tick_rate_hz, spec.reference_delay_ticks) == (10.0, 100.0, 0)


@pytest.mark.parametrize("field", ["task", "robot", "camera"])
def test_unknown_names_have_no_data_set(field):
    names = {"task": "lid", "robot": "abstract", "camera": "t265", field: "x"}
    with pytest.raises(UnknownName):
        describe_dataset(**names, recording={}, software={})


def test_the_order_of_messages_does_not_matter():
    """Receivers drain topics in the order of a table: results before actions before frames."""
    first, *rest, last = play(MOVES)
    (expected,) = record([first, *rest, last])
    recorder = RecorderReactor()
    assert list(recorder.handle([first])) == []
    (event,) = recorder.handle([last, *reversed(rest)])
    assert event.rows.columns.keys() == expected.rows.columns.keys()
    for name, values in expected.rows.columns.items():
        assert np.array_equal(event.rows.columns[name], values)


def test_messages_that_are_sent_again_change_nothing():
    twice = [message for message in play(MOVES) for _ in range(2)]
    events = record(twice)
    assert [type(event) for event in events] == [RecordedEpisode]
    assert len(events[0].rows) == 4


def test_idle_frames_at_the_start_are_dropped_and_counted():
    still = [action(0, dx=0.0), action(1, dx=0.0), action(2), action(3, dx=0.0), action(4)]
    (event,) = record(play(still))
    assert event.idle_rows == 2
    assert event.rows.columns["frame_step"].tolist() == [20, 30, 40]
    assert event.rows.columns["reference_pose"][0, 0] == 21.0


def test_closing_the_fingers_at_once_is_not_idle():
    (event,) = record(play([action(0, dx=0.0, grasp=True), action(1)]))
    assert event.idle_rows == 0


def test_one_row_stays_of_an_episode_without_motion():
    (event,) = record(play([action(frame, dx=0.0) for frame in range(3)]))
    assert (event.idle_rows, len(event.rows)) == (2, 1)


@pytest.mark.parametrize(
    ("lost", "told"),
    [
        ((m.StereoFrame, 10), "frame 1 has no camera/stereo"),
        ((m.PolicyAction, 20), "frame 2 has no policy/action"),
        ((m.GroundTruth, 0), "frame 0 has no truth, no retarget/status"),
        ((m.RobotState, 30), "frame 3 has no robot/state"),
        ((m.GripperState, 10), "frame 1 has no gripper/state"),
        ((m.RetargetStatus, 19), "frame 2 has no retarget/status"),
    ],
)
def test_an_episode_with_a_lost_message_is_told_of(lost, told):
    (event,) = record(play(MOVES, without=lost))
    assert isinstance(event, EpisodeIncomplete)
    assert event.problem == told


def test_an_episode_without_a_frame_is_told_of():
    (event,) = record([configure(), result()])
    assert event.problem == "it has no frame"


def test_a_failed_episode_is_given_on_and_an_aborted_one_is_not():
    *rest, _ = play(MOVES)
    (event,) = record([*rest, result("failure")])
    assert event.result.outcome == "failure"
    assert record([*rest, result("aborted")]) == []
    assert record([*rest, m.EpisodeAbort(header=header(), reason="x"), result()]) == []


def test_each_episode_starts_anew(caplog):
    recorder = RecorderReactor()
    assert not recorder.serves(CELL)
    (first,) = record(play(MOVES), recorder=recorder)
    assert not recorder.serves(CELL)
    (second,) = record(play(MOVES[:2]), recorder=recorder)
    assert (len(first.rows), len(second.rows)) == (4, 2)
    with caplog.at_level(logging.WARNING):
        record(play(MOVES)[:-1], recorder=recorder)
        record([configure(epoch=2)], recorder=recorder)
    assert [entry.message for entry in caplog.records] == ["episode without an end is not recorded"]


def test_cells_are_recorded_apart():
    recorder = RecorderReactor()
    record([configure(cell="sim-1")], recorder=recorder)
    (event,) = record(play(MOVES), recorder=recorder)
    assert event.configure.header.cell == CELL
    assert recorder.serves("sim-1")


def test_in_real_time_the_nearest_state_is_taken_and_its_tick_kept():
    """Only the newest state waits at a receiver: that of the frame's own tick may be gone."""
    published = [p for p in play(MOVES) if not isinstance(p, m.RobotState)]
    states = [state(step) for step in (0, 8, 12, 13, 21, 27, 30, 31)]
    (event,) = record([configure(mode="realtime"), *published[1:-1], *states, published[-1]])
    assert event.rows.columns["state_step"].tolist() == [0, 8, 21, 30]
    assert event.rows.columns["robot_positions"][:, 0].tolist() == [0.0, 8.0, 21.0, 30.0]
