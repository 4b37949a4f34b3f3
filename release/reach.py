"""Add how far trees are labelled to a model file of a checkpoint that does not tell it.

python -m release.reach MODEL.onnx paper-924

The runtime leaves out trees beyond it, where depth and camera tell their distance. DATA is a
dataset of `perceptree synth` with the labels of the training; its `settings.json` states the reach.
Only the manifest changes: the graph keeps its bytes.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import replace
from pathlib import Path

from release.manifest_change import write_manifest


def reach_m(data: Path) -> float:
    """The largest distance of a labelled tree in a simulated dataset, m."""
    settings = json.loads((data / "settings.json").read_text("utf-8"))
    return float(settings["settings"]["labels"]["reach_m"])


def main() -> None:
    """Write the reach into the file."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("model", type=Path)
    parser.add_argument("data", type=Path)
    options = parser.parse_args()
    reach = reach_m(options.data)
    write_manifest(options.model, lambda manifest: replace(manifest, reach_m=reach))
    sys.stdout.write(f"{options.model}: labels end at {reach:g} m\n")


if __name__ == "__main__":
    main()
