"""One sheet per robot: joints in their ranges, error of the hand, share of every level achieved."""

from __future__ import annotations

import re

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter

from common.clock import TICK_S
from common.se3 import Array
from services.retarget.recorded_run import Run
from services.retarget.robot_model import RobotModel

WIDTH_IN, PANEL_IN, SMALL_PANEL_IN, DPI = 9.0, 1.35, 0.75, 100

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#333333")
"""Told apart by the colour-blind as well (M. Okabe and K. Ito, "Color universal design", 2008)."""
GREY, PALE = "#666666", "#DDDDDD"

_LIMBS = {"l": "left arm", "r": "right arm", "joint": "arm"}


def draw_sheet(run: Run, *, title: str) -> Figure:
    """A panel per group of joints, then the error of the hand, then a small one per level.

    Args:
        run: What the robot was told.
        title: Robot and motion.
    """
    groups = group_joints([joint.name for joint in run.model.spec.joints])
    levels = len(name_levels(run))
    heights_in = [PANEL_IN] * (len(groups) + 1) + [SMALL_PANEL_IN] * levels
    figure = Figure(figsize=(WIDTH_IN, sum(heights_in) + 0.6), dpi=DPI, layout="constrained")
    figure.suptitle(title, x=0.01, ha="left", fontsize=12, fontweight="bold")
    panels = figure.subplots(len(heights_in), 1, sharex=True, height_ratios=heights_in)
    all_axes: list[Axes] = panels.tolist()
    t_s: Array = TICK_S * np.arange(1.0, len(run.q) + 1.0)
    shares = compute_shares(run.model, run.q)
    for axes, (group, members) in zip(all_axes, groups.items(), strict=False):
        draw_joints(axes, t_s, group, {name: shares[:, index] for name, index in members.items()})
    draw_error(all_axes[len(groups)], t_s, run)
    for level, axes in enumerate(all_axes[len(groups) + 1 :]):
        draw_scaling(axes, t_s, run, level)
    for axes in all_axes:
        _tidy(axes)
    all_axes[-1].set_xlabel("time [s]")
    all_axes[-1].set_xlim(0.0, t_s[-1])
    figure.align_ylabels(all_axes)
    return figure


def group_joints(names: list[str]) -> dict[str, dict[str, int]]:
    """Joints by what they belong to: group -> short name -> index.

    A name is split at its first underscore; what comes before a number is the group as well.
    """
    groups: dict[str, dict[str, int]] = {}
    for index, name in enumerate(names):
        limb = re.split(r"[_\d]", name, maxsplit=1)[0]
        members = groups.setdefault(_LIMBS.get(limb, limb), {})
        members[name.removeprefix(f"{limb}_").replace("_", " ")] = index
    return groups


def compute_shares(model: RobotModel, q: Array) -> Array:
    """Where joints (ticks, n) are in their ranges: 0 at the lower limit, 1 at the upper one.

    A joint without a range is shown in turns, 0.5 at zero.
    """
    limited = np.isfinite(model.upper - model.lower)
    lower = np.where(limited, model.lower, -np.pi)
    upper = np.where(limited, model.upper, np.pi)
    return (q - lower) / (upper - lower)


def draw_joints(axes: Axes, t_s: Array, group: str, joints: dict[str, Array]) -> None:
    """Positions of one group of joints in their ranges."""
    for index, (name, share) in enumerate(joints.items()):
        again, colour = divmod(index, len(COLOURS))
        axes.plot(t_s, share, color=COLOURS[colour], linestyle="--" if again else "-", label=name)
    axes.set_ylim(-0.03, 1.03)
    axes.set_yticks([0.0, 0.5, 1.0])
    axes.yaxis.set_major_formatter(PercentFormatter(1.0))
    axes.set_ylabel(f"{group}\n[% of range]")


def draw_error(axes: Axes, t_s: Array, run: Run) -> None:
    """How far the commanded hand is from its reference."""
    axes.plot(t_s, 1e3 * run.error_m, color=COLOURS[0], label="position [mm]")
    axes.plot(t_s, 1e3 * run.error_rad, color=COLOURS[1], label="orientation [mrad]")
    axes.set_ylim(bottom=0.0)
    axes.set_ylabel("hand error\n[mm, mrad]")


def draw_scaling(axes: Axes, t_s: Array, run: Run, level: int) -> None:
    """Share of one level that is achieved, and when something held the robot back."""
    axes.fill_between(
        *(t_s, 0.0, 1.0),
        where=run.held_back.tolist(),
        transform=axes.get_xaxis_transform(),
        color=PALE,
        linewidth=0.0,
        label="held back",
    )
    name = name_levels(run)[level]
    axes.plot(t_s, run.scaling[:, level], color=COLOURS[level], label="share achieved")
    axes.set_ylim(-0.08, 1.08)
    axes.set_yticks([0.0, 1.0])
    axes.set_ylabel(f"{name}\nscaling")


def name_levels(run: Run) -> list[str]:
    """The levels in the order of their priority."""
    return ["hand", *(["head"] if run.model.spec.head else []), "posture"]


def _tidy(axes: Axes) -> None:
    """Thin lines, a light grid, the legend beside the panel."""
    for line in axes.get_lines():
        line.set_linewidth(1.2)
    axes.grid(color=PALE, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(labelsize=8, color=GREY)
    axes.yaxis.label.set_fontsize(9)
    axes.legend(
        loc="center left",
        bbox_to_anchor=(1.0, 0.5),
        frameon=False,
        fontsize=8,
        handlelength=1.3,
        labelspacing=0.25,
    )
