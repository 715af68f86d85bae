"""Builds an ONNX graph whose weights stay in a safetensors file beside it.

A safetensors file is a length (8 bytes, little-endian), a JSON header of that length, and the
numbers of all tensors; an ONNX tensor may say `location, offset, length` instead of holding its
numbers. So one copy of the weights serves both.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from onnx import ModelProto, TensorProto, checker, helper, numpy_helper

OPSET = 18
IR_VERSION = 10

_LENGTH_BYTES = 8


class GraphBuilder:
    """A graph that grows node by node; every method gives the name of what it added.

    Args:
        weights: Safetensors file, in the folder that the graph will be in.
    """

    def __init__(self, weights: Path) -> None:
        self._location = weights.name
        self._stored, self._first_byte = _read_header(weights)
        self._nodes: list[Any] = []
        self._tensors: dict[str, TensorProto] = {}

    def add(self, kind: str, *inputs: str, name: str = "", **attributes: Any) -> str:
        """A node with one output, called `name` if given."""
        return self.add_many(kind, inputs, [name or f"{kind}_{len(self._nodes)}"], **attributes)[0]

    def add_many(
        self, kind: str, inputs: Sequence[str], outputs: Sequence[str], **attributes: Any
    ) -> list[str]:
        """A node with several outputs."""
        self._nodes.append(helper.make_node(kind, list(inputs), list(outputs), **attributes))
        return list(outputs)

    def weight(self, name: str) -> str:
        """A stored tensor."""
        if name not in self._tensors:
            entry = self._stored[name]
            begin, end = entry["data_offsets"]
            tensor = TensorProto(
                name=name,
                dims=entry["shape"],
                data_type=TensorProto.FLOAT,
                data_location=TensorProto.EXTERNAL,
            )
            for key, value in (
                ("location", self._location),
                ("offset", self._first_byte + begin),
                ("length", end - begin),
            ):
                tensor.external_data.add(key=key, value=str(value))
            self._tensors[name] = tensor
        return name

    def constant(self, name: str, values: npt.NDArray[Any]) -> str:
        """A tensor that the graph itself holds; the same name again is the same tensor."""
        if name not in self._tensors:
            self._tensors[name] = numpy_helper.from_array(np.ascontiguousarray(values), name)
        return name

    def integers(self, *values: int) -> str:
        """A list of integers: axes, shapes, ends of slices."""
        name = "integers_" + "_".join(str(value) for value in values)
        return self.constant(name, np.array(values, dtype=np.int64))

    def build(
        self, name: str, *, inputs: Sequence[ValueSpec], outputs: Sequence[ValueSpec]
    ) -> ModelProto:
        """The model, checked for its form."""
        graph = helper.make_graph(
            self._nodes,
            name,
            [helper.make_tensor_value_info(*each) for each in inputs],
            [helper.make_tensor_value_info(*each) for each in outputs],
            list(self._tensors.values()),
        )
        return helper.make_model(
            graph,
            opset_imports=[helper.make_opsetid("", OPSET)],
            ir_version=IR_VERSION,
            producer_name="legato",
        )


ValueSpec = tuple[str, int, Sequence[int | str]]
"""Name, element type, and shape with names for what is free."""


def write_graph(path: Path, model: ModelProto) -> None:
    """Write a model and check it with its weights."""
    path.write_bytes(model.SerializeToString(deterministic=True))
    checker.check_model(str(path))


def _read_header(path: Path) -> tuple[dict[str, Any], int]:
    """Tensors by name, and the position of the first number."""
    with path.open("rb") as file:
        length = int.from_bytes(file.read(_LENGTH_BYTES), "little")
        header = json.loads(file.read(length))
    return header, _LENGTH_BYTES + length
