"""One episode of robosuite's Lift task with random actions, timed; prints one JSON object.

Runs in robosuite's own environment and imports nothing of LEGATO. The caller chooses the OpenGL
library by MUJOCO_GL and the threads by environment variables, which count from the first import.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from importlib.metadata import version
from typing import Any

import numpy as np
import robosuite

CAMERAS = ("agentview", "robot0_eye_in_hand")
SIZE_PX = 128
CONTROL_HZ = 10
"""Rate of actions and of images; the controller and the physics stay at robosuite's 500 Hz."""
WARM_UP_STEPS = 3
PACKAGES = ("robosuite", "mujoco", "numpy", "numba", "scipy", "PyOpenGL")


def make_lift(*, cameras: bool, seed: int, steps: int) -> Any:
    """The task with robosuite's defaults, except for the rates, the cameras and the length."""
    return robosuite.make(
        "Lift",
        robots="Panda",
        has_renderer=False,
        has_offscreen_renderer=cameras,
        use_camera_obs=cameras,
        camera_names=list(CAMERAS),
        camera_heights=SIZE_PX,
        camera_widths=SIZE_PX,
        control_freq=CONTROL_HZ,
        horizon=steps,
        ignore_done=True,
        seed=seed,
    )


class Stopwatch:
    """Wall time and CPU time of this process with all its threads, since it was made."""

    def __init__(self) -> None:
        self._wall_s = time.perf_counter()
        self._cpu_s = time.process_time()

    def read(self) -> tuple[float, float]:
        """Wall and CPU time [s]."""
        return time.perf_counter() - self._wall_s, time.process_time() - self._cpu_s


def run_steps(env: Any, actions: np.ndarray) -> list[np.ndarray]:
    """Apply the actions, one per step, and return the new images, of all cameras together."""
    images: list[np.ndarray] = []
    previous: dict[str, Any] = {}
    for action in actions:
        observation, _, _, _ = env.step(action)
        for name in CAMERAS:
            image = observation.get(f"{name}_image")
            # A camera that was not due hands out the same array again.
            if image is not None and image is not previous.get(name):
                images.append(image)
                previous[name] = image
    return images


def check_images(images: list[np.ndarray], *, expected: int) -> None:
    """Refuse to report a speed of pictures that were not drawn.

    Raises:
        SystemExit: Too few images, or a blank one.
    """
    if len(images) < expected:
        raise SystemExit(f"{len(images)} new images in the episode, {expected} are due")
    if any(image.std() < 1 for image in images):
        raise SystemExit("an image is blank: OpenGL does not draw")


def name_renderer() -> str:
    """What OpenGL draws with, from the context of the cameras."""
    from OpenGL import GL

    return GL.glGetString(GL.GL_RENDERER).decode()


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cameras", action="store_true")
    parser.add_argument("--seconds", type=float, default=10.0, help="simulated, of the episode")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    steps = round(args.seconds * CONTROL_HZ)

    env = make_lift(cameras=args.cameras, seed=args.seed, steps=steps)
    low, high = env.action_spec
    rng = np.random.default_rng(args.seed)
    run_steps(env, rng.uniform(low, high, (WARM_UP_STEPS, len(low))))
    actions = rng.uniform(low, high, (steps, len(low)))

    stopwatch = Stopwatch()
    env.reset()
    reset_wall_s, _ = stopwatch.read()
    started_s = float(env.sim.data.time)
    stopwatch = Stopwatch()
    images = run_steps(env, actions)
    wall_s, cpu_s = stopwatch.read()
    sim_s = float(env.sim.data.time) - started_s

    check_images(images, expected=len(CAMERAS) * steps if args.cameras else 0)
    measured = {
        "sim_s": sim_s,
        "wall_s": wall_s,
        "cpu_s": cpu_s,
        "reset_wall_s": reset_wall_s,
        "renderer": name_renderer() if args.cameras else "",
        "versions": {name: version(name) for name in PACKAGES},
    }
    print(json.dumps(measured))
    return 0


if __name__ == "__main__":
    sys.exit(main())
