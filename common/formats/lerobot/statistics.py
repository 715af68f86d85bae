"""Least, largest, mean, deviation and quantiles, as LeRobot keeps them per episode and in all."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from common.formats.labels import Bytes, Floats

QUANTILES = {"q01": 0.01, "q10": 0.10, "q50": 0.50, "q90": 0.90, "q99": 0.99}
LEVELS = 256

Statistics: TypeAlias = dict[str, list[Any]]
Histogram: TypeAlias = npt.NDArray[np.int64]


def describe_vectors(rows: Floats) -> Statistics:
    """Of (n, k) numbers; k values each."""
    return {
        "min": rows.min(axis=0).tolist(),
        "max": rows.max(axis=0).tolist(),
        "mean": rows.mean(axis=0).tolist(),
        "std": rows.std(axis=0).tolist(),
        "count": [len(rows)],
        **{name: np.quantile(rows, q, axis=0).tolist() for name, q in QUANTILES.items()},
    }


def count_levels(images: Bytes) -> Histogram:
    """(256,) how many pixels have each gray level."""
    return np.bincount(images.reshape(-1), minlength=LEVELS).astype(np.int64)


def describe_levels(histogram: Histogram, *, images: int) -> Statistics:
    """Of gray levels in [0, 1], exactly; three equal channels as (3, 1, 1).

    Args:
        histogram: (256,) pixels per gray level.
        images: How many they are.
    """
    total = int(histogram.sum())
    levels = np.arange(LEVELS) / (LEVELS - 1)
    mean = float(histogram @ levels) / total
    variance = float(histogram @ np.square(levels - mean)) / total
    present = np.flatnonzero(histogram)
    below = np.cumsum(histogram)
    values = {
        "min": levels[present[0]],
        "max": levels[present[-1]],
        "mean": mean,
        "std": variance**0.5,
        **{name: levels[np.searchsorted(below, q * total)] for name, q in QUANTILES.items()},
    }
    described: Statistics = {name: [[[float(value)]]] * 3 for name, value in values.items()}
    described["count"] = [images]
    return described
