"""`requirements.lock` is what `make lock` would write: complete, hashed, and as was tested."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[2]
ADVICE = "run: make lock"


def read_entries(text: str) -> dict[str, tuple[Requirement, list[str]]]:
    """Requirement and hashes by name; a line that goes on ends in a backslash."""
    entries = {}
    for line in text.replace("\\\n", " ").splitlines():
        if line.strip() and not line.startswith("#"):
            pinned, *hashes = re.split(r"\s+--hash=", line.strip())
            requirement = Requirement(pinned)
            entries[canonicalize_name(requirement.name)] = (requirement, hashes)
    return entries


def version_of(requirement: Requirement) -> str:
    (pin,) = requirement.specifier
    assert pin.operator == "==", requirement
    return pin.version


def wanted(extra: str) -> Iterator[Requirement]:
    """Requirements of the project and one of its extras, through those that it names."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    yield from map(Requirement, project["dependencies"])
    for line in project["optional-dependencies"][extra]:
        requirement = Requirement(line)
        if requirement.name == project["name"]:
            for each in requirement.extras:
                yield from wanted(each)
        else:
            yield requirement


@pytest.fixture(scope="module")
def text():
    return (ROOT / "requirements.lock").read_text()


@pytest.fixture(scope="module")
def lock(text):
    return read_entries(text)


def test_it_satisfies_the_project(lock):
    for requirement in wanted("all"):
        name = canonicalize_name(requirement.name)
        assert name in lock, f"{requirement} is not locked; {ADVICE}"
        version = version_of(lock[name][0])
        assert requirement.specifier.contains(version), f"{requirement}, {version}; {ADVICE}"


def test_versions_are_those_that_were_tested(lock):
    tested = read_entries((ROOT / "constraints.txt").read_text())
    assert len(lock.keys() & tested.keys()) > 30
    for name in lock.keys() & tested.keys():
        assert version_of(lock[name][0]) == version_of(tested[name][0]), f"{name}; {ADVICE}"


def test_everything_that_this_platform_installs_was_tested(lock):
    tested = read_entries((ROOT / "constraints.txt").read_text())
    here = {
        name for name, (each, _) in lock.items() if each.marker is None or each.marker.evaluate()
    }
    assert here - tested.keys() == set(), "add them to constraints.txt"


def test_every_package_has_hashes(lock):
    for name, (_, hashes) in lock.items():
        assert hashes, name
        assert all(re.fullmatch(r"sha256:[0-9a-f]{64}", each) for each in hashes), name


def test_no_torch_and_nothing_that_comes_with_it(lock):
    assert not [name for name in lock if name == "torch" or name.startswith(("nvidia", "triton"))]


def test_no_address_and_no_folder_of_a_machine(text):
    assert not re.findall(r"://|^-|--(?!hash=)|@ | /", text, flags=re.MULTILINE)
