"""The first successful episodes of a data set as a data set of their own."""

from __future__ import annotations

from pathlib import Path

from common.datasets import EpisodeMetadata, EpisodeRows, EpisodeStore, EpisodeWriter


def copy_episodes(store: EpisodeStore, folder: Path, count: int) -> EpisodeStore:
    """Copy the first successful episodes.

    Args:
        store: To copy from.
        folder: To make.
        count: How many; all if there are fewer.
    """
    names = [column.name for column in store.spec.columns]
    with EpisodeWriter.open(folder, store.spec) as writer:
        good = [episode for episode in store if episode.info.outcome == "success"]
        for episode in good[:count]:
            known = episode.info.model_dump(include=set(EpisodeMetadata.model_fields))
            rows = EpisodeRows({name: episode[name] for name in names})
            writer.append(rows, EpisodeMetadata.model_validate(known))
    return EpisodeStore.open(folder)
