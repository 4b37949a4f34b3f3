"""Draw how the models' average precision rose with training.

python -m benchmarks.learning_curve --out docs/images/learning-curve.png

The figures are in `benchmarks/results/learning_curve.json`: of each file its card at the time,
of weights without a file `perceptree eval`.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from benchmarks.tools.plots import panels, save

RESULT = Path(__file__).parent / "results" / "learning_curve.json"
HEADS = ("boxes", "masks", "keypoints")
COLOURS = {
    "edge-n-depth": "#1b6ca8",
    "edge-s-depth": "#5fb0e5",
    "edge-n-rgb": "#b8541a",
    "edge-s-rgb": "#efa045",
}


def main() -> None:
    """Draw one plot for each head."""
    assert __doc__
    parser = argparse.ArgumentParser(description=__doc__.partition("\n\n")[0])
    parser.add_argument("--out", type=Path, required=True)
    out = parser.parse_args().out
    models = json.loads(RESULT.read_text(encoding="utf-8"))["models"]
    figure, plots = panels(1, len(HEADS), (11, 3.6), sharex=True)
    for plot, head in zip(plots, HEADS, strict=True):
        for name, points in models.items():
            frames = [point["frames"] / 1000 for point in points]
            values = [point[head] for point in points]
            plot.plot(frames, values, color=COLOURS[name], label=name)
            for x, y, point in zip(frames, values, points, strict=True):
                inside = COLOURS[name] if point.get("shipped", True) else "white"
                mark = "D" if "device" in point else "o"
                plot.plot(x, y, mark, color=COLOURS[name], markerfacecolor=inside, markersize=6)
        plot.set(title=f"AP of {head} on test, %", xlabel="frames seen, thousands")
    plots[0].legend(fontsize=8)
    save(figure, out)


if __name__ == "__main__":
    main()
