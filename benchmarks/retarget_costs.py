"""What head, collision pairs, a wall and the measurement add to a step of our retargeter."""

from __future__ import annotations

import numpy as np

from benchmarks.retarget_motions import Kind, make_motion
from benchmarks.retarget_runs import Entry, Ours, run_in_turn
from common.robots import CollisionSpec, RobotSpec, WallSpec
from common.tasks import load_task
from services.retarget.robot_model import RobotModel

_KINDS: tuple[Kind, ...] = ("sine", "set-points", "fast")
_WALL_AHEAD_M = 0.05


def print_costs(spec: RobotSpec, *, ticks: int) -> None:
    """Print the median step with each part alone and with all of them, fed forward.

    Args:
        spec: A robot with a head and collision pairs.
        ticks: Length of a motion.
    """
    bare = spec.model_copy(update={"head": None, "walls": (), "collision": CollisionSpec()})
    x, y, z = spec.T_world_start[:3]
    wall = WallSpec(name="wall", point=(x + _WALL_AHEAD_M, y, z), normal=(1.0, 0.0, 0.0))
    models = {
        "bare": RobotModel(bare),
        "head": RobotModel(bare.model_copy(update={"head": spec.head})),
        "pairs and table": RobotModel(bare.model_copy(update={"collision": spec.collision})),
        "a wall": RobotModel(bare.model_copy(update={"walls": (wall,)})),
        "measurement": RobotModel(bare),
        "all": RobotModel(spec.model_copy(update={"walls": (wall,)})),
    }
    obstacles = load_task("lid").obstacles
    print(f"\n== {spec.name}, median us of a step, with")
    print(f"  {'':18}" + "".join(f"{kind:>14}" for kind in _KINDS))
    medians: dict[str, list[float]] = {name: [] for name in models}
    for kind in _KINDS:
        T_world_start = models["bare"].compute_tool_pose(np.array(spec.start_positions))
        motion = make_motion(kind, T_world_start, seed=0, ticks=ticks)
        entries: dict[str, Entry] = {}
        for name, model in models.items():
            ours = Ours(
                model,
                obstacles=obstacles if name in ("pairs and table", "all") else (),
                measures=name in ("measurement", "all"),
            )
            entries[name] = (ours, motion.fed_forward)
        for name, run in run_in_turn(models["bare"], motion, entries).items():
            medians[name].append(run.median_us)
    for name, row in medians.items():
        print(f"  {name:18}" + "".join(f"{median:14.0f}" for median in row))
