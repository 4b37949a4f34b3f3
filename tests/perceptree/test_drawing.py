"""Drawing of labels and pages."""

from typing import Any

import numpy as np
import pytest

from perceptree.drawing import BOX, KEYPOINT_COLOURS, OUTLINE, draw_trees, grid, with_caption


def _tree() -> dict[str, Any]:
    mask = np.zeros((1, 90, 160), np.uint8)
    mask[0, 20:80, 60:80] = 1
    points = np.zeros((1, 5, 3))
    points[0, 0] = 70, 75, 2
    points[0, 1] = 60, 70, 1
    return {"boxes": np.array([[55.0, 15.0, 85.0, 85.0]]), "masks": mask, "keypoints": points}


@pytest.mark.parametrize("shape", [(90, 160), (90, 160, 3)])
@pytest.mark.parametrize("scale", [1, 3])
def test_labels_are_drawn_on_a_copy(shape: tuple[int, ...], scale: int) -> None:
    image = np.full(shape, 7, np.uint8)
    drawn = draw_trees(image, **_tree(), width_px=160 * scale)
    assert drawn.shape == (90 * scale, 160 * scale, 3)
    assert (image == 7).all()
    assert tuple(drawn[15 * scale, 57 * scale]) == BOX
    assert tuple(drawn[85 * scale - 1, 85 * scale - 1]) == BOX
    assert tuple(drawn[50 * scale, 80 * scale - 1]) == OUTLINE
    assert tuple(drawn[75 * scale, 70 * scale]) == KEYPOINT_COLOURS[0]
    # A hidden keypoint is a ring; an unlabelled one is not drawn.
    assert tuple(drawn[70 * scale, 60 * scale]) != KEYPOINT_COLOURS[1]
    assert (drawn == KEYPOINT_COLOURS[1]).all(-1).any()
    assert (drawn[:10] == 7).all()


def test_one_colour_for_box_and_outline() -> None:
    drawn = draw_trees(np.zeros((90, 160), np.uint8), **_tree(), colour=(1, 2, 3))
    assert tuple(drawn[15, 57]) == (1, 2, 3)
    assert tuple(drawn[50, 79]) == (1, 2, 3)


def test_a_page_shows_every_cell_and_shortens_long_captions() -> None:
    cells = [np.full((20 + 5 * n, 50, 3), 100 + n, np.uint8) for n in range(5)]
    page = grid(cells, 3)
    assert [int((page == 100 + n).all(-1).sum()) for n in range(5)] == [
        50 * (20 + 5 * n) for n in range(5)
    ]
    short, long = (with_caption(cells[0], "x" * n) for n in (1, 500))
    assert short.shape == long.shape == (44, 50, 3)
