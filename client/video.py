"""A video of a recorded episode, from the task's viewpoint."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from common.datasets import DatasetSpec, Episode
from common.errors import InvalidValue, MissingExtra, NotWritable

if TYPE_CHECKING:
    from PIL import Image

WIDTH_PX, HEIGHT_PX = 480, 360
FORMATS = {".webp": "WEBP", ".gif": "GIF", ".png": "PNG"}
"""Animated pictures: every browser shows them, and no further package is needed."""
_OBJECT = "object_"


def write_video(
    episode: Episode, path: Path, *, spec: DatasetSpec, meshes: Path | None = None
) -> int:
    """Draw every row of an episode and write an animation that runs at its rate.

    Args:
        episode: With the columns of a recording.
        path: File to write: .webp, .gif, or .png (an animated one).
        spec: Of its data set.
        meshes: Folder of the robot's meshes; without it, it is drawn from primitives.

    Returns:
        How many frames it has.

    Raises:
        InvalidValue: The file's name has another ending.
        MissingExtra: Pillow, or a package of the simulation, is not installed.
        BadMeshes: The robot has no meshes, or they are not in that folder.
        MeshesDoNotFit: The meshes would not move as the robot does.
        NotWritable: The file cannot be written.
    """
    kind = FORMATS.get(path.suffix.lower())
    if kind is None:
        raise InvalidValue("--video", path.name, f"a name that ends with {', '.join(FORMATS)}")
    try:
        frames = list(_draw(episode, spec, meshes))
    except ModuleNotFoundError as error:
        extra = "meshes" if meshes else "all"
        raise MissingExtra(error.name or "of the simulation", extra) from error
    first, *others = frames
    try:
        first.save(
            path,
            format=kind,
            save_all=True,
            append_images=others,
            duration=round(1000 / spec.rate_hz),
            loop=0,
        )
    except OSError as error:
        raise NotWritable(str(path), error.strerror or str(error)) from error
    return len(frames)


def _draw(episode: Episode, spec: DatasetSpec, meshes: Path | None) -> Iterator[Image.Image]:
    from PIL import Image

    from services.sim.replay import Replay

    replay = Replay(
        task=spec.task, robot=spec.robot, width=WIDTH_PX, height=HEIGHT_PX, meshes=meshes
    )
    names = [each.name for each in spec.columns if each.name.startswith(_OBJECT)]
    for row in range(len(episode)):
        pixels = replay.draw(
            episode["robot_positions"][row].tolist(),
            float(episode["opening_m"][row]),
            {name.removeprefix(_OBJECT): episode[name][row].tolist() for name in names},
        )
        yield Image.fromarray(pixels)
