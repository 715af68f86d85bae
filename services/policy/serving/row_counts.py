"""How many rows the dense part of a graph may have without changing what a row gets.

A library chooses the order of a sum by the shape of a matrix product, never by its values. So
whether two numbers of rows give the same bits can be tried out on noise, on the machine and with
the library at hand, and holds for every observation.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeAlias, cast

import numpy as np
import numpy.typing as npt
import onnxruntime as ort

from services.policy.learning.config import NetworkConfig
from services.policy.learning.onnx_signature import Shape, input_shapes, output_shapes

Values: TypeAlias = dict[str, npt.NDArray[np.generic]]


def find_row_counts(
    session: ort.InferenceSession, config: NetworkConfig, *, most: int
) -> tuple[int, ...]:
    """Numbers of rows that give each row the bits that it has among `most` rows.

    Each number is tried with the last rows of the noise, so that a row changes its place too.

    Args:
        session: The graph of the network.
        config: The network.
        most: Rows of a full pass.

    Returns:
        Numbers from 1 to `most`, which is always the last.
    """
    inputs, outputs = input_shapes(config), output_shapes(config)
    noise = _draw_noise(inputs, rows=most)

    def run(fed: Values) -> Values:
        names = list(outputs)
        values = cast("list[npt.NDArray[np.float32]]", session.run(names, fed))
        return dict(zip(names, values, strict=True))

    whole = run(noise)

    def agrees(rows: int) -> bool:
        said = run(_take_last(noise, inputs, rows=rows))
        expected = _take_last(whole, outputs, rows=rows)
        return all(said[name].tobytes() == expected[name].tobytes() for name in outputs)

    return (*(rows for rows in range(1, most) if agrees(rows)), most)


def _draw_noise(shapes: Mapping[str, Shape], *, rows: int) -> Values:
    """One image for all rows; everything else differs from row to row."""
    random = np.random.default_rng(0)
    sizes = {"rows": rows, "images": 1}

    def draw(shape: Shape) -> npt.NDArray[np.float32]:
        lengths = [sizes[each] if isinstance(each, str) else each for each in shape]
        return random.standard_normal(lengths, dtype=np.float32)

    noise: Values = {name: draw(shape) for name, shape in shapes.items()}
    noise["images"] = random.integers(0, 256, size=noise["images"].shape, dtype=np.uint8)
    noise["rows"] = np.zeros(rows, dtype=np.int64)
    return noise


def _take_last(values: Values, shapes: Mapping[str, Shape], *, rows: int) -> Values:
    """The last rows of every value that has rows."""

    def take(name: str) -> npt.NDArray[np.generic]:
        value, shape = values[name], shapes[name]
        if "rows" not in shape:
            return value
        axis = shape.index("rows")
        first = value.shape[axis] - rows
        return np.ascontiguousarray(value[(slice(None),) * axis + (slice(first, None),)])

    return {name: take(name) for name in values}
