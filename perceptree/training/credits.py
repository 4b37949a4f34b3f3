"""What a network owes to others: pretrained weights and photographs, with their licences.

A training passes on the credits of the checkpoints that it started from.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from perceptree.data.stated import folder_credits
from perceptree.models import load_checkpoint
from perceptree.training.starting import Init, describe_init

Credits = dict[str, list[dict[str, Any]]]
"""`pretrained` (weights, sha256, licence) and `photographs` (kind, source, licence, names)."""


def training_credits(
    init: Init | None, backbone: str, checkpoints: Iterable[Path], folders: Sequence[Path]
) -> Credits:
    """The credits of a training, without those that are empty.

    Args:
        init: Starting weights.
        backbone: The model's backbone, which decides what `imagenet` stands for.
        checkpoints: Checkpoints that weights come from.
        folders: Folders of the datasets.

    Raises:
        CheckpointError: If a checkpoint cannot be read.
        DatasetError: If a dataset's settings cannot be read.
    """
    parts: list[Credits] = []
    if init in ("imagenet", "coco"):
        known = describe_init(init, backbone)
        parts.append({"pretrained": [{"weights": known["name"]} | known]})
    parts += [load_checkpoint(path)[1]["training"] for path in checkpoints]
    parts.append({"photographs": folder_credits(folders)})
    return joined_credits(parts)


def joined_credits(records: Iterable[dict[str, Any]]) -> Credits:
    """The credits of several training records, each once, without those that are empty."""
    found: Credits = {"pretrained": [], "photographs": []}
    for record in records:
        for name, known in found.items():
            given = record.get(name)
            credited = given if isinstance(given, list) else []
            known += [each for each in credited if isinstance(each, dict) and each not in known]
    return {name: known for name, known in found.items() if known}
