from __future__ import annotations

import pytest
import torch

from common.errors import InvalidValue
from services.policy.learning.config import BcRnnConfig, LegatoConfig
from services.policy.learning.network import PolicyNetwork
from services.policy.learning.resnet import BasicBlock, ResNet18
from services.policy.learning.spatial_softmax import SpatialSoftmax

TINY = {
    "encoder": {"width": 4, "input_px": 64, "map_px": 2, "keypoints": 4, "features": 8},
    "lstm": {"layers": 2, "width": 8},
    "mlp": {"layers": 2, "width": 16},
    "mixture": {"modes": 3},
}


@pytest.fixture(autouse=True, scope="module")
def _one_thread():
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.fixture(autouse=True)
def _seed():
    torch.manual_seed(0)


def tiny_network(**changes: object) -> PolicyNetwork:
    return PolicyNetwork(LegatoConfig.model_validate(TINY | changes))


def inputs(batch: int = 2, steps: int = 5, history: int = 2) -> tuple[torch.Tensor, torch.Tensor]:
    images = torch.randint(0, 256, (batch, steps, 2, 64, 64), dtype=torch.uint8)
    return images, torch.randn(batch, steps, history, 6)


@pytest.mark.parametrize("halving", [0, 1, 2, 3])
def test_map_of_the_resnet(halving: int):
    resnet = ResNet18(width=4, stages=4, halving_stages=halving)
    assert resnet(torch.zeros(1, 1, 64, 64)).shape == (1, 32, 16 >> halving, 16 >> halving)


def test_three_stages_leave_out_the_last():
    resnet = ResNet18(width=4, stages=3, halving_stages=1)
    assert resnet(torch.zeros(1, 1, 64, 64)).shape == (1, 16, 8, 8) == (1, resnet.channels, 8, 8)


def test_eighteen_layers():
    resnet = ResNet18(width=4, stages=4, halving_stages=3)
    kernels = [m.kernel_size[0] for m in resnet.modules() if isinstance(m, torch.nn.Conv2d)]
    assert len([size for size in kernels if size > 1]) + 1 == 18
    assert kernels.count(1) == 3


def test_ten_layers_with_one_block_per_stage():
    resnet = ResNet18(width=4, stages=4, blocks=1, halving_stages=3)
    kernels = [m.kernel_size[0] for m in resnet.modules() if isinstance(m, torch.nn.Conv2d)]
    assert len([size for size in kernels if size > 1]) + 1 == 10
    assert resnet(torch.zeros(1, 1, 64, 64)).shape == (1, 32, 2, 2)


@pytest.mark.parametrize(("outputs", "stride"), [(4, 1), (8, 2)])
def test_blocks_pass_their_input_on(outputs: int, stride: int):
    block = BasicBlock(4, outputs, stride=stride)
    torch.nn.init.zeros_(block.bn2.weight)
    x = torch.randn(2, 4, 6, 6)
    expected = x if stride == 1 else block.shortcut(x)
    torch.testing.assert_close(block(x), expected.relu())


def test_spatial_softmax_finds_peaks():
    maps = torch.zeros(1, 2, 5, 5)
    maps[0, 0, 0, 4] = 100.0
    maps[0, 1, 3, 1] = 100.0
    points = SpatialSoftmax(map_px=5)(maps)
    torch.testing.assert_close(points, torch.tensor([[1.0, -1.0, -0.5, 0.5]]))


def test_spatial_softmax_of_a_flat_map_is_the_middle():
    torch.testing.assert_close(SpatialSoftmax(map_px=4)(torch.ones(1, 3, 4, 4)), torch.zeros(1, 6))


def test_spatial_softmax_is_not_rounded_by_autocast():
    maps = torch.randn(2, 3, 4, 4).bfloat16()
    softmax = SpatialSoftmax(map_px=4)
    expected = softmax(maps.float())
    with torch.autocast("cpu", dtype=torch.bfloat16):
        torch.testing.assert_close(softmax(maps), expected, atol=0, rtol=0)


def test_shapes_of_a_window():
    output, (h, c) = tiny_network()(*inputs())
    assert output.mixture.log_weights.shape == (2, 5, 3)
    assert output.mixture.means.shape == output.mixture.stds.shape == (2, 5, 3, 6)
    assert output.grasp_logit is not None
    assert output.grasp_logit.shape == (2, 5)
    assert h.shape == c.shape == (2, 2, 8)


