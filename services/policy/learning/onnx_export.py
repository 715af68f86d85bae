"""The policy network as an ONNX graph for ONNX Runtime, checked against torch.

The graph is one step of deployment for any number of images and any number of rows:

    points = key points of `images`;  x = points[`rows`];  the rest of the network on x

Convolutions work image by image, so they run on as many images as there are. The matrix products
behind them need not: a library may choose the order of a sum by the number of rows. `rows` lets the
caller fix that number, whatever shares the step (`serving/backend.py`).

The graph is written down here rather than traced: it takes milliseconds instead of ten seconds,
its names are stable, and it shares its weights with `model.safetensors`. That it says what the
network says is checked at every export.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping
from pathlib import Path
from typing import TypeAlias, cast

import numpy as np
import numpy.typing as npt
import onnxruntime as ort
import torch
from onnx import ModelProto, TensorProto
from torch import nn

from services.policy.learning.checkpoint_errors import ExportDiffers
from services.policy.learning.encoder import Encoder
from services.policy.learning.network import PolicyNetwork
from services.policy.learning.onnx_graph import GraphBuilder, write_graph
from services.policy.learning.onnx_signature import (
    EYES,
    POSE_DIMS,
    action_dims,
    input_shapes,
    output_shapes,
)
from services.policy.learning.resnet import BasicBlock, ResNet18
from services.policy.learning.spatial_softmax import SpatialSoftmax

TOLERANCE = 1e-5
"""Relative above 1."""
STATES = ("h", "c")

_CHECKED_STEPS = 3
_CHECKED_ROWS = 2
_TYPES = {"images": TensorProto.UINT8, "rows": TensorProto.INT64}

Arrays: TypeAlias = dict[str, npt.NDArray[np.float32]]


def export_graph(path: Path, weights: Path, network: PolicyNetwork) -> None:
    """Write a network's graph beside its weights.

    Args:
        path: File to write.
        weights: The network's weights as `checkpoint_weights.write_weights` wrote them, in the
            same folder.
        network: On any device; it is not changed.

    Raises:
        ExportDiffers: The graph's outputs differ by more than 1e-5 from torch's.
    """
    write_graph(path, _build(weights, network))
    _compare(path, network)


def _build(weights: Path, network: PolicyNetwork) -> ModelProto:
    return _Translation(GraphBuilder(weights), network).model()


class _Translation:
    """Module by module, from torch to ONNX."""

    def __init__(self, graph: GraphBuilder, network: PolicyNetwork) -> None:
        self._graph = graph
        self._network = network
        self._names = {module: name for name, module in network.named_modules()}

    def model(self) -> ModelProto:
        """The whole step."""
        config, graph = self._network.config, self._graph
        scaled = graph.add(
            "Div",
            graph.add("Cast", "images", to=TensorProto.FLOAT),
            graph.constant("white", np.array(255.0, dtype=np.float32)),
        )
        eyes = graph.add_many(
            "Split", [scaled], ["left_image", "right_image"], axis=1, num_outputs=2
        )
        encoders = (self._network.left, self._network.right)
        seen = [self._encode(encoder, eye) for encoder, eye in zip(encoders, eyes, strict=True)]
        past: list[str] = []
        if config.history.steps:
            shape = graph.integers(-1, POSE_DIMS * config.history.steps)
            past.append(graph.add("Reshape", "history", shape))
        remembered = self._remember(graph.add("Concat", *seen, *past, axis=-1))
        if config.mlp.sees_images:
            remembered = graph.add("Concat", remembered, *seen, axis=-1)
        self._decide(self._translate(self._network.mlp, remembered))
        return graph.build(
            "policy_step",
            inputs=[
                (name, _TYPES.get(name, TensorProto.FLOAT), shape)
                for name, shape in input_shapes(config).items()
            ],
            outputs=[
                (name, TensorProto.FLOAT, shape) for name, shape in output_shapes(config).items()
            ],
        )

    def _encode(self, encoder: Encoder, image: str) -> str:
        """Image by image up to the key points, row by row from there."""
        seen = self._translate(encoder.resnet, self._translate(encoder.fold, image))
        maps = self._translate(encoder.keypoints, seen)
        points = self._graph.add("Gather", self._translate(encoder.softmax, maps), "rows", axis=0)
        linear = self._translate(encoder.linear, self._translate(encoder.norm, points))
        return self._graph.add("Relu", linear)

    def _translate(self, module: nn.Module, x: str) -> str:
        """A module applied to a value."""
        match module:
            case nn.Identity():
                return x
            case nn.Sequential():
                for child in module:
                    x = self._translate(child, x)
                return x
            case ResNet18():
                return self._translate(module.stages, self._translate(module.stem, x))
            case BasicBlock():
                y = self._translate(module.relu, self._chain(x, module.conv1, module.bn1))
                y = self._chain(y, module.conv2, module.bn2)
                total = self._graph.add("Add", y, self._translate(module.shortcut, x))
                return self._translate(module.relu, total)
            case SpatialSoftmax():
                return self._find_keypoints(module, x)
            case _:
                return self._translate_layer(module, x)

    def _translate_layer(self, module: nn.Module, x: str) -> str:
        graph = self._graph
        match module:
            case nn.ReLU():
                return graph.add("Relu", x)
            case nn.Linear():
                return graph.add("Gemm", x, *self._weights(module, "weight", "bias"), transB=1)
            case nn.Conv2d():
                names = ["weight"] if module.bias is None else ["weight", "bias"]
                (padding, _), strides = module.padding, list(module.stride)
                inputs = (x, *self._weights(module, *names))
                return graph.add("Conv", *inputs, strides=strides, pads=[padding] * 4)
            case nn.BatchNorm1d() | nn.BatchNorm2d():
                names = ["weight", "bias", "running_mean", "running_var"]
                inputs = (x, *self._weights(module, *names))
                return graph.add("BatchNormalization", *inputs, epsilon=module.eps)
            case nn.LayerNorm():
                inputs = (x, *self._weights(module, "weight", "bias"))
                return graph.add("LayerNormalization", *inputs, axis=-1, epsilon=module.eps)
            case nn.PixelUnshuffle():
                return graph.add("SpaceToDepth", x, blocksize=module.downscale_factor)
            case nn.MaxPool2d():
                size, stride, pad = module.kernel_size, module.stride, module.padding
                return graph.add(
                    "MaxPool", x, kernel_shape=[size] * 2, strides=[stride] * 2, pads=[pad] * 4
                )
            case _:
                raise TypeError(f"no translation for {type(module).__name__}")

    def _chain(self, x: str, *modules: nn.Module) -> str:
        for module in modules:
            x = self._translate(module, x)
        return x

    def _find_keypoints(self, module: SpatialSoftmax, maps: str) -> str:
        """A product and a sum, as in torch: a matrix product would depend on the number of rows."""
        graph = self._graph
        places, channels = len(module.grid), self._network.config.encoder.keypoints
        flat = graph.add("Reshape", maps, graph.integers(-1, channels, 1, places))
        grid = module.grid.detach().cpu().numpy().T
        weighted = graph.add(
            "Mul", graph.add("Softmax", flat, axis=-1), graph.constant("grid", grid)
        )
        points = graph.add("ReduceSum", weighted, graph.integers(-1), keepdims=0)
        return graph.add("Reshape", points, graph.integers(-1, 2 * channels))

    def _remember(self, x: str) -> str:
        """The LSTM, one step of all rows."""
        graph, layers = self._graph, self._network.config.lstm.layers
        x = graph.add("Unsqueeze", x, graph.integers(0))
        before = [
            graph.add_many(
                "Split",
                [state],
                [f"{state}_{layer}" for layer in range(layers)],
                axis=0,
                num_outputs=layers,
            )
            for state in STATES
        ]
        after: list[list[str]] = []
        for layer, (h, c) in enumerate(zip(*before, strict=True)):
            inputs = [x, *self._gates(layer), "", h, c]
            names = ["", f"h_after_{layer}", f"c_after_{layer}"]
            width = self._network.config.lstm.width
            _, x, memory = graph.add_many("LSTM", inputs, names, hidden_size=width)
            after.append([x, memory])
        for state, parts in zip(STATES, zip(*after, strict=True), strict=True):
            graph.add("Concat", *parts, axis=0, name=f"{state}_after")
        return graph.add("Squeeze", x, graph.integers(0))

    def _gates(self, layer: int) -> list[str]:
        """Weights and biases of a layer, with the gates in ONNX's order: i, o, f, g."""
        graph, prefix = self._graph, self._names[self._network.lstm]

        def ordered(name: str) -> str:
            stored = graph.weight(f"{prefix}.{name}_l{layer}")
            parts = [f"{stored}_{gate}" for gate in "ifgo"]
            i, f, g, o = graph.add_many("Split", [stored], parts, axis=0, num_outputs=4)
            return graph.add("Concat", i, o, f, g, axis=0)

        biases = graph.add("Concat", ordered("bias_ih"), ordered("bias_hh"), axis=0)
        return [
            graph.add("Unsqueeze", each, graph.integers(0))
            for each in (ordered("weight_ih"), ordered("weight_hh"), biases)
        ]

    def _decide(self, features: str) -> None:
        """The heads, as far as deployment needs them."""
        graph, mixture = self._graph, self._network.mixture
        weights = self._translate(mixture.weights, features)
        graph.add("LogSoftmax", weights, axis=-1, name="log_weights")
        means = graph.add("Tanh", self._translate(mixture.means, features))
        config = self._network.config
        shape = graph.integers(-1, config.mixture.modes, action_dims(config))
        graph.add("Reshape", means, shape, name="means")
        if self._network.grasp is not None:
            logit = self._translate(self._network.grasp, features)
            graph.add("Squeeze", logit, graph.integers(-1), name="grasp_logit")

    def _weights(self, module: nn.Module, *names: str) -> list[str]:
        prefix = self._names[module]
        return [self._graph.weight(f"{prefix}.{name}") for name in names]


