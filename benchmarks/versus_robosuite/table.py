"""The figures of all rounds, printed: medians with the least and the largest, and ratios."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from statistics import median

from benchmarks.versus_robosuite.contestants import Contestant, Measured

ASKED_RATIO = 8.0
Rounds = Mapping[Contestant, Sequence[Measured]]


def print_factors(rounds: Rounds) -> None:
    """Real-time factors, one row per contestant."""
    print(f"{'':47s}{'x real time':>20s}{'per CPU second':>20s}{'with resets':>20s}")
    for contestant, measured in rounds.items():
        print(
            f"{contestant.name:47s}"
            + f"{describe([m.per_wall for m in measured]):>20s}"
            + f"{describe([m.per_cpu for m in measured]):>20s}"
            + f"{describe([m.with_reset for m in measured]):>20s}"
        )


def print_ratios(rounds: Rounds, legato: Contestant) -> None:
    """How many times faster LEGATO is, round by round, one row per other contestant."""
    print(f"{'LEGATO is faster by':47s}{'wall':>20s}{'CPU':>20s}{'with resets':>20s}")
    for contestant in rounds:
        if contestant is legato:
            continue
        pairs = list(zip(rounds[legato], rounds[contestant], strict=True))
        print(
            f"{'than ' + contestant.name:47s}"
            + f"{describe([a.per_wall / b.per_wall for a, b in pairs]):>20s}"
            + f"{describe([a.per_cpu / b.per_cpu for a, b in pairs]):>20s}"
            + f"{describe([a.with_reset / b.with_reset for a, b in pairs]):>20s}"
        )


def describe_verdict(rounds: Rounds, legato: Contestant) -> str:
    """Whether what is asked holds against the fastest contestant that draws with one thread."""
    drawing = [contestant for contestant in rounds if contestant.is_drawing]
    if not drawing:
        return f"{ASKED_RATIO:g} x robosuite with cameras: not measured, nothing here can draw"
    fastest = max(drawing, key=lambda each: median(m.per_cpu for m in rounds[each]))
    pairs = list(zip(rounds[legato], rounds[fastest], strict=True))
    ratios = {
        "wall": median(a.per_wall / b.per_wall for a, b in pairs),
        "CPU": median(a.per_cpu / b.per_cpu for a, b in pairs),
    }
    words = [
        f"{value:.1f} x by {name} time: {'met' if value >= ASKED_RATIO else 'NOT met'}"
        for name, value in ratios.items()
    ]
    return f"asked: {ASKED_RATIO:g} x {fastest.name}; " + ", ".join(words)


def describe(values: Sequence[float]) -> str:
    """Median, least and largest."""
    return f"{median(values):.2f} ({min(values):.2f}-{max(values):.2f})"
