"""The policy service with learned policies: batches, loading, errors."""

from __future__ import annotations

from pathlib import Path

import pytest

from common import messages as m
from common.metrics.table import BATCH, INFERENCE
from services.policy.reactor import PolicyReactor
from services.policy.serving import library as library_module
from services.policy.serving.backend import ROWS
from services.policy.serving.library import Library
from tests.checkpoints import write_checkpoint
from tests.unit.test_serving import FakeBackend, frame

CELLS = [f"sim-{number}" for number in range(3)]


@pytest.fixture(scope="module")
def folders(tmp_path_factory) -> dict[str, Path]:
    base = tmp_path_factory.mktemp("reactor")
    return {name: write_checkpoint(base / name, seed=seed) for seed, name in enumerate("ab")}


@pytest.fixture
def reactor(folders) -> PolicyReactor:
    library = Library()
    library.load("learned", folders["a"])
    return PolicyReactor(node="policy", library=library)


def configure(cell: str = "sim-0", *, policy: str = "learned", task: str = "lid", epoch: int = 1):
    return m.EpisodeConfigure(
        header=m.Header(cell=cell, epoch=epoch),
        task=task,
        robot="abstract",
        policy=policy,
        seed=3,
        mode="lockstep",
        nodes={"sim": cell, "policy": "policy"},
    )


def load(folder: Path | str, *, policy: str = "learned", node: str = "policy") -> m.PolicyLoad:
    return m.PolicyLoad(
        header=m.Header(), request="l-1", node=node, policy=policy, folder=str(folder)
    )


def actions(outputs) -> list[tuple]:
    """What does not depend on how long it took."""
    return [
        (each.header.cell, each.for_step, each.steps)
        for each in outputs
        if isinstance(each, m.PolicyAction)
    ]


def see(cell: str, step: int) -> m.StereoFrame:
    return frame(step, cell=cell, seed=hash_of(cell, step))


def hash_of(cell: str, step: int) -> int:
    return 1000 * CELLS.index(cell) + step


def test_cells_that_wait_together_get_what_each_gets_alone(reactor: PolicyReactor, folders):
    def run(together: bool) -> list[tuple]:
        for cell in CELLS:
            reactor.handle([configure(cell)])
        said = []
        for step in range(0, 80, 10):
            frames = [see(cell, step) for cell in CELLS]
            for batch in [frames] if together else [[each] for each in frames]:
                said += actions(reactor.handle(batch))
        return said

    alone = run(together=False)
    assert [(cell, step) for cell, step, _ in alone[:4]] == [
        *((cell, 0) for cell in CELLS),
        ("sim-0", 10),
    ]
    assert run(together=True) == alone
    assert len({str(steps) for _, _, steps in alone}) == len(alone)


def test_one_pass_serves_all_that_wait(folders, monkeypatch):
    backend = FakeBackend()
    monkeypatch.setattr(library_module, "open_backend", lambda *_: backend)
    library = Library()
    library.load("learned", folders["a"])
    reactor = PolicyReactor(node="policy", library=library)
    backend.given.clear()
    for cell in CELLS:
        reactor.handle([configure(cell)])
    frames = [see(cell, 0) for cell in CELLS]
    outputs = list(reactor.handle(frames))
    assert [len(given.images) for given in backend.given] == [3]
    assert len({each.inference_s for each in outputs}) == 1
    assert outputs[0].inference_s > 0
    measured = [each[:2] for each in reactor.measure([], outputs, 0)]
    assert measured == [(INFERENCE, outputs[0].inference_s), (BATCH, 3)]
    assert list(reactor.handle(frames)) == outputs
    assert list(reactor.measure([], outputs, 0)) == []


def test_the_sizes_of_a_pass_are_warm_before_a_policy_is_offered(folders, monkeypatch):
    backend = FakeBackend()
    monkeypatch.setattr(library_module, "open_backend", lambda *_: backend)
    Library().load("learned", folders["a"])
    assert [len(given.images) for given in backend.given] == [1, ROWS]


def test_a_frame_that_comes_twice_is_answered_once_per_batch(reactor: PolicyReactor):
    reactor.handle([configure()])
    first = actions(reactor.handle([see("sim-0", 0), see("sim-0", 0)]))
    assert len(first) == 1
    assert actions(reactor.handle([see("sim-0", 0)])) == first
    second = actions(reactor.handle([see("sim-0", 10)]))
    assert second[0][1] == 10


