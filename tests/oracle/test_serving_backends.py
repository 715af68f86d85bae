"""ONNX Runtime says what torch says, and neither lets cells see each other."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest
import torch

from services.policy.learning.checkpoint import load_checkpoint
from services.policy.learning.checkpoint_weights import load_network
from services.policy.learning.presets import PRESETS
from services.policy.serving.backend import ROWS, Backend, StepInput, StepOutput
from services.policy.serving.onnx_backend import OnnxBackend
from services.policy.serving.torch_backend import TorchBackend
from tests.checkpoints import METHODS, SMALL, write_checkpoint

STEPS = 25

TINY = PRESETS["legato-compact"].model_dump(exclude={"method", "head", "loss"})
"""A size whose matrix products are cut into blocks."""


@pytest.fixture(autouse=True, scope="module")
def _one_thread():
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.fixture(scope="module", params=["small", "small-without-history", "tiny"])
def folder(request, tmp_path_factory) -> Path:
    changes = {
        "small": SMALL,
        "small-without-history": {"history": {"steps": 0}},
        "tiny": TINY | {"history": {"steps": 2}},
    }[request.param]
    return write_checkpoint(tmp_path_factory.mktemp("checkpoints") / request.param, **changes)


def draw_inputs(folder: Path, *, cells: int, seed: int = 0) -> StepInput:
    config = load_checkpoint(folder).config.network
    random = np.random.default_rng(seed)
    blank = StepInput.blank(config, cells=cells)

    def normal(shape):
        return 0.3 * random.standard_normal(shape, dtype=np.float32)

    return StepInput(
        images=random.integers(0, 256, size=blank.images.shape, dtype=np.uint8),
        history=normal(blank.history.shape),
        h=normal(blank.h.shape),
        c=normal(blank.c.shape),
    )


def take(given: StepInput, cells: list[int]) -> StepInput:
    return StepInput(
        given.images[cells], given.history[cells], given.h[:, cells], given.c[:, cells]
    )


def bits(output: StepOutput, cell: int) -> bytes:
    logit = b"" if output.grasp_logit is None else output.grasp_logit[cell].tobytes()
    rest = (output.log_weights[cell], output.means[cell], output.h[:, cell], output.c[:, cell])
    return logit + b"".join(each.tobytes() for each in rest)


def close(got: StepOutput, expected: StepOutput) -> None:
    for name in ("log_weights", "means", "grasp_logit", "h", "c"):
        one, other = getattr(got, name), getattr(expected, name)
        assert (one is None) == (other is None)
        if one is not None:
            np.testing.assert_allclose(one, other, rtol=1e-5, atol=1e-5, err_msg=name)


@pytest.mark.parametrize("method", METHODS)
def test_onnx_equals_torch_over_many_steps(tmp_path: Path, method: str):
    folder = write_checkpoint(tmp_path / method, method=method)
    checkpoint = load_checkpoint(folder)
    onnx, reference = OnnxBackend(checkpoint), TorchBackend(checkpoint)
    states = {}
    for step in range(STEPS):
        given = draw_inputs(folder, cells=3, seed=step)
        for backend in (onnx, reference):
            h, c = states.get(backend, (np.zeros_like(given.h), np.zeros_like(given.c)))
            states[backend] = backend.run(StepInput(given.images, given.history, h, c))
        close(states[onnx], states[reference])
        states = {backend: (output.h, output.c) for backend, output in states.items()}
    assert np.abs(states[onnx][0]).max() > 1e-2


def test_onnx_equals_torch_at_the_shipped_size(folder: Path):
    checkpoint = load_checkpoint(folder)
    given = draw_inputs(folder, cells=3)
    close(OnnxBackend(checkpoint).run(given), TorchBackend(checkpoint).run(given))


def test_the_torch_backend_is_the_network(folder: Path):
    """Over a window, the state handed on: what training computes in one go."""
    checkpoint = load_checkpoint(folder)
    network, backend = load_network(checkpoint), TorchBackend(checkpoint)
    steps = [draw_inputs(folder, cells=1, seed=step) for step in range(5)]
    with torch.inference_mode():
        whole, _ = network(
            torch.from_numpy(np.stack([step.images for step in steps], axis=1)),
            torch.from_numpy(np.stack([step.history for step in steps], axis=1)),
        )
    h, c = np.zeros_like(steps[0].h), np.zeros_like(steps[0].c)
    for number, step in enumerate(steps):
        said = backend.run(StepInput(step.images, step.history, h, c))
        h, c = said.h, said.c
        expected = whole.mixture.means[0, number].numpy()
        np.testing.assert_allclose(said.means[0], expected, rtol=1e-5, atol=1e-5)


def backends(folder: Path) -> list[Backend]:
    checkpoint = load_checkpoint(folder)
    return [
        OnnxBackend(checkpoint),
        OnnxBackend(checkpoint, threads=3),
        TorchBackend(checkpoint),
    ]


def test_a_cell_gets_the_same_bits_in_any_company(folder: Path):
    """Every number of cells up to more than one pass takes, each cell in every place."""
    cells = ROWS + 3
    given = draw_inputs(folder, cells=cells)
    for backend in backends(folder):
        alone = [bits(backend.run(take(given, [cell])), 0) for cell in range(cells)]
        assert len(set(alone)) == cells
        for count, shift in itertools.product(range(1, cells + 1), (0, 3, 7)):
            chosen = [(shift + place) % cells for place in range(count)]
            together = backend.run(take(given, chosen))
            assert [bits(together, place) for place in range(count)] == [
                alone[cell] for cell in chosen
            ]


class Spy:
    """Hands everything on and keeps the sizes of the passes."""

    def __init__(self, session) -> None:
        self.session = session
        self.sizes: list[tuple[int, int, int]] = []

    def run(self, outputs, fed):
        self.sizes.append((len(fed["images"]), len(fed["rows"]), fed["h"].shape[1]))
        return self.session.run(outputs, fed)


def spy_on(backend: OnnxBackend) -> Spy:
    spy = backend._session = Spy(backend._session)  # type: ignore[assignment]
    return spy


def test_onnx_encodes_what_there_is_and_decides_on_rows_that_agree(folder: Path):
    backend = OnnxBackend(load_checkpoint(folder))
    assert backend._row_counts[-1] == ROWS
    spy = spy_on(backend)
    passes = (1, 3, ROWS, 2)
    for cells in (1, 3, ROWS + 2):
        backend.run(draw_inputs(folder, cells=cells))
    rows = [min(count for count in backend._row_counts if count >= cells) for cells in passes]
    assert spy.sizes == [(cells, row, row) for cells, row in zip(passes, rows, strict=True)]


def test_where_rows_do_not_agree_passes_are_padded(folder: Path):
    """As on a machine whose library sums three rows in another order than eight."""
    backend = OnnxBackend(load_checkpoint(folder))
    given = draw_inputs(folder, cells=ROWS)
    whole = backend.run(given)
    backend._row_counts = (2, 5, ROWS)
    spy = spy_on(backend)
    for cells in (1, 2, 3, 6):
        said = backend.run(take(given, list(range(cells))))
        assert [bits(said, cell) for cell in range(cells)] == [
            bits(whole, cell) for cell in range(cells)
        ]
    assert spy.sizes == [(1, 2, 2), (2, 2, 2), (3, 5, 5), (6, ROWS, ROWS)]


@pytest.mark.parametrize("size", ["compact", "paper"])
def test_rows_that_agree_give_the_same_bits_at_full_size(tmp_path: Path, size: str):
    """What the backend found out about its rows on noise holds for whole observations."""
    preset = PRESETS[f"legato-{size}"].model_dump(exclude={"method", "head", "loss"})
    folder = write_checkpoint(tmp_path / size, **preset)
    backend = OnnxBackend(load_checkpoint(folder))
    given = draw_inputs(folder, cells=ROWS, seed=1)
    whole = backend.run(given)
    assert len({bits(whole, cell) for cell in range(ROWS)}) == ROWS
    for cells in range(1, ROWS):
        chosen = [(3 * cells + place) % ROWS for place in range(cells)]
        said = backend.run(take(given, chosen))
        for place, cell in enumerate(chosen):
            assert bits(said, place) == bits(whole, cell), f"{cells} cells"


def test_threads_do_not_change_bits(folder: Path):
    checkpoint, given = load_checkpoint(folder), draw_inputs(folder, cells=5)
    one, three = (OnnxBackend(checkpoint, threads=count).run(given) for count in (1, 3))
    assert [bits(one, cell) for cell in range(5)] == [bits(three, cell) for cell in range(5)]
