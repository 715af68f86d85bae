"""Files of API keys: what is in them, who may change them, `legato keys`."""

from __future__ import annotations

import hmac
import json
import stat
import threading
from itertools import pairwise
from typing import get_args, get_type_hints

import pytest

from client import main as cli
from client.commands import KeysCreate
from client.credentials import find_api_key
from common.errors import BadKeyFile, InvalidValue, UnknownName
from common.exposure import is_loopback
from common.keys import Role, create_key, hash_key, read_keys, revoke_key


@pytest.fixture
def path(tmp_path):
    return tmp_path / "keys.json"


def test_a_file_has_hashes_and_no_key(path):
    keys = [create_key(path, name=name, role=Role.OPERATE) for name in ("ann", "bob")]
    text = path.read_text()
    assert len(set(keys)) == 2
    for key in keys:
        # 32 bytes are 43 characters of base64.
        assert len(key) == len("legato_") + 43
        assert key not in text
        assert key.removeprefix("legato_") not in text
        assert hash_key(key) in text
    assert [key.name for key in read_keys(path).keys] == ["ann", "bob"]


def test_only_the_whole_key_is_found(path):
    key = create_key(path, name="ann", role=Role.VIEW)
    file = read_keys(path)
    found = file.find(key)
    assert found is not None
    assert (found.name, found.role) == ("ann", Role.VIEW)
    for wrong in ("", key[:-1], key + "x", key.upper(), found.sha256, "ann"):
        assert file.find(wrong) is None


def test_every_hash_is_compared_whichever_fits(path, monkeypatch):
    keys = [create_key(path, name=name, role=Role.VIEW) for name in ("a", "b", "c")]
    compared = []
    real = hmac.compare_digest
    monkeypatch.setattr(
        "common.keys.hmac.compare_digest", lambda a, b: compared.append(a) or real(a, b)
    )
    file = read_keys(path)
    for key in (*keys, "none"):
        compared.clear()
        file.find(key)
        assert len(compared) == 3


def test_a_role_includes_those_below_it():
    assert list(Role) == ["view", "operate", "admin"]
    for lower, higher in pairwise(Role):
        assert higher.includes(lower)
        assert higher.includes(higher)
        assert not lower.includes(higher)


def test_a_revoked_key_is_gone_and_the_others_stay(path):
    key = create_key(path, name="ann", role=Role.ADMIN)
    create_key(path, name="bob", role=Role.VIEW)
    revoke_key(path, name="ann")
    assert read_keys(path).find(key) is None
    assert [each.name for each in read_keys(path).keys] == ["bob"]
    with pytest.raises(UnknownName, match="ann"):
        revoke_key(path, name="ann")


def test_a_name_is_given_once(path):
    create_key(path, name="ann", role=Role.VIEW)
    before = path.read_bytes()
    with pytest.raises(InvalidValue, match="ann"):
        create_key(path, name="ann", role=Role.ADMIN)
    assert path.read_bytes() == before


def test_keys_that_are_made_at_once_are_all_kept(path):
    names = [f"k{number}" for number in range(20)]
    threads = [
        threading.Thread(target=create_key, args=(path,), kwargs={"name": name, "role": Role.VIEW})
        for name in names
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert {key.name for key in read_keys(path).keys} == set(names)
    assert [each.name for each in path.parent.iterdir()] == [path.name]


def test_permissions_of_a_file_are_kept(path):
    create_key(path, name="ann", role=Role.VIEW)
    path.chmod(0o640)
    create_key(path, name="bob", role=Role.VIEW)
    assert stat.S_IMODE(path.stat().st_mode) == 0o640


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        '{"version": 2, "keys": []}',
        '{"keys": [{"name": "a", "role": "boss", "sha256": "00", "created": "2026-01-01"}]}',
        '{"keys": [], "more": 1}',
    ],
)
def test_a_file_that_is_none_of_keys_is_refused_and_left_alone(path, text):
    path.write_text(text)
    with pytest.raises(BadKeyFile, match=r"keys\.json"):
        read_keys(path)
    with pytest.raises(BadKeyFile):
        create_key(path, name="ann", role=Role.VIEW)
    assert path.read_text() == text


