"""Pictures of an episode's key moments, drawn after it has ended."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np

from common.messages import EpisodePicture, Header, StereoFrame
from services.sim.camera import SceneRenderer, Skin
from services.sim.world import World

_WIDTH, _HEIGHT = 400, 300
_MOST_MOMENTS = 6


@dataclass(frozen=True)
class _Moment:
    name: str
    qpos: np.ndarray
    frame: StereoFrame | None


class Album:
    """Keeps the state of key moments (microseconds) and draws them when asked (milliseconds).

    Args:
        world: Where they happen.
        skin: Meshes of its robot, for the scene views.
    """

    def __init__(self, world: World, skin: Skin | None = None) -> None:
        self._world = world
        self._skin = skin
        self._moments: list[_Moment] = []
        self._counts: dict[str, int] = {}

    def remember(self, name: str, frame: StereoFrame | None, *, last: bool = False) -> None:
        """Keep the present state under a name; repeated names are numbered.

        Args:
            name: What happens now: start, grasp, release, end.
            frame: The newest stereo pair.
            last: Keep it even when the album is full.
        """
        if len(self._moments) >= _MOST_MOMENTS - 1 and not last:
            return
        count = self._counts[name] = self._counts.get(name, 0) + 1
        label = name if count == 1 else f"{name}-{count}"
        self._moments.append(_Moment(label, self._world.data.qpos.copy(), frame))

    def draw(self, header: Header) -> Iterator[EpisodePicture]:
        """Scene view and stereo pair of every moment."""
        model = self._world.model
        renderer = SceneRenderer(
            model, width=_WIDTH, height=_HEIGHT, supersample=2, skin=self._skin
        )
        data = mujoco.MjData(model)
        for moment in self._moments:
            data.qpos[:] = moment.qpos
            self._world.update_poses(data)
            pixels = renderer.render(data, self._world.task.scene_camera)
            yield EpisodePicture(
                header=header,
                moment=moment.name,
                view="scene",
                width=_WIDTH,
                height=_HEIGHT,
                channels=3,
                pixels=pixels.tobytes(),
            )
            if moment.frame is not None:
                for view in ("left", "right"):
                    yield EpisodePicture(
                        header=header,
                        moment=moment.name,
                        view=view,
                        width=moment.frame.width,
                        height=moment.frame.height,
                        channels=1,
                        pixels=getattr(moment.frame, view),
                    )
