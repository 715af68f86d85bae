from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from common import messages as m
from common.errors import InvalidValue, MissingExtra, UntrainedTask
from services.policy.learning.checkpoint import GraspHysteresis, load_checkpoint
from services.policy.learning.checkpoint_errors import (
    DamagedCheckpoint,
    NoCheckpoint,
    NoSuchDevice,
    ShapesDiffer,
    WrongImageSize,
)
from services.policy.learning.images import reduce_images
from services.policy.policy import Observation
from services.policy.serving import library as library_module
from services.policy.serving.backend import StepInput, StepOutput
from services.policy.serving.decoding import choose_action, closed_probability, decide_grasp
from services.policy.serving.learned import LearnedPolicy, Model
from services.policy.serving.library import Library, ServingOptions, find_checkpoints
from tests.checkpoints import SMALL, write_checkpoint
from tests.unit.test_checkpoint import seal

WINDOW = SMALL["window"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    return write_checkpoint(tmp_path_factory.mktemp("serving") / "small")


def frame(step: int = 0, *, cell: str = "sim-0", seed: int | None = None, px: int = 128):
    """A frame of noise, of the simulation that owns the cell."""
    random = np.random.default_rng(step if seed is None else seed)
    left, right = random.integers(0, 256, size=(2, px * px), dtype=np.uint8)
    return m.StereoFrame(
        header=m.Header(cell=cell, epoch=1, source=cell, step=step, t_mono_ns=7 + step),
        camera="t265",
        width=px,
        height=px,
        left=left.tobytes(),
        right=right.tobytes(),
        due_step=step,
    )


class FakeBackend:
    """Says what it is told to, and keeps what it was given."""

    runtime, device = "fake", "cpu"

    def __init__(self, *, logit: float = 0.0, mean: float = 0.5) -> None:
        self.given: list[StepInput] = []
        self.logit, self.mean = logit, mean

    def run(self, given: StepInput) -> StepOutput:
        self.given.append(given)
        cells = len(given.images)
        means = np.zeros((cells, 3, 6), dtype=np.float32)
        means[:, 1] = self.mean
        return StepOutput(
            log_weights=np.log(np.tile(np.float32([0.2, 0.5, 0.3]), (cells, 1))),
            means=means,
            grasp_logit=np.full(cells, self.logit, dtype=np.float32),
            h=given.h + 1,
            c=given.c + 2,
        )


def fake_policy(folder: Path, **said: float) -> tuple[LearnedPolicy, FakeBackend]:
    backend = FakeBackend(**said)
    policy = Model("small", load_checkpoint(folder), backend).make_policy()
    policy.reset(seed=0, task="lid")
    return policy, backend


def act(policy: LearnedPolicy, step: int = 0) -> m.ActionStep:
    (action,) = policy.act(Observation(frame(step), None))
    return action


def test_the_network_sees_both_eyes_reduced_left_first(folder: Path):
    policy, backend = fake_policy(folder)
    seen = frame(3)
    policy.act(Observation(seen, None))
    eyes = [
        np.frombuffer(each, dtype=np.uint8).reshape(128, 128) for each in (seen.left, seen.right)
    ]
    np.testing.assert_array_equal(
        backend.given[0].images[0], reduce_images(np.stack(eyes), input_px=64)
    )


def test_actions_are_in_metres_and_radians_and_become_the_history(folder: Path):
    """Oldest first, zeros before the start, normalised; the same history that training has."""
    policy, backend = fake_policy(folder, mean=0.5)
    scale = np.array(load_checkpoint(folder).statistics.scale)
    for step in range(4):
        backend.mean = 0.1 * (step + 1)
        action = act(policy, step)
        commanded = [*action.translation_m, *action.rotation_rad]
        np.testing.assert_allclose(commanded, backend.mean * scale, rtol=1e-6)
    first = [given.history[0, :, 0].tolist() for given in backend.given]
    np.testing.assert_allclose(first, [[0, 0], [0, 0.1], [0.1, 0.2], [0.2, 0.3]], rtol=1e-6)


def test_the_recurrent_state_begins_anew_with_every_window(folder: Path):
    policy, backend = fake_policy(folder)
    for step in range(2 * WINDOW + 1):
        act(policy, step)
    ages = [float(given.h[0, 0, 0]) for given in backend.given]
    assert ages == [*range(WINDOW), *range(WINDOW), 0.0]
    assert [float(given.c[0, 0, 0]) for given in backend.given] == [2 * age for age in ages]
    # The history of actions goes on: training windows know what came before them.
    assert np.all(backend.given[WINDOW].history != 0)


def test_reset_forgets_everything(folder: Path):
    policy, backend = fake_policy(folder, logit=5.0)
    assert act(policy).grasp
    backend.logit = 0.0
    assert act(policy).grasp
    policy.reset(seed=0, task="lid")
    assert not act(policy).grasp
    assert not backend.given[-1].h.any()
    assert not backend.given[-1].history.any()


@pytest.mark.parametrize(
    ("probability", "closed", "then"),
    [
        (0.59, False, False),
        (0.61, False, True),
        (0.41, True, True),
        (0.39, True, False),
    ],
)
def test_the_grasp_does_not_flutter(probability: float, closed: bool, then: bool):
    hysteresis = GraspHysteresis(close_above=0.6, open_below=0.4)
    assert decide_grasp(probability, closed=closed, hysteresis=hysteresis) is then


@pytest.mark.parametrize("closed", [True, False])
def test_without_a_gap_only_the_probability_decides(closed: bool):
    for probability in (0.49, 0.51):
        decided = decide_grasp(probability, closed=closed, hysteresis=GraspHysteresis())
        assert decided is (probability > 0.5)


def test_the_probability_of_a_closed_gripper():
    pose = np.zeros(6, dtype=np.float32)
    assert closed_probability(pose, 0.0) == 0.5
    assert closed_probability(pose, float(np.log(3.0))) == pytest.approx(0.75)
    assert closed_probability(pose, -1e4) == 0.0
    with_grasp = np.array([0, 0, 0, 0, 0, 0, 1 / 1.2], dtype=np.float32)
    assert closed_probability(with_grasp, None) == pytest.approx(1.0)


def test_samples_are_drawn_by_weight_with_little_noise():
    random = np.random.default_rng(0)
    weights = np.log(np.float32([0.25, 0.75]))
    means = np.float32([[0.0] * 6, [0.5] * 6])
    drawn = np.array(
        [choose_action(weights, means, decoding="sample", random=random) for _ in range(2000)]
    )
    share = np.mean(drawn[:, 0] > 0.25)
    assert 0.7 < share < 0.8
    noise = drawn - 0.5 * (drawn > 0.25)
    assert 0.9e-4 < noise.std() < 1.1e-4
    best = choose_action(weights, means, decoding="most-likely", random=random)
    np.testing.assert_array_equal(best, means[1])


def test_sampling_repeats_for_a_seed(folder: Path):
    library = Library(ServingOptions(decoding="sample"))
    library.load("small", folder)

    def actions(seed: int) -> list[list[float]]:
        policy = library.make_policy("small")
        policy.reset(seed=seed, task="lid")
        return [act(policy, step).translation_m for step in range(8)]

    assert actions(1) == actions(1)
    assert actions(1) != actions(2)


def test_frames_of_another_size_are_refused(folder: Path):
    policy, _ = fake_policy(folder)
    with pytest.raises(WrongImageSize, match="64 x 64"):
        policy.act(Observation(frame(px=64), None))


def test_a_task_it_was_not_trained_for_is_refused(folder: Path):
    policy, _ = fake_policy(folder)
    with pytest.raises(UntrainedTask, match="cup") as caught:
        policy.reset(seed=0, task="cup")
    assert caught.value.tasks == ("lid",)


@pytest.mark.parametrize("device", ["cuda:99", "tpu", "cuda:x"])
@pytest.mark.parametrize("backend", ["onnx", "torch"])
def test_a_device_that_is_not_there_is_named(folder: Path, backend, device: str):
    library = Library(ServingOptions(backend=backend, device=device))
    with pytest.raises(NoSuchDevice) as caught:
        library.load("small", folder)
    assert caught.value.device == device
    assert "cpu" in caught.value.available


def test_no_thread_at_all_is_refused(folder: Path):
    with pytest.raises(InvalidValue, match="threads"):
        Library(ServingOptions(threads=0)).load("small", folder)


def test_a_graph_of_another_network_is_refused(folder: Path, tmp_path: Path):
    broken = Path(shutil.copytree(folder, tmp_path / "small"))
    other = write_checkpoint(tmp_path / "other", history={"steps": 3})
    for name in ("model.onnx", "model.safetensors"):
        shutil.copy(other / name, broken)
    seal(broken)
    with pytest.raises(ShapesDiffer, match="history"):
        Library().load("small", broken)


def test_a_graph_that_is_none_is_refused(folder: Path, tmp_path: Path):
    broken = Path(shutil.copytree(folder, tmp_path / "small"))
    (broken / "model.onnx").write_bytes(b"no graph")
    seal(broken)
    with pytest.raises(DamagedCheckpoint, match="ONNX Runtime"):
        Library().load("small", broken)


def test_a_failed_load_leaves_what_was_there(folder: Path, tmp_path: Path):
    library = Library(base=tmp_path)
    library.load("small", folder)
    before = library.describe()
    with pytest.raises(NoCheckpoint):
        library.load("small", "none")
    assert library.describe() == before
    assert before["small"].tasks == ["lid"]


def test_a_missing_library_names_its_extra(folder: Path, monkeypatch):
    monkeypatch.setitem(sys.modules, "services.policy.serving.torch_backend", None)
    with pytest.raises(MissingExtra) as caught:
        Library(ServingOptions(backend="torch")).load("small", folder)
    assert caught.value.extra == "train"


def test_checkpoints_are_found_by_their_folder(folder: Path, tmp_path: Path):
    shutil.copytree(folder, tmp_path / "one")
    (tmp_path / "no-checkpoint").mkdir()
    assert find_checkpoints(tmp_path) == {"one": tmp_path / "one"}
    assert all(load_checkpoint(each) for each in library_module.find_shipped().values())


def test_serving_and_saved_policies_need_no_torch(folder: Path):
    code = f"""
import sys
for name in ("torch", "safetensors", "onnx"):
    sys.modules[name] = None
import client.main, client.offline, services.policy.__main__
from services.policy.reactor import PolicyReactor
from services.policy.serving.library import Library
library = Library()
library.load("small", {str(folder)!r})
print(PolicyReactor(node="policy", library=library).offers()["policies"])
"""
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False
    )
    assert "'small'" in done.stdout, done.stderr
