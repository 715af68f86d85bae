"""The shards of a folder, as far as their headers tell."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path

from client.sharding.errors import ShardsDiffer, ShardsOverlap
from client.sharding.header import ShardHeader
from client.sharding.record import read_header
from client.sharding.shard import FILES, Shard


def read_headers(folder: Path) -> dict[Path, ShardHeader]:
    """The headers of all files with shards; one that has just been made has none yet.

    Raises:
        BadShard: A file does not begin as one of this version does.
    """
    found = {path: read_header(path) for path in sorted(folder.glob(FILES))}
    return {path: header for path, header in found.items() if header is not None}


def check_alike(headers: Mapping[Path, ShardHeader], name: str, expected: ShardHeader) -> None:
    """See that shards belong to one evaluation.

    Args:
        headers: Of their files.
        name: What has the other header.
        expected: What they are compared with.

    Raises:
        ShardsDiffer: One of them does not.
    """
    for path, header in headers.items():
        if header.count != expected.count:
            found = (str(path), str(header.count))
            raise ShardsDiffer("number of shards", found, (name, str(expected.count)))
        difference = header.origin.first_difference(expected.origin)
        if difference is not None:
            what, here, there = difference
            raise ShardsDiffer(what, (str(path), here), (name, there))


def check_apart(headers: Mapping[Path, ShardHeader]) -> None:
    """See that no two files hold one shard.

    Raises:
        ShardsOverlap: Two do.
    """
    paths: defaultdict[Shard, list[str]] = defaultdict(list)
    for path, header in headers.items():
        paths[header.shard].append(str(path))
    for shard, same in paths.items():
        if len(same) > 1:
            raise ShardsOverlap(str(shard), same)
