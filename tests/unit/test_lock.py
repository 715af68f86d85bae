"""The locks are what `make lock` would write: complete, hashed, as was tested; images use them."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from tests.locked import read_entries, version_of

ROOT = Path(__file__).parents[2]
ADVICE = "run: make lock"
LOCKS = ("requirements.lock", "requirements-build.lock")


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


def read_lock(name: str) -> dict[str, tuple[Requirement, list[str]]]:
    return read_entries((ROOT / name).read_text())


@pytest.fixture(scope="module")
def lock():
    return read_lock("requirements.lock")


def test_it_satisfies_the_project(lock):
    for requirement in wanted("all"):
        name = canonicalize_name(requirement.name)
        assert name in lock, f"{requirement} is not locked; {ADVICE}"
        version = version_of(lock[name][0])
        assert requirement.specifier.contains(version), f"{requirement}, {version}; {ADVICE}"


def test_versions_are_those_that_were_tested(lock):
    tested = read_lock("constraints.txt")
    assert len(lock.keys() & tested.keys()) > 30
    for name in lock.keys() & tested.keys():
        assert version_of(lock[name][0]) == version_of(tested[name][0]), f"{name}; {ADVICE}"


def test_everything_that_this_platform_installs_was_tested(lock):
    tested = read_lock("constraints.txt")
    here = {
        name for name, (each, _) in lock.items() if each.marker is None or each.marker.evaluate()
    }
    assert here - tested.keys() == set(), "add them to constraints.txt"


def test_the_images_are_built_with_what_the_project_asks_for():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    found = read_lock("requirements-build.lock")
    group = [Requirement(line) for line in project["dependency-groups"]["image"]]
    assert found.keys() == {requirement.name for requirement in group}
    for requirement in [*group, *map(Requirement, project["build-system"]["requires"])]:
        version = version_of(found[requirement.name][0])
        assert requirement.specifier.contains(version), f"{requirement}, {version}; {ADVICE}"


@pytest.mark.parametrize("name", LOCKS)
def test_every_package_has_hashes(name):
    for package, (_, hashes) in read_lock(name).items():
        assert hashes, package
        assert all(re.fullmatch(r"sha256:[0-9a-f]{64}", each) for each in hashes), package


def test_no_torch_and_nothing_that_comes_with_it(lock):
    assert not [name for name in lock if name == "torch" or name.startswith(("nvidia", "triton"))]


@pytest.mark.parametrize("name", LOCKS)
def test_no_address_and_no_folder_of_a_machine(name):
    text = (ROOT / name).read_text()
    assert not re.findall(r"://|^-|--(?!hash=)|@ | /", text, flags=re.MULTILINE)


def test_only_the_image_with_torch_installs_without_hashes():
    commands = (ROOT / "Dockerfile").read_text().replace("\\\n", " ").splitlines()
    installing = [line for line in commands if re.search(r"run-pip .*\binstall ", line)]
    assert len(installing) == 4
    (free,) = (line for line in installing if not re.search("--require-hashes|--no-deps", line))
    assert "[torch]" in free
