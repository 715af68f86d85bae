"""Have the kernels ready before an episode waits for them."""

from __future__ import annotations

import functools
import logging
import time

import mujoco
import numpy as np

from common.calibration import load_calibration
from common.robots.meshes import Shell
from common.tasks.task import SceneCamera
from services.sim.camera.meshes import Skin, pack
from services.sim.camera.scene import SceneRenderer
from services.sim.camera.stereo import StereoCamera

log = logging.getLogger(__name__)

_SCENE = """
<mujoco>
  <worldbody>
    <geom type="plane" size="1 1 1"/>
    <site name="tool" pos="0 0 1"/>
  </worldbody>
</mujoco>
"""
_WORTH_TELLING_S = 2.0


@functools.cache
def warm_up() -> float:
    """Draw one picture, once per process; the first time on a machine this compiles for 15 to 40 s.

    Returns:
        How long it took [s].
    """
    began_s = time.perf_counter()
    model, data = _open_scene()
    StereoCamera(model, load_calibration("pinhole"), tool_site="tool").render(data)
    return _tell(began_s)


@functools.cache
def warm_up_meshes() -> float:
    """Draw one picture with a mesh, once per process; the first time this compiles for 15 to 40 s.

    Returns:
        How long it took [s].
    """
    began_s = time.perf_counter()
    model, data = _open_scene()
    triangle = np.array([[[0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [0.0, 1.0, 1.0]]])
    hull, colors = pack([Shell("world", triangle, np.ones((1, 3, 3)), np.ones((1, 3)))])
    world, none = np.zeros(1, dtype=np.int64), np.zeros(0, dtype=np.int64)
    renderer = SceneRenderer(model, width=1, height=1, skin=Skin(hull, colors, world, none))
    renderer.render(data, SceneCamera((0.2, 0.2, 2.0), (0.2, 0.2, 0.0)))
    return _tell(began_s)


def _open_scene() -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(_SCENE)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return model, data


def _tell(began_s: float) -> float:
    took_s = time.perf_counter() - began_s
    if took_s > _WORTH_TELLING_S:
        log.info("the camera's kernels were compiled", extra={"took_s": round(took_s, 1)})
    return took_s
