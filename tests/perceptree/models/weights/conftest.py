"""Networks with Detectron2's tensor names, by a mapping independent of the package's."""

import dataclasses
import re
from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from torch import Tensor

from perceptree.models import ModelSpec, TreeRCNN, make_spec

State = dict[str, Tensor]

_HEADS = {
    "proposer.conv": "proposal_generator.rpn_head.conv",
    "proposer.objectness": "proposal_generator.rpn_head.objectness_logits",
    "proposer.shift": "proposal_generator.rpn_head.anchor_deltas",
    "box_head.score": "roi_heads.box_predictor.cls_score",
    "box_head.shift": "roi_heads.box_predictor.bbox_pred",
    "mask_head.tower.up": "roi_heads.mask_head.deconv",
    "mask_head.score": "roi_heads.mask_head.predictor",
    "keypoint_head.tower.up": "roi_heads.keypoint_head.score_lowres",
}
_LISTS = {
    "pyramid.lateral": ("backbone.fpn_lateral", 2),
    "pyramid.output": ("backbone.fpn_output", 2),
    "box_head.hidden": ("roi_heads.box_head.fc", 1),
    "mask_head.tower.convs": ("roi_heads.mask_head.mask_fcn", 1),
    "keypoint_head.tower.convs": ("roi_heads.keypoint_head.conv_fcn", 1),
}


def _theirs(name: str) -> str:
    module, field = name.rsplit(".", 1)
    if module in _HEADS:
        return f"{_HEADS[module]}.{field}"
    trunk = re.fullmatch(r"backbone\.trunk\.(.+)", module)
    if trunk is None:
        group, number = module.rsplit(".", 1)
        begin, first = _LISTS[group]
        return f"{begin}{int(number) + first}.{field}"
    inner = re.sub(r"layer(\d)", lambda found: f"res{int(found[1]) + 1}", trunk[1])
    inner = inner.replace("downsample.0", "shortcut").replace("downsample.1", "shortcut.norm")
    inner = re.sub(r"bn(\d)", r"conv\1.norm", inner)
    stem = "" if inner.startswith("res") else "stem."
    return f"backbone.bottom_up.{stem}{inner}.{field}"


@pytest.fixture(scope="session")
def detectron2_state() -> Callable[[TreeRCNN], State]:
    """A network's weights as Detectron2 stores them."""

    def state(model: TreeRCNN) -> State:
        return {
            _theirs(name): value.clone()
            for name, value in model.state_dict().items()
            if not name.endswith("num_batches_tracked")
        }

    return state


@pytest.fixture(scope="session")
def detectron2_shapes(detectron2_state: Callable[[TreeRCNN], State]) -> Callable[..., State]:
    """A preset's tensors with Detectron2's names, each expanded from a single number."""

    def shapes(preset: str, **changes: object) -> State:
        with torch.device("meta"):
            state = detectron2_state(TreeRCNN(make_spec(preset, **changes)))  # type: ignore[arg-type]
        return {name: torch.zeros(()).expand(value.shape) for name, value in state.items()}

    return shapes


@pytest.fixture(scope="session")
def thin_spec() -> ModelSpec:
    """A ResNet-50 with narrow heads."""
    return dataclasses.replace(
        make_spec("r50"),
        fpn_width=16,
        box_head_width=24,
        mask_head_widths=(8,) * 4,
        keypoint_head_widths=(*(8,) * 7, 12),
    )


@pytest.fixture(scope="session")
def thin_state(
    thin_spec: ModelSpec, detectron2_state: Callable[[TreeRCNN], State]
) -> Callable[[], State]:
    """Random weights of the narrow network; a new dictionary of the same tensors per call."""
    torch.manual_seed(5)
    model = TreeRCNN(thin_spec)
    for name, value in model.state_dict().items():
        if name.endswith(("running_mean", "bias")):
            value.normal_(std=0.1)
    state = detectron2_state(model)
    return lambda: dict(state)


@pytest.fixture
def write(tmp_path: Path) -> Callable[[object], Path]:
    """Write content to a file by torch."""

    def written(content: object) -> Path:
        path = tmp_path / "their model.pth"
        torch.save(content, path)
        return path

    return written