def test_a_new_episode_begins_after_what_was_seen_before_it(reactor: PolicyReactor):
    reactor.handle([configure()])
    fresh = actions(reactor.handle([see("sim-0", 0)]))
    outputs = list(reactor.handle([see("sim-0", 10), configure(epoch=2), see("sim-0", 0)]))
    assert [type(each).__name__ for each in outputs] == [
        "PolicyAction",
        "EpisodeReady",
        "PolicyAction",
    ]
    assert actions(outputs)[1] == fresh[0]


def test_learned_and_scripted_policies_share_a_service(reactor: PolicyReactor):
    reactor.handle([configure("sim-0"), configure("sim-1", policy="hold")])
    said = actions(reactor.handle([see("sim-1", 0), see("sim-0", 0)]))
    assert [cell for cell, _, _ in said] == ["sim-1", "sim-0"]
    assert said[0][2][0].translation_m == [0.0] * 3
    assert said[1][2][0].translation_m != [0.0] * 3


def test_a_wrong_frame_ends_its_own_episode_only(reactor: PolicyReactor):
    for cell in CELLS:
        reactor.handle([configure(cell)])
    wrong = frame(0, cell="sim-1", px=64)
    outputs = list(reactor.handle([see("sim-0", 0), wrong, see("sim-2", 0)]))
    assert [cell for cell, _, _ in actions(outputs)] == ["sim-0", "sim-2"]
    (told,) = [each for each in outputs if isinstance(each, m.EpisodeReady)]
    assert (told.header.cell, told.header.epoch) == ("sim-1", 1)
    assert told.problem is not None
    assert told.problem.code == "E-IMAGE-SIZE"
    assert not reactor.serves("sim-1")


def test_a_task_it_was_not_trained_for_is_a_problem(reactor: PolicyReactor):
    (ready,) = reactor.handle([configure(task="cup")])
    assert ready.problem is not None
    assert ready.problem.code == "E-UNTRAINED-TASK"
    assert not reactor.serves("sim-0")


def test_an_unknown_policy_lists_the_learned_ones_too(reactor: PolicyReactor):
    (ready,) = reactor.handle([configure(policy="lerned")])
    assert ready.problem is not None
    assert ready.problem.action == "did you mean: learned"


def test_switching_leaves_running_episodes_alone(reactor: PolicyReactor, folders):
    reactor.handle([configure("sim-0")])
    frames = [see("sim-0", step) for step in (0, 10, 20)]
    undisturbed = [actions(reactor.handle([each])) for each in frames]
    reactor.handle([configure("sim-0", epoch=2)])
    again = [actions(reactor.handle([frames[0]]))]
    (loaded,) = reactor.handle([load(folders["b"])])
    assert isinstance(loaded, m.PolicyLoaded)
    assert loaded.problem is None
    assert loaded.checkpoint == reactor.checkpoints()["learned"]
    assert loaded.checkpoint is not None
    assert loaded.checkpoint.folder == str(folders["b"])
    again += [actions(reactor.handle([each])) for each in frames[1:]]
    assert again == undisturbed
    reactor.handle([configure("sim-0", epoch=3)])
    assert actions(reactor.handle([frames[0]])) != undisturbed[0]


def test_loading_adds_a_name(reactor: PolicyReactor, folders):
    reactor.handle([load(folders["b"], policy="other")])
    assert reactor.offers()["policies"] == [
        "expert",
        "expert-noisy",
        "hold",
        "learned",
        "other",
        "random",
    ]
    hashes = {name: each.sha256 for name, each in reactor.checkpoints().items()}
    assert hashes["learned"] != hashes["other"]


def test_a_load_that_fails_says_why_and_changes_nothing(reactor: PolicyReactor, tmp_path: Path):
    before = reactor.checkpoints()
    for order, code in (
        (load(tmp_path / "none"), "E-NO-CHECKPOINT"),
        (load(tmp_path, policy="expert"), "E-INVALID-VALUE"),
    ):
        (loaded,) = reactor.handle([order])
        assert loaded.checkpoint is None
        assert loaded.problem is not None
        assert (loaded.request, loaded.problem.code) == ("l-1", code)
    assert reactor.checkpoints() == before


def test_an_order_for_another_service_is_not_ours(reactor: PolicyReactor, folders):
    assert list(reactor.handle([load(folders["b"], node="policy-2")])) == []
