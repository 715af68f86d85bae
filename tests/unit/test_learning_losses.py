from __future__ import annotations

from functools import partial

import numpy as np
import pytest
import torch
from torch.nn import functional

from common.errors import InvalidValue
from services.policy.learning.config import (
    BcRnnConfig,
    InvariantForm,
    LegatoConfig,
    LegatoSe3Config,
    NetworkConfig,
    PaperForm,
    SmoothForm,
)
from services.policy.learning.losses import (
    LossTerms,
    Targets,
    compute_chunk_error,
    compute_grasp_loss,
    compute_grasp_weights,
    compute_invariant_loss,
    compute_loss,
    normalise_targets,
)
from services.policy.learning.network import PolicyNetwork, PolicyOutput
from services.policy.learning.normalization import (
    ActionStatistics,
    MotionScale,
    denormalise_grasp,
    normalise_grasp,
)
from tests import invariants_reference as reference

TINY = {
    "encoder": {"width": 4, "input_px": 64, "map_px": 2, "keypoints": 4, "features": 8},
    "lstm": {"layers": 2, "width": 8},
    "mlp": {"layers": 2, "width": 16},
    "mixture": {"modes": 3},
}
SCALE = MotionScale(step_m=0.017, turn_rad=0.05)
FORMS = [SmoothForm(), PaperForm(), PaperForm(full=False)]
STATISTICS = ActionStatistics.of(reference.random_deltas(500))


@pytest.fixture(autouse=True, scope="module")
def _one_thread():
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


def make_targets(batch: int = 3, steps: int = 4, history: int = 2, factor: float = 1.0) -> Targets:
    deltas = reference.random_deltas(batch * steps * (history + 1), seed=4)
    deltas = torch.tensor(factor * deltas, dtype=torch.float32)
    deltas = deltas.reshape(batch, steps, history + 1, 6)
    return Targets(
        actions=deltas[:, :, -1],
        grasp=torch.arange(batch * steps).reshape(batch, steps) % 2,
        grasp_weight=torch.ones(batch, steps),
        history=deltas[:, :, :-1],
    )


def run(config: NetworkConfig, targets: Targets) -> tuple[PolicyNetwork, PolicyOutput, LossTerms]:
    torch.manual_seed(0)
    network = PolicyNetwork(config)
    batch, steps = targets.actions.shape[:2]
    images = torch.randint(0, 256, (batch, steps, 2, 64, 64), dtype=torch.uint8)
    past = torch.zeros(batch, steps, config.history.steps, 6)
    output, _ = network(images, past)
    return network, output, compute_loss(output, targets, config=config, statistics=STATISTICS)


def legato(form: InvariantForm, weight: float = 1.0) -> LegatoConfig:
    invariant = {"form": form.model_dump(), "weight": weight}
    return LegatoConfig.model_validate(TINY | {"loss": {"invariant": invariant}})


def gradients(network: PolicyNetwork, loss: torch.Tensor) -> dict[str, torch.Tensor]:
    network.zero_grad()
    loss.backward()
    return {n: p.grad for n, p in network.named_parameters() if p.grad is not None}


@pytest.mark.parametrize("form", FORMS, ids=str)
def test_the_invariant_loss_reaches_the_weights(form: InvariantForm):
    network, _, terms = run(legato(form), make_targets())
    assert terms.invariant is not None
    assert terms.invariant.requires_grad
    found = gradients(network, terms.invariant)
    assert all(torch.isfinite(g).all() for g in found.values())
    for part in ("left", "right", "lstm", "mlp", "mixture.means"):
        assert sum(g.norm() for n, g in found.items() if n.startswith(part)) > 0.0
    assert not any(n.startswith(("grasp", "mixture.weights", "mixture.stds")) for n in found)


@pytest.mark.parametrize("form", FORMS, ids=str)
@pytest.mark.parametrize("factor", [0.0, 1e-4])
def test_gradients_at_rest_are_finite(form: InvariantForm, factor: float):
    network, _, terms = run(legato(form), make_targets(factor=factor))
    assert all(torch.isfinite(g).all() for g in gradients(network, terms.total).values())


