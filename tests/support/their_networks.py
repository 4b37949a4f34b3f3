"""Tensors as Detectron2 stores them, and what the recognition says of them."""

from pathlib import Path

import pytest
import torch
from torch import Tensor

from perceptree.errors import CheckpointError
from perceptree.models.weights.recognition import ImportOptions, RecognisedNetwork, recognise

State = dict[str, Tensor]

FILE = Path("their.pth")
CELLS = "proposal_generator.anchor_generator.cell_anchors"
SCORE, SHIFT = "roi_heads.box_predictor.cls_score", "roi_heads.box_predictor.bbox_pred"
HEAT = "roi_heads.keypoint_head.score_lowres"


def numbers(*shape: int) -> Tensor:
    return torch.zeros(()).expand(shape)


def recognised(state: State, **wanted: object) -> RecognisedNetwork:
    return recognise(FILE, state, ImportOptions(**wanted))  # type: ignore[arg-type]


def refused(state: State, **wanted: object) -> str:
    with pytest.raises(CheckpointError) as caught:
        recognised(state, **wanted)
    text = str(caught.value)
    assert text.startswith(f"{FILE}: ")
    assert "\n" not in text
    return text


def persons(state: State) -> State:
    """The same network for COCO's persons: 17 keypoints and other last layers."""
    channels = state[f"{HEAT}.weight"].shape[0]
    width = state[f"{SCORE}.weight"].shape[1]
    return state | {
        f"{SCORE}.weight": torch.ones(81, width),
        f"{SCORE}.bias": torch.ones(81),
        f"{SHIFT}.weight": torch.ones(320, width),
        f"{SHIFT}.bias": torch.ones(320),
        f"{HEAT}.weight": torch.ones(channels, 17, 4, 4),
        f"{HEAT}.bias": torch.ones(17),
    }
