"""Nothing that may run what it reads: no pickle, and no loader that falls back to it."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FOLDERS = ("common", "services", "client", "policies", "examples")

PICKLES = {"pickle", "_pickle", "cPickle", "dill", "cloudpickle", "joblib", "shelve", "marshal"}
LOADERS = {"torch.load": ("weights_only", True, None), "numpy.load": ("allow_pickle", False, False)}
"""Function -> a keyword, the value that it must have, and the value that counts without it."""


def find_pickles(source: str) -> Iterator[str]:
    """Everything in a module that reads or writes pickle, or may."""
    tree = ast.parse(source)
    names = dict(imported(tree))
    for node in ast.walk(tree):
        if isinstance(node, ast.Import | ast.ImportFrom):
            modules = [alias.name for alias in node.names]
            if isinstance(node, ast.ImportFrom):
                modules = [node.module or ""]
            for module in modules:
                if module.split(".")[0] in PICKLES:
                    yield f"line {node.lineno}: imports {module}"
        if isinstance(node, ast.Call):
            called = qualified(node.func, names)
            if called in LOADERS and not is_safe(node, *LOADERS[called]):
                yield f"line {node.lineno}: {called} without {LOADERS[called][:2]}"
            if called in ("importlib.import_module", "__import__") and node.args:
                module = node.args[0]
                if isinstance(module, ast.Constant) and module.value in PICKLES:
                    yield f"line {node.lineno}: imports {module.value}"


def imported(tree: ast.Module) -> Iterator[tuple[str, str]]:
    """Name in the module -> what it stands for."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                whole = alias.name if alias.asname else alias.name.partition(".")[0]
                yield alias.asname or whole, whole
        if isinstance(node, ast.ImportFrom) and node.module:
            for alias in node.names:
                yield alias.asname or alias.name, f"{node.module}.{alias.name}"


def qualified(function: ast.expr, names: dict[str, str]) -> str:
    """Full name of what is called, e.g. `torch.load`; empty where it has none."""
    if isinstance(function, ast.Attribute):
        return f"{qualified(function.value, names)}.{function.attr}"
    return names.get(function.id, function.id) if isinstance(function, ast.Name) else ""


def is_safe(call: ast.Call, keyword: str, safe: bool, default: bool | None) -> bool:
    given = [each.value for each in call.keywords if each.arg in (keyword, None)]
    if not given:
        return default is safe
    return all(isinstance(value, ast.Constant) and value.value is safe for value in given)


@pytest.mark.parametrize(
    "source",
    [
        "import pickle",
        "import os, pickle as p",
        "from pickle import loads",
        "def f():\n    import dill.detect",
        "from joblib import load",
        "import importlib\nimportlib.import_module('pickle')",
        "__import__('marshal')",
        "import torch\ntorch.load(path)",
        "import torch\ntorch.load(path, weights_only=False)",
        "import torch\ntorch.load(path, weights_only=flag)",
        "import torch as t\nt.load(path, map_location='cpu')",
        "from torch import load\nload(path)",
        "from torch import load as read\nread(path)",
        "import torch\ntorch.load(path, **options)",
        "import numpy as np\nnp.load(path, allow_pickle=True)",
        "import numpy as np\nnp.load(path, allow_pickle=flag)",
    ],
)
def test_it_is_found(source):
    assert len(list(find_pickles(source))) == 1


@pytest.mark.parametrize(
    "source",
    [
        "import torch\ntorch.load(path, weights_only=True)",
        "import numpy as np\nnp.load(path)",
        "import numpy as np\nnp.load(path, allow_pickle=False)",
        "import json\njson.load(file)",
        "class Store:\n    def load(self): ...\nStore().load()",
        "pickle = 3",
    ],
)
def test_what_is_none_is_left_alone(source):
    assert list(find_pickles(source)) == []


def test_there_is_none():
    files = [path for folder in FOLDERS for path in sorted((ROOT / folder).rglob("*.py"))]
    assert len(files) > 200
    found = [
        f"{path.relative_to(ROOT)}: {what}"
        for path in files
        for what in find_pickles(path.read_text(encoding="utf-8"))
    ]
    assert found == []