def test_two_keys_of_one_name_are_refused(path):
    create_key(path, name="ann", role=Role.VIEW)
    said = json.loads(path.read_text())
    path.write_text(json.dumps(said | {"keys": said["keys"] * 2}))
    with pytest.raises(BadKeyFile, match="two keys have one name"):
        read_keys(path)


def test_a_folder_that_is_not_there(tmp_path):
    with pytest.raises(BadKeyFile, match="No such file"):
        create_key(tmp_path / "none" / "keys.json", name="ann", role=Role.VIEW)
    with pytest.raises(BadKeyFile, match="No such file"):
        revoke_key(tmp_path / "keys.json", name="ann")
    assert not (tmp_path / "keys.json").exists()


def test_the_command_line_prints_a_key_once(path, capsys):
    file = f"--file={path}"
    assert cli.run(["keys", "create", "--name=ann", "--role=operate", file]) == 0
    shown = capsys.readouterr()
    found = read_keys(path).find(shown.out.strip())
    assert found is not None
    assert (found.name, found.role) == ("ann", Role.OPERATE)
    assert "shown once" in shown.err
    assert cli.run(["keys", "list", file]) == 0
    assert capsys.readouterr().out.splitlines()[2].split()[:2] == ["ann", "operate"]
    assert cli.run(["keys", "list", "--json", file]) == 0
    (listed,) = json.loads(capsys.readouterr().out)["keys"]
    assert listed.keys() == {"name", "role", "created"}
    assert cli.run(["keys", "revoke", "--name=ann", file]) == 0
    assert read_keys(path).keys == ()


def test_a_name_that_cannot_be_one_is_wrong_use(path, capsys):
    assert cli.run(["keys", "create", "--name=a b", "--role=view", f"--file={path}"]) == 2
    assert capsys.readouterr().err.startswith("E-INVALID-VALUE  --name is 'a b'")
    assert not path.exists()


def test_the_command_line_has_every_role():
    roles = get_args(get_type_hints(KeysCreate)["role"])
    assert roles == tuple(Role)


def test_the_key_of_the_environment(tmp_path):
    file = tmp_path / "key"
    file.write_text("legato_x\n")
    assert find_api_key({}) is None
    assert find_api_key({"LEGATO_API_KEY": "", "LEGATO_API_KEY_FILE": ""}) is None
    assert find_api_key({"LEGATO_API_KEY": "legato_y"}) == "legato_y"
    assert find_api_key({"LEGATO_API_KEY_FILE": str(file)}) == "legato_x"


@pytest.mark.parametrize(
    ("environment", "said"),
    [
        ({"LEGATO_API_KEY": "a", "LEGATO_API_KEY_FILE": "b"}, "one of them"),
        ({"LEGATO_API_KEY_FILE": "/none/key"}, "No such file"),
        ({"LEGATO_API_KEY_FILE": "/dev/null"}, "a key, as"),
        ({"LEGATO_API_KEY": "two words"}, "a key, as"),
        ({"LEGATO_API_KEY": "clé"}, "a key, as"),
        ({"LEGATO_API_KEY": "a\r\nX-Other: b"}, "a key, as"),
    ],
)
def test_a_key_of_the_environment_that_cannot_be_one(environment, said):
    with pytest.raises(InvalidValue, match=said) as caught:
        find_api_key(environment)
    assert "words" not in str(caught.value)


@pytest.mark.parametrize(
    ("host", "local"),
    [
        ("127.0.0.1", True),
        ("127.8.0.1", True),
        ("::1", True),
        ("[::1]", True),
        ("localhost", True),
        ("0.0.0.0", False),
        ("::", False),
        ("", False),
        ("10.0.0.5", False),
        ("robot.lab", False),
        ("localhost.evil.example", False),
    ],
)
def test_which_addresses_only_this_machine_reaches(host, local):
    assert is_loopback(host) == local
