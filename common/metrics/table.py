"""THE table of metrics. `docs/metrics.md`, rules and dashboard name no other."""

from __future__ import annotations

from typing import Final

from common.metrics.metric import Metric

_SOLVES_S = (1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 3e-3, 4e-3, 6e-3, 8e-3, 0.01, 0.02, 0.05)
_PASSES_S = (1e-3, 2e-3, 5e-3, 0.01, 0.02, 0.03, 0.05, 0.08, 0.1, 0.2, 0.5, 1.0)
_AGES_S = (5e-4, 1e-3, 2e-3, 5e-3, 0.01, 0.02, 0.03, 0.05, 0.1, 0.2, 0.5, 1.0)
_HANDLES_S = (2e-5, 5e-5, 1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 0.01, 0.05, 0.2, 1.0)
_ERRORS_M = (5e-4, 1e-3, 2e-3, 5e-3, 0.01, 0.02, 0.05, 0.1, 0.2)
_ERRORS_RAD = (2e-3, 5e-3, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5)
_BATCHES = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0)

NODE_INFO: Final = Metric(
    "legato_node_info", "gauge", "every", "1; what the node is", ("kind", "version")
)
HANDLE: Final = Metric(
    "legato_handle_seconds",
    "histogram",
    "every",
    "Time of one call of the service, with everything that waited",
    buckets=_HANDLES_S,
)
RECEIVED: Final = Metric(
    "legato_received_messages_total", "counter", "every", "Messages taken in", ("topic",)
)
PUBLISHED: Final = Metric(
    "legato_published_messages_total", "counter", "every", "Messages sent", ("topic",)
)
REJECTED: Final = Metric(
    "legato_rejected_messages_total",
    "counter",
    "every",
    "Messages of a wrong schema or shape",
    ("topic",),
)
STALE: Final = Metric(
    "legato_stale_messages_total", "counter", "every", "Messages of another epoch", ("topic",)
)
MISSING: Final = Metric(
    "legato_missing_messages_total",
    "counter",
    "every",
    "Gaps: sequence numbers that were never taken in",
    ("topic",),
)
SUPERSEDED: Final = Metric(
    "legato_superseded_messages_total",
    "counter",
    "every",
    "Messages that gave way to a newer one before they were taken in",
    ("topic",),
)
WAITING: Final = Metric(
    "legato_waiting_messages", "gauge", "every", "Messages in the inbox", ("topic",)
)
WAITING_EVENTS: Final = Metric(
    "legato_waiting_events", "gauge", "every", "Questions and comings and goings in the inbox"
)

FOREIGN: Final = Metric(
    "legato_foreign_messages_total",
    "counter",
    "sim, retarget, gripper, policy",
    "Messages dropped because a node sent them that the episode does not name",
    ("topic",),
)

COMMAND_AGE: Final = Metric(
    "legato_command_age_seconds",
    "histogram",
    "sim",
    "From a robot state to the joint command that answers it, on the cell's own clock",
    buckets=_AGES_S,
)
ACTION_AGE: Final = Metric(
    "legato_action_age_seconds",
    "histogram",
    "sim",
    "From a stereo frame to the policy's action for it, on the cell's own clock",
    buckets=_AGES_S,
)
HELD_TICKS: Final = Metric(
    "legato_held_ticks_total",
    "counter",
    "sim",
    "Watchdog, real time: ticks in which the robot held still for want of a young command",
)
COASTED_TICKS: Final = Metric(
    "legato_coasted_ticks_total",
    "counter",
    "sim",
    "Guard, real time: ticks without a new joint command that went on at the last velocity",
)
CLAMPED_TICKS: Final = Metric(
    "legato_clamped_ticks_total",
    "counter",
    "sim",
    "Guard: ticks whose joint command broke a limit and was approached within it",
    ("limit",),
)
FAULTS: Final = Metric(
    "legato_safety_faults_total",
    "counter",
    "sim",
    "Faults and emergency stops that were latched, each when it became the cell's",
    ("code",),
)
MISSED_FRAMES: Final = Metric(
    "legato_missed_frames_total",
    "counter",
    "sim",
    "Deadline, real time: frames without an action when the next frame was due",
)
SKIPPED_TICKS: Final = Metric(
    "legato_skipped_ticks_total",
    "counter",
    "sim",
    "Deadline, real time: ticks given up because the simulation itself was late",
)
RESENDS: Final = Metric(
    "legato_resends_total", "counter", "sim", "Lockstep: ticks that were sent again"
)
CAMERA: Final = Metric(
    "legato_camera_seconds_total", "counter", "sim", "Time spent on drawing stereo frames"
)
PHYSICS: Final = Metric("legato_physics_seconds_total", "counter", "sim", "Time spent on physics")
EPISODES: Final = Metric(
    "legato_episodes_total", "counter", "sim", "Episodes that ended by themselves", ("outcome",)
)

SOLVE: Final = Metric(
    "legato_solve_seconds",
    "histogram",
    "retarget",
    "Time of one retargeting step; its period is 0.01 s",
    ("robot",),
    _SOLVES_S,
)
HAND_ERROR: Final = Metric(
    "legato_hand_error_meters",
    "histogram",
    "retarget",
    "Distance between reference and measured tool, every tick",
    ("robot",),
    _ERRORS_M,
)
HAND_TURN: Final = Metric(
    "legato_hand_error_radians",
    "histogram",
    "retarget",
    "Angle between reference and measured tool, every tick",
    ("robot",),
    _ERRORS_RAD,
)
LIMITED_TICKS: Final = Metric(
    "legato_limited_ticks_total",
    "counter",
    "retarget",
    "Ticks in which a joint stood at a bound",
    ("robot",),
)
SOLVER_FAILURES: Final = Metric(
    "legato_solver_failures_total",
    "counter",
    "retarget",
    "Ticks in which a level fell back to its feasible default",
    ("robot",),
)

OBSERVATION_AGE: Final = Metric(
    "legato_observation_age_seconds",
    "histogram",
    "policy",
    "From the sending of a stereo frame to its taking in; only of frames of the same host",
    buckets=_AGES_S,
)
INFERENCE: Final = Metric(
    "legato_inference_seconds",
    "histogram",
    "policy",
    "Time of one pass of a policy, for all cells that share it",
    buckets=_PASSES_S,
)
BATCH: Final = Metric(
    "legato_inference_cells", "histogram", "policy", "Cells that share a pass", buckets=_BATCHES
)

PEER_ALIVE: Final = Metric(
    "legato_peer_alive",
    "gauge",
    "control",
    "1 = the node is there, 0 = it is gone; of every node that was ever seen, the last 64 lost",
    ("peer_kind", "peer"),
)
TRIALS: Final = Metric(
    "legato_trials_total", "counter", "control", "Trials that have ended", ("outcome",)
)
ABORTED_ATTEMPTS: Final = Metric(
    "legato_aborted_attempts_total",
    "counter",
    "control",
    "Attempts that were aborted and whose trial gets another",
)
RUNNING_EVALUATIONS: Final = Metric(
    "legato_running_evaluations", "gauge", "control", "Evaluations that have not ended"
)
RUNNING_ATTEMPTS: Final = Metric(
    "legato_running_attempts", "gauge", "control", "Trials that a cell has now"
)
PENDING_TRIALS: Final = Metric(
    "legato_pending_trials", "gauge", "control", "Trials that wait for a cell"
)

METRICS: Final = tuple(each for each in list(globals().values()) if isinstance(each, Metric))
