"""A file that others wrote, as LEGATO's demonstrations: every known trap is looked for."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from common import __version__
from common.calibration import load_calibration
from common.datasets import (
    CameraSpec,
    ColumnSpec,
    DatasetSpec,
    EpisodeMetadata,
    EpisodeRows,
    Rows,
)
from common.datasets.spec import EYES, IMAGES
from common.errors import InvalidValue
from common.formats.labels import Bytes, Floats
from common.formats.robomimic.extras import Extra, find_extras
from common.formats.robomimic.options import ImportOptions
from common.formats.robomimic.source import Demo
from common.formats.rotations import vectors_from_rpy
from common.robots import load_robot
from common.se3 import apply_differential, pose_to_wire
from common.tasks import load_task

TICK_RATE_HZ = 100.0
_GRASPS = (np.array([0.0, 1.0]), np.array([-1.0, 1.0]))


class ForeignFile:
    """The episodes of a file that LEGATO did not write.

    Args:
        path: Of the file.
        demos: All of them: only what every one has becomes a column.
        options: What the file does not say.

    Raises:
        InvalidValue: An option that is needed is missing, or has no meaning.
        UnknownName: There is no such task, robot or camera.
    """

    def __init__(self, path: str, demos: Sequence[Demo], options: ImportOptions) -> None:
        self._options = options
        self._extras, left_out = find_extras(demos, skip=(options.left, options.right))
        self.spec = _describe(path, options, self._extras)
        self._not_ended = 0
        self._left_out = left_out

    @property
    def notes(self) -> tuple[str, ...]:
        """What is to be known of the import, in sentences."""
        told = [f"left out: {name} ({why})" for name, why in self._left_out.items()]
        if self._not_ended:
            told.append(
                f"the last action of {self._not_ended} episodes is not zero, as it is in LEGATO's "
                "own recordings; `legato data check` tells of it"
            )
        return tuple(told)

    def convert(self, demo: Demo) -> tuple[EpisodeRows, EpisodeMetadata]:
        """The episode of a demonstration.

        Raises:
            BadForeignFile: Something in it is missing or has another form.
        """
        action, grasp = self._read_actions(demo)
        idle = 0 if self._options.keep_idle else count_idle(action, grasp)
        columns: dict[str, Rows] = {
            IMAGES: self._see(demo),
            "action": action,
            "grasp": grasp,
            "tool_pose": compose_poses(action),
        }
        for extra in self._extras:
            columns[extra.column.name] = extra.read(demo)
        if np.any(action[-1]):
            self._not_ended += 1
        metadata = EpisodeMetadata(
            trial=int(demo.name.removeprefix("demo_")),
            seed=0,
            outcome="success",
            details={"reason": "imported", "demo": demo.name, "idle_rows_dropped": idle},
        )
        return EpisodeRows({name: rows[idle:] for name, rows in columns.items()}), metadata

    def _read_actions(self, demo: Demo) -> tuple[Floats, Bytes]:
        """(n, 6) action [m, rad] and (n,) grasp, 1 = close."""
        stored = demo.read("actions").astype(np.float64)
        if not np.isfinite(stored).all():
            raise demo.wrong("actions has a value that is not a number", "finite numbers")
        turns = stored[:, 3:6] * self._options.radians
        if self._options.rotations == "rpy":
            turns = vectors_from_rpy(turns)
        action = np.concatenate([stored[:, :3] * self._options.metres, turns], axis=1)
        levels = np.unique(stored[:, 6])
        if not any(np.isin(levels, known).all() for known in _GRASPS):
            told = ", ".join(f"{level:g}" for level in levels[:4])
            raise demo.wrong(f"actions has grasps {told}", "0 and 1, or -1 and 1")
        return action, (stored[:, 6] > 0.0).astype(np.uint8)

    def _see(self, demo: Demo) -> Bytes:
        """(n, 2, height, width), left eye first."""
        camera = self.spec.camera
        eyes = [
            demo.read_gray(f"obs/{name}", height=camera.height, width=camera.width)
            for name in (self._options.left, self._options.right)
        ]
        images = np.stack(eyes, axis=1)
        return images[..., ::-1] if self._options.mirrored else images


def count_idle(action: Floats, grasp: Bytes) -> int:
    """How many rows at the start do nothing: no motion, open fingers; the last row is no such."""
    busy = np.flatnonzero(action.any(axis=1) | (grasp != 0))
    return int(busy[0]) if len(busy) else len(action) - 1


def compose_poses(action: Floats) -> Floats:
    """(n, 7) poses x y z [m], qw qx qy qz in the frame of the first row, to which actions lead."""
    T_start_tool = np.eye(4)
    poses = [pose_to_wire(T_start_tool)]
    for step in action[:-1].tolist():
        T_start_tool = apply_differential(T_start_tool, step[:3], step[3:])
        poses.append(pose_to_wire(T_start_tool))
    return np.array(poses)


def _describe(path: str, options: ImportOptions, extras: Sequence[Extra]) -> DatasetSpec:
    """The description of the data set."""
    if options.task is None or options.robot is None:
        missing = "--task" if options.task is None else "--robot"
        raise InvalidValue(missing, None, "a name, as the file does not say it")
    if options.rotations is None:
        raise InvalidValue("--rotations", None, "vector or rpy, as the file does not say it")
    for name in ("metres", "radians", "rate_hz"):
        if not 0.0 < getattr(options, name) < np.inf:
            value = getattr(options, name)
            raise InvalidValue(f"--{name.replace('_', '-')}", value, "a number above 0")
    load_task(options.task)
    load_robot(options.robot)
    camera = CameraSpec.of(load_calibration(options.camera))
    return DatasetSpec(
        task=options.task,
        robot=options.robot,
        rate_hz=options.rate_hz,
        tick_rate_hz=TICK_RATE_HZ,
        reference_delay_ticks=0,
        camera=camera,
        action_convention="dx dy dz [m] and rotation vector [rad] of each step as the imported "
        "file has them, rotations converted; in which frame, is up to whoever recorded it",
        columns=(*_list_columns(camera), *(extra.column for extra in extras)),
        recording={
            "imported_from": path.rpartition("/")[2],
            "format": "robomimic",
            **{name: value for name, value in options.given().items()},
        },
        software={"legato": __version__},
    )


def _list_columns(camera: CameraSpec) -> tuple[ColumnSpec, ...]:
    eyes = (EYES, camera.height, camera.width)
    return (
        ColumnSpec(
            name=IMAGES,
            dtype="u8",
            shape=eyes,
            unit="-",
            meaning="stereo pair: left eye first, rows top-down",
        ),
        ColumnSpec(
            name="action",
            dtype="f64",
            shape=(6,),
            unit="m, rad",
            meaning="dx dy dz rx ry rz: see action_convention",
        ),
        ColumnSpec(name="grasp", dtype="u8", unit="-", meaning="1 = close"),
        ColumnSpec(
            name="tool_pose",
            dtype="f64",
            shape=(7,),
            unit="m, quaternion wxyz",
            meaning="T_start_tool as the actions make it, from the first row; not measured",
        ),
    )