def test_bc_rnn_has_the_grasp_in_its_mixture():
    output, _ = PolicyNetwork(BcRnnConfig.model_validate(TINY))(*inputs())
    assert output.grasp_logit is None
    assert output.mixture.means.shape == (2, 5, 3, 7)


@pytest.mark.parametrize("history", [0, 2, 3])
@pytest.mark.parametrize("keypoint_batchnorm", [True, False])
def test_single_steps_equal_the_window(history: int, keypoint_batchnorm: bool):
    encoder = TINY["encoder"] | {"keypoint_batchnorm": keypoint_batchnorm}
    network = tiny_network(history={"steps": history}, encoder=encoder)
    images, past = inputs(history=history)
    network(images, past)  # moves the running statistics away from their start
    network.eval()
    with torch.no_grad():
        window, last = network(images, past)
        state = network.initial_state(2)
        for t in range(images.shape[1]):
            output, state = network.step(images[:, t], past[:, t], state)
            for name in ("log_weights", "means", "stds"):
                torch.testing.assert_close(
                    getattr(output.mixture, name), getattr(window.mixture, name)[:, t]
                )
            torch.testing.assert_close(output.grasp_logit, window.grasp_logit[:, t])
    torch.testing.assert_close(state, last)


def test_the_recurrent_state_matters():
    network = tiny_network().eval()
    images, past = inputs()
    output, state = network(images, past)
    again, _ = network(images, past, state)
    assert not torch.equal(output.mixture.means, again.mixture.means)


def test_eyes_are_separate_and_ordered():
    network = tiny_network().eval()
    seen: list[torch.Tensor] = []
    network.left.register_forward_pre_hook(lambda _, args: seen.append(args[0]))
    images, past = inputs(batch=1, steps=1)
    network(images, past)
    torch.testing.assert_close(seen[0], images[0, :, :1] / 255.0)
    assert network.left is not network.right


def test_history_reaches_the_output():
    network = tiny_network().eval()
    images, past = inputs()
    output, _ = network(images, past)
    other, _ = network(images, past + 1.0)
    assert not torch.equal(output.mixture.means, other.mixture.means)


def test_history_dropout_hides_whole_windows_in_training_only():
    network = tiny_network(history={"steps": 2, "dropout": 0.5})
    seen: list[torch.Tensor] = []
    network.lstm.register_forward_pre_hook(lambda _, args: seen.append(args[0][..., -12:]))
    images, past = inputs(batch=40, steps=2)
    network(images, past)
    shown = (seen[0] == past.flatten(2)).all(-1).all(-1)
    hidden = (seen[0] == 0.0).all(-1).all(-1)
    assert (shown ^ hidden).all()
    assert 8 < hidden.sum() < 32
    network.eval()(images, past)
    assert torch.equal(seen[1], past.flatten(2))


def test_convolutions_are_channels_last():
    network = tiny_network()
    weights = [m.weight for m in network.left.modules() if isinstance(m, torch.nn.Conv2d)]
    assert all(w.is_contiguous(memory_format=torch.channels_last) for w in weights)
    assert not all(w.is_contiguous() for w in weights)


def test_autocast_keeps_the_heads_in_single_precision():
    with torch.autocast("cpu", dtype=torch.bfloat16):
        output, _ = tiny_network()(*inputs())
    assert output.mixture.means.dtype == output.mixture.stds.dtype == torch.float32
    assert output.grasp_logit.dtype == torch.float32


@pytest.mark.parametrize(
    ("images", "history"),
    [
        (torch.zeros(1, 1, 2, 64, 64), torch.zeros(1, 1, 2, 6)),
        (torch.zeros(1, 1, 2, 128, 128, dtype=torch.uint8), torch.zeros(1, 1, 2, 6)),
        (torch.zeros(1, 2, 64, 64, dtype=torch.uint8), torch.zeros(1, 2, 6)),
        (torch.zeros(1, 1, 2, 64, 64, dtype=torch.uint8), torch.zeros(1, 1, 3, 6)),
        (torch.zeros(1, 1, 2, 64, 64, dtype=torch.uint8), torch.zeros(1, 2, 2, 6)),
    ],
    ids=["float images", "camera size", "no time axis", "long history", "other window"],
)
def test_wrong_inputs_are_refused(images: torch.Tensor, history: torch.Tensor):
    with pytest.raises(InvalidValue, match="is"):
        tiny_network()(images, history)
