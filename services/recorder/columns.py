"""The columns of a recording, and the description of the data set they make."""

from __future__ import annotations

from collections.abc import Mapping

from pydantic import JsonValue

from common.calibration import load_calibration
from common.clock import FRAME_TICKS, TICK_S
from common.datasets import CameraSpec, ColumnSpec, DatasetSpec
from common.datasets.spec import EYES
from common.robots import load_robot
from common.tasks import load_task

ACTION_CONVENTION = (
    "T_world_setpoint of row k+1 = T_world_setpoint of row k [Exp(rx ry rz), (dx dy dz); 0, 1]: "
    "from set-point to set-point, in the frame of the first, never from a measured pose; row k "
    "pairs the frame with the action computed from it; the last action of an episode is zero"
)
_POSE_UNIT = "m, quaternion wxyz"


def object_column(name: str) -> str:
    """Name of the column of an object's pose."""
    return f"object_{name}"


def describe_dataset(
    *,
    task: str,
    robot: str,
    camera: str,
    recording: Mapping[str, JsonValue],
    software: Mapping[str, str],
) -> DatasetSpec:
    """The description of a data set of one task, robot and camera.

    Args:
        task: Name of the task.
        robot: Name of the robot that carries the gripper.
        camera: Name of the calibration.
        recording: How it is made.
        software: Versions of what shapes it.

    Raises:
        UnknownName: There is no such task, robot or camera.
        BadRobotFile: A robot.toml is not valid.
        BadCalibration: A calibration is not valid.
    """
    spec = load_robot(robot)
    optics = CameraSpec.of(load_calibration(camera))
    return DatasetSpec(
        task=task,
        robot=robot,
        rate_hz=1.0 / (FRAME_TICKS * TICK_S),
        tick_rate_hz=1.0 / TICK_S,
        reference_delay_ticks=round(spec.command_latency_s / TICK_S),
        camera=optics,
        action_convention=ACTION_CONVENTION,
        columns=(
            *_observed(optics, spec.nq),
            *(
                ColumnSpec(
                    name=object_column(name),
                    dtype="f64",
                    shape=(7,),
                    unit=_POSE_UNIT,
                    meaning=f"T_world_{name} at the frame",
                    privileged=True,
                )
                for name in sorted(load_task(task).objects)
            ),
        ),
        recording=dict(recording),
        software=dict(software),
    )


def _observed(camera: CameraSpec, positions: int) -> tuple[ColumnSpec, ...]:
    """Everything that a real gripper and robot would measure too."""
    eyes = (EYES, camera.height, camera.width)
    return (
        _column("images", "u8", eyes, "-", "stereo pair: left eye first, rows top-down"),
        _column("action", "f64", (6,), "m, rad", "dx dy dz rx ry rz: see action_convention"),
        _column(
            *("intended", "f64", (6,), "m, rad"),
            "what the demonstrator meant to do instead of the action: what is to be learned",
        ),
        _column("grasp", "u8", (), "-", "grasp of that action: 1 = close"),
        _column("tool_pose", "f64", (7,), _POSE_UNIT, "T_world_tool measured at the frame"),
        _column(
            *("reference_pose", "f64", (7,), _POSE_UNIT),
            "T_world_reference one tick before the frame, as the robot knows it by then",
        ),
        _column("opening_m", "f64", (), "m", "distance between the finger pads"),
        _column("gripped", "u8", (), "-", "1 = the gripper holds something"),
        _column("robot_positions", "f64", (positions,), "rad, m", "RobotState.positions"),
        _column("frame_step", "i64", (), "tick", "tick of the frame"),
        _column("state_step", "i64", (), "tick", "tick of robot_positions"),
    )


def _column(name: str, dtype: str, shape: tuple[int, ...], unit: str, meaning: str) -> ColumnSpec:
    fields = {"name": name, "dtype": dtype, "shape": shape, "unit": unit, "meaning": meaning}
    return ColumnSpec.model_validate(fields)
