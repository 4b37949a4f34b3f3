"""Tensor names of Detectron2's Mask R-CNN with FPN, and the corresponding names here."""

from __future__ import annotations

_TRUNK, _THEIR_TRUNK = "backbone.trunk", "backbone.bottom_up"
_MOST_BLOCKS, _MOST_CONVOLUTIONS = 64, 64


def _modules() -> dict[str, str]:
    """Detectron2's names of modules with tensors -> ours."""
    pairs = {
        f"{_THEIR_TRUNK}.stem.conv1": f"{_TRUNK}.conv1",
        f"{_THEIR_TRUNK}.stem.conv1.norm": f"{_TRUNK}.bn1",
        "proposal_generator.rpn_head.conv": "proposer.conv",
        "proposal_generator.rpn_head.objectness_logits": "proposer.objectness",
        "proposal_generator.rpn_head.anchor_deltas": "proposer.shift",
        "roi_heads.box_head.fc1": "box_head.hidden.0",
        "roi_heads.box_head.fc2": "box_head.hidden.1",
        "roi_heads.box_predictor.cls_score": "box_head.score",
        "roi_heads.box_predictor.bbox_pred": "box_head.shift",
        "roi_heads.mask_head.deconv": "mask_head.tower.up",
        "roi_heads.mask_head.predictor": "mask_head.score",
        "roi_heads.keypoint_head.score_lowres": "keypoint_head.tower.up",
    }
    for stage in range(2, 6):
        pairs |= {f"backbone.fpn_lateral{stage}": f"pyramid.lateral.{stage - 2}"}
        pairs |= {f"backbone.fpn_output{stage}": f"pyramid.output.{stage - 2}"}
        for block in range(_MOST_BLOCKS):
            theirs = f"{_THEIR_TRUNK}.res{stage}.{block}"
            ours = f"{_TRUNK}.layer{stage - 1}.{block}"
            pairs |= {f"{theirs}.conv{n}": f"{ours}.conv{n}" for n in (1, 2, 3)}
            pairs |= {f"{theirs}.conv{n}.norm": f"{ours}.bn{n}" for n in (1, 2, 3)}
            pairs |= {f"{theirs}.shortcut": f"{ours}.downsample.0"}
            pairs |= {f"{theirs}.shortcut.norm": f"{ours}.downsample.1"}
    for n in range(_MOST_CONVOLUTIONS):
        pairs |= {f"roi_heads.mask_head.mask_fcn{n + 1}": f"mask_head.tower.convs.{n}"}
        pairs |= {f"roi_heads.keypoint_head.conv_fcn{n + 1}": f"keypoint_head.tower.convs.{n}"}
    return pairs


_OURS = _modules()
_THEIRS = {ours: theirs for theirs, ours in _OURS.items()}


def our_name(name: str) -> str:
    """Translate a Detectron2 tensor name to ours; unknown names are returned unchanged."""
    return _renamed(name, _OURS)


def their_name(name: str) -> str:
    """Translate a tensor name to Detectron2's; unknown names are returned unchanged."""
    return _renamed(name, _THEIRS)


def _renamed(name: str, modules: dict[str, str]) -> str:
    module, dot, field = name.rpartition(".")
    return modules.get(module, module) + dot + field
