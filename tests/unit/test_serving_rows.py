"""Which numbers of rows are taken to agree, on libraries that do and that do not."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
import pytest

from services.policy.learning.config import LegatoConfig, NetworkConfig
from services.policy.learning.onnx_signature import input_shapes, output_shapes
from services.policy.serving.row_counts import find_row_counts
from tests.checkpoints import SMALL

CONFIG: NetworkConfig = LegatoConfig.model_validate(SMALL)


class Library:
    """Gives each row what follows from it alone, but for some numbers of rows.

    Args:
        differs: Numbers of rows for which one output's last bits are others.
        by_place: The first row's last bits are others, too.
    """

    def __init__(self, differs: Collection[int] = (), *, by_place: bool = False) -> None:
        self.differs, self.by_place = differs, by_place
        self.images: list[int] = []

    def run(self, names, fed):
        assert set(fed) == set(input_shapes(CONFIG))
        rows = len(fed["rows"])
        self.images.append(len(fed["images"]))
        seen = fed["history"].sum((1, 2)) + (fed["h"] + fed["c"]).sum((0, 2))
        if rows in self.differs:
            seen = np.nextafter(seen, np.float32(9.0))
        if self.by_place:
            seen[0] = np.nextafter(seen[0], np.float32(9.0))
        return [spread(seen, output_shapes(CONFIG)[name]) for name in names]


def spread(seen, shape):
    """A value per row, repeated along every other axis."""
    lengths = [len(seen) if each == "rows" else each for each in shape]
    free = [len(seen) if each == "rows" else 1 for each in shape]
    return np.ascontiguousarray(np.broadcast_to(seen.reshape(free), lengths))


@pytest.mark.parametrize("differs", [(), (1,), (3, 6), range(1, 8)])
def test_only_numbers_that_give_the_same_bits_are_taken(differs):
    found = find_row_counts(Library(differs), CONFIG, most=8)  # type: ignore[arg-type]
    assert found == tuple(rows for rows in range(1, 9) if rows not in differs)


def test_rows_that_depend_on_their_place_are_not_taken():
    library = Library(by_place=True)
    assert find_row_counts(library, CONFIG, most=8) == (8,)  # type: ignore[arg-type]


def test_the_images_are_not_what_is_tried_out():
    """Encoding costs most and works image by image."""
    library = Library()
    find_row_counts(library, CONFIG, most=8)  # type: ignore[arg-type]
    assert library.images == [1] * 8