def test_a_step_against_the_gradient_lowers_each_term():
    targets = make_targets()
    for name in ("nll", "grasp", "invariant"):
        torch.manual_seed(0)
        network = PolicyNetwork(legato(SmoothForm())).eval()
        images = torch.randint(0, 256, (3, 4, 2, 64, 64), dtype=torch.uint8)
        values: list[float] = []
        optimiser = torch.optim.SGD(network.parameters(), lr=1e-3)
        for _ in range(2):
            output, _ = network(images, torch.zeros(3, 4, 2, 6))
            terms = compute_loss(output, targets, config=network.config, statistics=STATISTICS)
            values.append(getattr(terms, name).item())
            optimiser.zero_grad()
            getattr(terms, name).backward()
            optimiser.step()
        assert values[1] < values[0]


def test_terms_add_up():
    config = LegatoConfig.model_validate(
        TINY | {"loss": {"nll": 2.0, "grasp": {"weight": 3.0}, "invariant": {"weight": 0.5}}}
    )
    _, output, terms = run(config, make_targets())
    assert terms.grasp is not None
    assert terms.invariant is not None
    expected = 2.0 * terms.nll + 3.0 * terms.grasp + 0.5 * terms.invariant
    torch.testing.assert_close(terms.total, expected)
    targets = make_targets()
    scale = torch.tensor(STATISTICS.scale)
    torch.testing.assert_close(terms.nll, -output.mixture.log_prob(targets.actions / scale).mean())


def test_se3_has_no_invariants():
    _, _, terms = run(LegatoSe3Config.model_validate(TINY), make_targets())
    assert terms.invariant is None
    assert terms.grasp is not None
    torch.testing.assert_close(terms.total, terms.nll + terms.grasp)


@pytest.mark.parametrize("invariant", [None, {"weight": 0.5}], ids=["plain", "with invariants"])
def test_bc_rnn(invariant: dict[str, float] | None):
    config = BcRnnConfig.model_validate(TINY | {"loss": {"invariant": invariant}})
    network, _, terms = run(config, make_targets())
    assert terms.grasp is None
    assert (terms.invariant is None) == (invariant is None)
    assert all(torch.isfinite(g).all() for g in gradients(network, terms.total).values())
    targets = normalise_targets(make_targets(), statistics=STATISTICS, head=config.head)
    assert set(targets[..., 6].flatten().tolist()) == {-np.float32(1 / 1.2), np.float32(1 / 1.2)}


def test_grasp_as_a_dimension_round_trips():
    grasp = torch.tensor([0.0, 0.5, 1.0])
    torch.testing.assert_close(denormalise_grasp(normalise_grasp(grasp)), grasp)
    assert normalise_grasp(grasp).abs().max() < 1.0


def reference_phi(deltas: np.ndarray, form: InvariantForm, scale: MotionScale) -> np.ndarray:
    v, w = reference.steps_and_turns(deltas)
    if isinstance(form, PaperForm):
        return np.concatenate([reference.paper(x, full=form.full) for x in (v, w)])
    linear = reference.smooth(v, e=1e-3, e_s=1e-3, S=scale.step_m)
    return np.concatenate([linear, reference.smooth(w, e=5e-3, e_s=1e-3, S=scale.turn_rad)])


@pytest.mark.parametrize("form", FORMS, ids=str)
def test_invariant_loss_equals_its_definition(form: InvariantForm):
    targets, config = make_targets(), legato(form)
    _, output, terms = run(config, targets)
    scale = STATISTICS.motion_scale
    pose_scale = np.array(STATISTICS.scale)
    mixture = output.mixture
    gamma = mixture.responsibilities(targets.actions / torch.tensor(STATISTICS.scale)).numpy()
    means = mixture.means.detach().double().numpy() * pose_scale
    total = 0.0
    for b, t in np.ndindex(3, 4):
        history = targets.history[b, t].double().numpy()
        action = targets.actions[b, t].double().numpy()
        wanted = reference_phi(np.vstack([history, action]), form, scale)
        for k in range(3):
            got = reference_phi(np.vstack([history, means[b, t, k]]), form, scale)
            total += gamma[b, t, k] * np.sum((got - wanted) ** 2)
    assert terms.invariant is not None
    assert terms.invariant.item() == pytest.approx(total / 12, rel=1e-4)


