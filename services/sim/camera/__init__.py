"""Ray-traced cameras: the gripper's stereo pair and colour pictures from any viewpoint."""

from __future__ import annotations

from services.sim.camera.noise import RANDOMISED, CameraNoise, Sensor
from services.sim.camera.scene import SceneRenderer
from services.sim.camera.stereo import StereoCamera
from services.sim.camera.tracer import Hits, Tracer
from services.sim.camera.warm_up import warm_up

__all__ = [
    "RANDOMISED",
    "CameraNoise",
    "Hits",
    "SceneRenderer",
    "Sensor",
    "StereoCamera",
    "Tracer",
    "warm_up",
]
