"""Make a frozen test set, and write its expected values into the package.

python -m release.freeze_test_set PRESET --out test_set

The dataset is kept in the folder, and an interrupted run can be resumed. Run this only after a
change that is meant to change the test set: accuracies measured before and after cannot be
compared.
"""

from __future__ import annotations

import sys
from pathlib import Path

from basetree.files.writing import write_text
from benchmarks.tools.program import command_line
from perceptree.simulator.dataset.frozen import FROZEN_PRESETS, describe_dataset, frozen_file
from perceptree.simulator.dataset.generate import generate_dataset
from perceptree.simulator.settings import presets


def main() -> None:
    """Generate or resume the dataset, then write its expected values."""
    parser = command_line(__doc__)
    parser.add_argument("preset", choices=FROZEN_PRESETS)
    parser.add_argument("--out", type=Path, required=True, help="folder of the dataset")
    parser.add_argument("--workers", type=int, default=None)
    arguments = parser.parse_args()
    preset = presets.PRESETS[arguments.preset]

    def progress(done: int, total: int) -> None:
        sys.stderr.write(f"\r{done} of {total} frames")

    generate_dataset(
        arguments.out,
        preset.frames,
        preset.settings,
        preset.seed,
        arguments.workers,
        progress,
        preset.files,
    )
    frozen = describe_dataset(arguments.out, arguments.preset)
    path = Path(presets.__file__).with_name(frozen_file(arguments.preset))
    write_text(path, frozen.to_json())
    sys.stdout.write(
        f"\n{path}\ncontent {frozen.content_sha256}\n{frozen.trees_per_frame:.3f} trees a frame\n"
        f"occlusion {frozen.occlusion}\n"
    )


if __name__ == "__main__":
    main()
