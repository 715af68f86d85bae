"""Networks on ONNX Runtime: the default on a CPU, without torch."""

from __future__ import annotations

import importlib.metadata
from concurrent.futures import ThreadPoolExecutor
from typing import cast

import numpy as np
import onnxruntime as ort
from onnxruntime.capi.onnxruntime_pybind11_state import (
    Fail,
    InvalidArgument,
    InvalidGraph,
    InvalidProtobuf,
    RuntimeException,
)
from onnxruntime.capi.onnxruntime_pybind11_state import (
    NotImplemented as NotSupported,
)

from services.policy.learning.checkpoint import GRAPH, Checkpoint
from services.policy.learning.checkpoint_errors import (
    DamagedCheckpoint,
    NoSuchDevice,
    ShapesDiffer,
)
from services.policy.learning.onnx_signature import input_shapes, output_shapes
from services.policy.serving.backend import (
    ROWS,
    Floats,
    StepInput,
    StepOutput,
    join_outputs,
    pad_rows,
)
from services.policy.serving.row_counts import find_row_counts

_UNREADABLE = (Fail, InvalidArgument, InvalidGraph, InvalidProtobuf, NotSupported, RuntimeException)


class OnnxBackend:
    """The graph of a checkpoint.

    Images are encoded one by one. The dense part has as many rows as there are cells, or the next
    number of rows that gives the bits of `ROWS` rows on this machine, which is tried out at the
    start. One thread computes one pass; with more threads the cells of a step are shared out among
    passes, which does not change their bits either.

    Args:
        checkpoint: Whose graph.
        device: `cpu`.
        threads: Passes at the same time.

    Raises:
        DamagedCheckpoint: ONNX Runtime cannot read the graph.
        NoSuchDevice: Another device.
        ShapesDiffer: The graph is not of the checkpoint's network.
    """

    def __init__(self, checkpoint: Checkpoint, *, device: str = "cpu", threads: int = 1) -> None:
        if device != "cpu":
            raise NoSuchDevice(device, ["cpu"])
        self.runtime = f"onnxruntime {importlib.metadata.version('onnxruntime')}"
        self.device = device
        self._session = _open(checkpoint)
        self._row_counts = find_row_counts(self._session, checkpoint.config.network, most=ROWS)
        self._has_history = checkpoint.config.network.history.steps > 0
        self._outputs = list(output_shapes(checkpoint.config.network))
        self._threads = threads
        self._pool = ThreadPoolExecutor(threads - 1, "inference") if threads > 1 else None

    def run(self, given: StepInput) -> StepOutput:
        """One step of any number of cells."""
        cells = len(given.images)
        share = min(ROWS, -(-cells // self._threads))
        parts = [given.part(slice(at, at + share)) for at in range(0, cells, share)]
        if self._pool is None or len(parts) == 1:
            return join_outputs([self._pass(part) for part in parts])
        # One part here: waking a thread takes up to a tenth of what a small network takes.
        others = [self._pool.submit(self._pass, part) for part in parts[1:]]
        first = self._pass(parts[0])
        return join_outputs([first, *(each.result() for each in others)])

    def _pass(self, given: StepInput) -> StepOutput:
        cells = len(given.images)
        count = next(rows for rows in self._row_counts if rows >= cells)
        rows = np.zeros(count, dtype=np.int64)
        rows[:cells] = np.arange(cells)
        fed = {
            "images": np.ascontiguousarray(given.images),
            "rows": rows,
            "h": pad_rows(given.h, rows=count, axis=1),
            "c": pad_rows(given.c, rows=count, axis=1),
        }
        if self._has_history:
            fed["history"] = pad_rows(given.history, rows=count, axis=0)
        values = cast("list[Floats]", self._session.run(self._outputs, fed))
        said = dict(zip(self._outputs, values, strict=True))
        logit = said.get("grasp_logit")
        return StepOutput(
            log_weights=said["log_weights"][:cells],
            means=said["means"][:cells],
            grasp_logit=None if logit is None else logit[:cells],
            h=said["h_after"][:, :cells],
            c=said["c_after"][:, :cells],
        )


def _open(checkpoint: Checkpoint) -> ort.InferenceSession:
    options = ort.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    # It logs to the process's standard error what is raised here anyway.
    options.log_severity_level = 4
    path = checkpoint.folder / GRAPH
    try:
        session = ort.InferenceSession(path, options, providers=["CPUExecutionProvider"])
    except _UNREADABLE as error:
        first = str(error).strip().splitlines()[0]
        raise DamagedCheckpoint(str(path), f"ONNX Runtime cannot read it: {first}") from error
    network = checkpoint.config.network
    for expected, found in (
        (input_shapes(network), session.get_inputs()),
        (output_shapes(network), session.get_outputs()),
    ):
        got = {each.name: tuple(each.shape) for each in found}
        for name in sorted(expected.keys() | got.keys()):
            if expected.get(name) != got.get(name):
                wanted, other = expected.get(name, "nothing"), got.get(name, "nothing")
                raise ShapesDiffer(str(path), name, str(wanted), str(other))
    return session
