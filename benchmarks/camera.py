"""Cost of one stereo pair: `python -m benchmarks.camera`.

Renders the lid task with the Panda at its start pose, all variants in turn, round after round, so
that a machine that slows down slows all of them. Prints medians and the ratios that matter.
"""

from __future__ import annotations

import argparse
import os
import statistics
import time
from collections.abc import Iterator

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import mujoco

from benchmarks.machine import describe_machine
from common.calibration import load_calibration
from common.robots import load_robot
from common.tasks import load_task
from services.sim.camera import StereoCamera
from services.sim.world import TOOL_SITE, World

Variant = tuple[str, str, str]


def variants(model: mujoco.MjModel) -> Iterator[tuple[Variant, StereoCamera]]:
    """Both lenses, adaptive and full grid, with and without shadows."""
    for lens, name in (("pinhole", "pinhole"), ("fisheye", "t265")):
        for grid in ("adaptive", "full"):
            for shadow in ("shadow", "plain"):
                yield (
                    (lens, grid, shadow),
                    StereoCamera(
                        model,
                        load_calibration(name),
                        tool_site=TOOL_SITE,
                        full_grid=grid == "full",
                        shadows=shadow == "shadow",
                    ),
                )


def measure(
    cameras: dict[Variant, StereoCamera], data: mujoco.MjData, *, rounds: int
) -> dict[Variant, float]:
    """Median time of each variant [ms], one pair of each per round; the first does not count."""
    for camera in cameras.values():
        camera.render(data)
    times_ms: dict[Variant, list[float]] = {variant: [] for variant in cameras}
    for _ in range(rounds):
        for variant, camera in cameras.items():
            started = time.perf_counter()
            camera.render(data)
            times_ms[variant].append((time.perf_counter() - started) * 1e3)
    return {variant: statistics.median(times) for variant, times in times_ms.items()}


def main() -> None:
    parser = argparse.ArgumentParser(prog="benchmarks.camera", description=__doc__)
    parser.add_argument("--rounds", type=int, default=50, help="pairs of each variant")
    parser.add_argument("--robot", default="panda")
    args = parser.parse_args()

    world = World(task=load_task("lid"), robot=load_robot(args.robot), seed=0)
    cameras = dict(variants(world.model))
    started = time.perf_counter()
    next(iter(cameras.values())).render(world.data)
    first_s = time.perf_counter() - started
    medians = measure(cameras, world.data, rounds=args.rounds)

    print(describe_machine(["mujoco-core", "numba", "numpy"]))
    print(f"lid task, {args.robot}, {world.model.ngeom} geoms; one 128 x 128 pair, median ms\n")
    for (lens, grid, shadow), median in medians.items():
        print(f"  {lens:8} {grid:9} {shadow:7} {median:7.2f}")
    print(f"\nfirst pair, with loading or compiling the kernel: {first_s:.2f} s")
    fisheye = medians["fisheye", "adaptive", "shadow"]
    print(f"fisheye / pinhole  {fisheye / medians['pinhole', 'adaptive', 'shadow']:.2f}")
    print(f"full / adaptive    {medians['fisheye', 'full', 'shadow'] / fisheye:.2f}")
    print(f"shadow / plain     {fisheye / medians['fisheye', 'adaptive', 'plain']:.2f}")


if __name__ == "__main__":
    main()
