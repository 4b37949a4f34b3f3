"""Anchors of imported Detectron2 checkpoints: assumed, stated, and in the file."""

import math
from collections.abc import Callable

import pytest
import torch
from their_networks import CELLS, numbers, recognised, refused
from torch import Tensor

from perceptree.models.presets import NINE_ANCHORS_PX

State = dict[str, Tensor]
Shapes = Callable[..., State]


def test_nine_anchors_are_known_by_their_number(detectron2_shapes: Shapes) -> None:
    state = detectron2_shapes("r50", anchor_sizes_px=NINE_ANCHORS_PX)
    assert recognised(state).spec.anchor_sizes_px == NINE_ANCHORS_PX
    state["proposal_generator.rpn_head.objectness_logits.weight"] = numbers(4, 256, 1, 1)
    assert "4 anchors per cell, expected 3 or 9" in refused(state)


SIZES_PX = ((32.0,), (64.0,), (128.0,), (256.0,), (512.0,))


def test_assumed_anchors_are_told_with_the_reason(detectron2_shapes: Shapes) -> None:
    sizes, ratios = recognised(detectron2_shapes("r50")).assumed[-2:]
    assert sizes == "anchor sizes 32,64,128,256,512 px (Detectron2's for 3 per cell)"
    assert ratios == "anchor ratios 0.5,1,2 (Detectron2's)"
    nine = recognised(detectron2_shapes("r50", anchor_sizes_px=NINE_ANCHORS_PX)).assumed
    assert any("(of the paper for 9 per cell)" in text for text in nine)


def test_stated_anchors_are_used_and_are_not_assumed(detectron2_shapes: Shapes) -> None:
    state, mine = detectron2_shapes("r50"), tuple((n / 2,) for (n,) in SIZES_PX)
    found = recognised(state, anchor_sizes_px=mine, anchor_ratios=(1.0, 2.0, 4.0))
    assert found.spec.anchor_sizes_px == mine
    assert found.spec.anchor_ratios == (1.0, 2.0, 4.0)
    assert "anchor" not in " ".join(found.assumed)
    found = recognised(state, anchor_ratios=(1.0,), anchor_sizes_px=NINE_ANCHORS_PX)
    assert found.spec.anchor_sizes_px == NINE_ANCHORS_PX
    found = recognised(state, anchor_ratios=(1.0, 2.0, 4.0))
    assert found.spec.anchor_sizes_px == SIZES_PX
    assert "anchor ratios" not in " ".join(found.assumed)


@pytest.mark.parametrize(
    ("wanted", "message"),
    [
        ({"anchor_sizes_px": NINE_ANCHORS_PX}, "has 3 anchors per cell, but sizes 32/64/128,"),
        ({"anchor_sizes_px": SIZES_PX[:4]}, "expected 5 levels of 3 anchors"),
        ({"anchor_ratios": (0.5, 1.0)}, "has 3 anchors per cell, expected 2 or 6, or --anchor-"),
    ],
)
def test_stated_anchors_of_another_number_are_refused(
    wanted: dict[str, object], message: str, detectron2_shapes: Shapes
) -> None:
    assert message in refused(detectron2_shapes("r50"), **wanted)


def test_stated_anchors_that_contradict_the_file_are_refused(detectron2_shapes: Shapes) -> None:
    boxes = {f"{CELLS}.{n}": cell_anchors(px, (0.5, 1.0, 2.0)) for n, px in enumerate(SIZES_PX)}
    state = detectron2_shapes("r50") | boxes
    agreed = recognised(state, anchor_sizes_px=SIZES_PX, anchor_ratios=(0.5, 1.0, 2.0))
    assert agreed.spec.anchor_sizes_px == SIZES_PX
    text = refused(state, anchor_ratios=(1.0, 2.0, 4.0))
    assert "* has 0.5,1,2, but --anchor-ratios is 1,2,4, expected the same" in text
    text = refused(state, anchor_sizes_px=((30.0,), *SIZES_PX[1:]))
    assert "but --anchor-sizes is 30,64,128,256,512, expected the same" in text


def cell_anchors(sizes_px: tuple[float, ...], ratios: tuple[float, ...]) -> Tensor:
    """Anchor boxes centred at 0 as Detectron2 makes them."""
    boxes = []
    for size in sizes_px:
        for ratio in ratios:
            w = math.sqrt(size**2 / ratio)
            boxes.append([-w / 2, -ratio * w / 2, w / 2, ratio * w / 2])
    return torch.tensor(boxes)


@pytest.mark.parametrize("ratios", [(0.5, 1.0, 2.0), (1 / 3, 1.0, 4.5), (2.0,)])
@pytest.mark.parametrize("scales", [(1.0,), (1.0, 2 ** (1 / 3), 2 ** (2 / 3)), (1.0, 0.5)])
def test_anchors_in_the_file_count(
    ratios: tuple[float, ...], scales: tuple[float, ...], detectron2_shapes: Shapes
) -> None:
    sizes = tuple(tuple(32.0 * 2**n * scale for scale in scales) for n in range(5))
    state = detectron2_shapes("r50", anchor_sizes_px=sizes, anchor_ratios=ratios)
    for n, level in enumerate(sizes):
        state[f"{CELLS}.{n}"] = cell_anchors(level, ratios)
    spec = recognised(state).spec
    assert spec.anchor_ratios == pytest.approx(ratios, rel=1e-5)
    for found, wanted in zip(spec.anchor_sizes_px, sizes, strict=True):
        assert found == pytest.approx(wanted, rel=1e-5)


def test_anchors_that_are_no_grid_are_refused(detectron2_shapes: Shapes) -> None:
    boxes = cell_anchors((32.0,), (0.5, 1.0, 2.0))

    def with_cells(*levels: Tensor) -> State:
        return detectron2_shapes("r50") | {f"{CELLS}.{n}": v for n, v in enumerate(levels)}

    assert recognised(with_cells(*[boxes] * 5)).spec.anchor_ratios == (0.5, 1.0, 2.0)
    for wrong in (
        [boxes] * 4,
        [*[boxes] * 4, boxes + 1.0],
        [*[boxes] * 4, boxes.flip(0)],
        [*[boxes] * 4, boxes[:2]],
        [boxes[:, :3]] * 5,
        [boxes * 0.0] * 5,
        [cell_anchors((32.0, 64.0), (0.5, 1.0, 2.0))] * 5,
    ):
        assert "cell_anchors.*, expected 3 boxes" in refused(with_cells(*wrong))
