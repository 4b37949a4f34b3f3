"""Add to model files how the pictures that they were trained on look.

python -m release.training_pictures MODEL.onnx DATA [DATA ...]

DATA are datasets whose train splits the model was trained on, or parts of them. `perceptree train`
does the same for new checkpoints, and `edgetree export` takes it from there; this is for files of
older checkpoints. Only the manifest changes: the graph keeps its bytes. A card beside the file gets
the new hash and size.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

from benchmarks.tools.program import command_line
from calib import DepthEncoding, picture_statistics, usual_ranges
from edgetree.evaluate import frames_for
from edgetree.model_file.manifest import Manifest, UsualRange
from perceptree.data import read_dataset
from release.manifest_change import write_manifest


def usual_of(manifest: Manifest, folders: list[Path]) -> tuple[UsualRange, ...]:
    """The usual ranges of the statistics of the frames of the train splits."""
    values = manifest.depth_encoding
    encoding = None if values is None else DepthEncoding.from_dict(dict(values))
    found = []
    for folder in folders:
        store = frames_for(manifest, read_dataset(folder, "train").frames)
        for index in range(len(store)):
            box = store.letterbox(index)
            inner = store.image(index)[: box.resized_height, : box.resized_width]
            found.append(picture_statistics(inner, encoding))
    sys.stderr.write(f"{len(found)} frames\n")
    ranges = usual_ranges(found)
    return tuple(UsualRange(name, *ranges[name]) for name in sorted(ranges))


def main() -> None:
    """Add the ranges to a file."""
    parser = command_line(__doc__)
    parser.add_argument("model", type=Path)
    parser.add_argument("data", type=Path, nargs="+")
    options = parser.parse_args()
    write_manifest(
        options.model,
        lambda manifest: replace(manifest, training_pictures=usual_of(manifest, options.data)),
    )


if __name__ == "__main__":
    main()