@pytest.mark.parametrize("form", FORMS, ids=str)
@pytest.mark.parametrize("chunk", [1, 16])
def test_chunk_error_equals_its_definition(form: InvariantForm, chunk: int):
    deltas = reference.random_deltas(2 + 2 * chunk, seed=6)
    history, predicted, demonstrated = np.split(deltas, [2, 2 + chunk])
    got = compute_chunk_error(
        *(torch.tensor(x) for x in (history, predicted, demonstrated)), form=form, scale=SCALE
    )
    values = [
        reference_phi(np.vstack([history, x]), form, SCALE) for x in (predicted, demonstrated)
    ]
    assert got.item() == pytest.approx(np.sum((values[0] - values[1]) ** 2), rel=1e-9)


@pytest.mark.parametrize("form", FORMS, ids=str)
def test_a_chunk_of_one_is_the_single_step(form: InvariantForm):
    """P = 0: one component, so that gamma = 1."""
    config = LegatoConfig.model_validate(
        TINY | {"mixture": {"modes": 1}, "loss": {"invariant": {"form": form.model_dump()}}}
    )
    targets = make_targets()
    _, output, terms = run(config, targets)
    predicted = output.mixture.means * torch.tensor(STATISTICS.scale)
    error = compute_chunk_error(
        targets.history,
        predicted,
        targets.actions[..., None, :],
        form=form,
        scale=STATISTICS.motion_scale,
    )
    assert terms.invariant is not None
    torch.testing.assert_close(terms.invariant, error.mean().to(terms.invariant.dtype))


@pytest.mark.parametrize("form", [SmoothForm(), PaperForm()], ids=str)
def test_steps_beyond_the_end_do_not_count(form: InvariantForm):
    deltas = torch.tensor(reference.random_deltas(18, seed=6))
    history, predicted, demonstrated = deltas[:2], deltas[2:10], deltas[10:]
    error = partial(compute_chunk_error, form=form, scale=SCALE)
    got = error(history, predicted, demonstrated, valid=torch.arange(8) < 5)
    short = error(history, predicted[:5], demonstrated[:5])
    torch.testing.assert_close(got, short)


def test_history_of_another_length_is_refused():
    config = legato(SmoothForm())
    targets = make_targets(history=3)
    _, output, _ = run(config, make_targets())
    with pytest.raises(InvalidValue, match="history"):
        compute_invariant_loss(
            output.mixture,
            torch.ones(3, 4, 3),
            targets,
            config=config.loss.invariant,
            statistics=STATISTICS,
        )


def test_grasp_loss_is_the_weighted_cross_entropy_of_two_classes():
    logit = torch.tensor([[2.0, -1.0, 30.0]])
    grasp = torch.tensor([[1, 1, 0]])
    weight = torch.tensor([[1.0, 3.0, 1.0]])
    two = torch.stack([torch.zeros_like(logit), logit], dim=-1)
    each = functional.cross_entropy(two.flatten(0, 1), grasp.flatten(), reduction="none")
    expected = (each * weight.flatten()).sum() / 5.0
    torch.testing.assert_close(compute_grasp_loss(logit, grasp, weight), expected)


def test_grasp_weights_surround_transitions():
    grasp = torch.tensor([[0, 0, 0, 0, 0, 1, 1, 1, 1, 1], [0] * 10])
    weights = compute_grasp_weights(grasp, transition_weight=3.0, steps=2)
    assert weights.tolist() == [[1, 1, 1, 3, 3, 3, 3, 1, 1, 1], [1] * 10]
    assert compute_grasp_weights(grasp, transition_weight=3.0, steps=0).eq(1.0).all()


def test_grasp_weights_at_the_ends():
    grasp = torch.tensor([1, 0, 0, 0, 0, 1])
    weights = compute_grasp_weights(grasp, transition_weight=2.0, steps=3)
    assert weights.tolist() == [2, 2, 2, 2, 2, 2]
    assert compute_grasp_weights(grasp[:1], transition_weight=2.0, steps=3).tolist() == [1]
