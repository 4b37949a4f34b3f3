"""Change the manifest of a model file, and keep the card beside it right."""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Callable
from pathlib import Path

import onnx

from basetree.files.writing import write_text, write_whole
from edgetree.catalogue import KnownModel
from edgetree.export.build import with_manifest
from edgetree.model_file.manifest import Manifest
from edgetree.model_file.safety_check import check_content
from release.card_page import page


def write_manifest(path: Path, change: Callable[[Manifest], Manifest]) -> None:
    """Write a changed manifest into a model file, and the file's new hash into its card.

    The graph keeps its bytes. A card of an earlier file stays as it is.
    """
    model, before = KnownModel(path.stem, path), path.read_bytes()
    card_path = path.with_suffix(".json")
    card = json.loads(card_path.read_text("utf-8")) if card_path.is_file() else {}
    proto = onnx.load_model_from_string(before)
    graph = proto.graph.SerializeToString()
    after = with_manifest(proto, change(model.manifest()))
    if graph not in before or graph not in after:
        sys.exit(f"{path} is not as this project writes it: expected its graph to keep its bytes")
    check_content(after, path)
    write_whole(path, after)
    if card.get("model_sha256") == hashlib.sha256(before).hexdigest():
        card |= {"model_sha256": hashlib.sha256(after).hexdigest(), "file_bytes": len(after)}
        write_text(card_path, json.dumps(card, indent=1) + "\n")
        write_text(path.with_suffix(".md"), page(card))
