"""Ray-traced cameras: the gripper's stereo pair and colour pictures from any viewpoint."""

from __future__ import annotations

from services.sim.camera.meshes import Skin
from services.sim.camera.noise import RANDOMISED, CameraNoise, Sensor
from services.sim.camera.scene import SceneRenderer
from services.sim.camera.stereo import StereoCamera
from services.sim.camera.tracer import Hits, Tracer
from services.sim.camera.warm_up import warm_up, warm_up_meshes

__all__ = [
    "RANDOMISED",
    "CameraNoise",
    "Hits",
    "SceneRenderer",
    "Sensor",
    "Skin",
    "StereoCamera",
    "Tracer",
    "warm_up",
    "warm_up_meshes",
]
