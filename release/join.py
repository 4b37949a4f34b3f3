"""Join datasets of `perceptree synth` into one, without copying their frames.

python -m release.join data/former data/field --out data/both

The new folder holds links to the datasets' folders, and label files with the frames of all of them.
What photographs the frames owe and how far trees are labelled is passed on.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from basetree.files.writing import write_text
from benchmarks.tools.program import command_line
from perceptree.data import SPLITS
from perceptree.data.stated import stated, write_stated

FILES = ("file_name", "depth_file", "depth8_file", "depth_exact_file")


def joined(folders: list[Path], split: str) -> dict[str, Any]:
    """The labels of a split of all datasets, numbered anew."""
    content: dict[str, Any] = {"images": [], "annotations": []}
    for folder in folders:
        labels = json.loads((folder / f"{split}_RGB.json").read_text("utf-8"))
        numbers = {}
        for image in labels["images"]:
            numbers[image["id"]] = len(content["images"])
            names = {key: f"{folder.name}/{image[key]}" for key in FILES if key in image}
            content["images"].append(image | names | {"id": numbers[image["id"]]})
        for tree in labels["annotations"]:
            place = {"id": len(content["annotations"]) + 1, "image_id": numbers[tree["image_id"]]}
            content["annotations"].append(tree | place)
        content["categories"] = labels["categories"]
    return content


def join(folders: list[Path], out: Path) -> None:
    """Write the joined dataset."""
    out.mkdir(parents=True, exist_ok=True)
    for folder in folders:
        link = out / folder.name
        target = os.path.relpath(folder, out)
        if link.is_symlink() and os.readlink(link) != target:  # to another dataset of this name
            link.unlink()
        if not link.is_symlink():
            link.symlink_to(target, target_is_directory=True)
    for split in SPLITS:
        write_text(out / f"{split}_RGB.json", json.dumps(joined(folders, split)))
    write_stated(out, stated(folders))


def main() -> None:
    """Join the datasets."""
    parser = command_line(__doc__)
    parser.add_argument("data", type=Path, nargs="+", help="folders of datasets of other names")
    parser.add_argument("--out", type=Path, required=True, help="folder of the joined dataset")
    options = parser.parse_args()
    if len({folder.name for folder in options.data}) < len(options.data):
        parser.error("two datasets have one name: expected different names")
    join(options.data, options.out)


if __name__ == "__main__":
    main()
