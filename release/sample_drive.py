"""Copy a simulated drive into the package, without what `edgetree live` does not read.

perceptree synth --preset drive --frames 24 --width 640 --height 360 --seed 7 --out drive
python -m release.sample_drive drive edgetree/assets/drive
"""

from __future__ import annotations

import json
import shutil
from pathlib import Path

from benchmarks.tools.program import command_line

LABELS = "test_RGB.json"
FRAMES = 20
LEFT_OUT = ("depth8_file", "depth_exact_file", "depth_exact_stride_px", "realism")


def main() -> None:
    """Copy colour, depth, motion and labels."""
    parser = command_line(__doc__)
    parser.add_argument("drive", type=Path)
    parser.add_argument("out", type=Path)
    arguments = parser.parse_args()
    labels = json.loads((arguments.drive / LABELS).read_text())
    shutil.copytree(arguments.drive / "imu", arguments.out / "imu")
    labels["images"] = sorted(labels["images"], key=lambda image: image["time_s"])[:FRAMES]
    kept = {image["id"] for image in labels["images"]}
    labels["annotations"] = [tree for tree in labels["annotations"] if tree["image_id"] in kept]
    for image in labels["images"]:
        for name in (image["file_name"], image["depth_file"]):
            (arguments.out / name).parent.mkdir(exist_ok=True)
            shutil.copyfile(arguments.drive / name, arguments.out / name)
        for field in LEFT_OUT:
            image.pop(field, None)
    for tree in labels["annotations"]:
        tree.pop("segmentation", None)
    (arguments.out / LABELS).write_text(json.dumps(labels))


if __name__ == "__main__":
    main()