def _compare(path: Path, network: PolicyNetwork) -> None:
    """Run the graph beside the network for a few steps.

    Raises:
        ExportDiffers: They differ.
    """
    reference = copy.deepcopy(network).cpu().float().eval()
    session = ort.InferenceSession(path, providers=["CPUExecutionProvider"])
    config = network.config
    random = np.random.default_rng(0)
    state = reference.initial_state(_CHECKED_ROWS)
    seen: Arrays = {name: value.numpy() for name, value in zip(STATES, state, strict=True)}
    for _ in range(_CHECKED_STEPS):
        shape = (_CHECKED_ROWS, EYES, config.encoder.input_px, config.encoder.input_px)
        images = random.integers(0, 256, size=shape, dtype=np.uint8)
        history = random.standard_normal(
            (_CHECKED_ROWS, config.history.steps, POSE_DIMS), dtype=np.float32
        )
        with torch.inference_mode():
            output, state = reference.step(
                torch.from_numpy(images), torch.from_numpy(history), state
            )
        mixture = output.mixture
        expected = {"log_weights": mixture.log_weights, "means": mixture.means}
        expected |= {f"{name}_after": value for name, value in zip(STATES, state, strict=True)}
        if output.grasp_logit is not None:
            expected["grasp_logit"] = output.grasp_logit
        fed = {"images": images, "rows": np.arange(_CHECKED_ROWS), **seen}
        if config.history.steps:
            fed["history"] = history
        values = cast("list[npt.NDArray[np.float32]]", session.run(list(expected), fed))
        got = dict(zip(expected, values, strict=True))
        _check_close({name: value.numpy() for name, value in expected.items()}, got)
        seen = {name: got[f"{name}_after"] for name in STATES}


def _check_close(expected: Mapping[str, npt.NDArray[np.float32]], got: Arrays) -> None:
    for name, value in expected.items():
        difference = float(np.max(np.abs(got[name] - value) / np.maximum(np.abs(value), 1.0)))
        # Written so that NaN does not pass.
        if not difference <= TOLERANCE:
            raise ExportDiffers(name, difference, TOLERANCE)
