"""Have the kernels ready before an episode waits for them."""

from __future__ import annotations

import functools
import logging
import time

import mujoco

from common.calibration import load_calibration
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
    model = mujoco.MjModel.from_xml_string(_SCENE)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    StereoCamera(model, load_calibration("pinhole"), tool_site="tool").render(data)
    took_s = time.perf_counter() - began_s
    if took_s > _WORTH_TELLING_S:
        log.info("the camera's kernels were compiled", extra={"took_s": round(took_s, 1)})
    return took_s
