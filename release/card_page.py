"""The page of a model card, in Markdown."""

from __future__ import annotations

from typing import Any

_SETS = {"test": "`test`", "field_test": "`field-test`"}
_QUANTITIES = {
    "diameter_m": ("diameter at the cut", 1000, "mm"),
    "dbh_m": ("diameter at breast height", 1000, "mm"),
    "cut_height_m": ("cut height", 100, "cm"),
    "distance_m": ("distance of the cut", 100, "cm"),
    "inclination_deg": ("inclination", 1, "degrees"),
}
_WEAKEST = 6


def page(card: dict[str, Any]) -> str:
    """Make the page.

    Args:
        card: Figures of the schema `edgetree.card/1`, as `release/cards.py` makes them.
    """
    parts = [
        f"# {card['model']}",
        f"For {card['for']}.",
        _file(card),
        "## Detection",
        f"On the frozen test sets, {_frames(card)}, by the file itself.",
        _detection(card),
        "## What scores mean",
        "Of the detections on `test` with a score in each range, so many are labelled trees:",
        _reliability(card["test"]["reliability"]),
        "## Metres",
        "With the simulated depth cameras, gravity given, against the simulated truth: median and"
        " 90th percentile of the absolute error. The last column is the share of true values inside"
        " the stated 95 % intervals, with the settings of simulated stems and depth cameras"
        " (`SIMULATED` in `benchmarks/measure.py`); the usual ones are for real stems, and wider.",
        *(part for name in _SETS for part in _metres(name, card[name]["metres"])),
        "## What it is bad at",
        "The groups of `test` and `field-test` in which it finds the smallest share of the trees:",
        _weakest(card),
        "## Training",
        _training(card),
    ]
    return "\n\n".join(parts) + "\n"


def _table(head: list[str], rows: list[list[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _file(card: dict[str, Any]) -> str:
    speed = card["speed"]
    width, height = card["input_px"]
    rows = [
        [
            "file",
            f"{card['file_bytes'] / 1e6:.1f} MB, {card['precision']}, input {width}x{height} px",
        ],
        ["parameters", f"{card['parameters'] / 1e6:.2f} M"],
        ["SHA-256", f"`{card['model_sha256']}`"],
        [
            "speed",
            f"{speed['detect_p50_ms']:.1f} ms a frame (median; 90th percentile"
            f" {speed['detect_p90_ms']:.1f} ms), one thread, {speed['machine']}",
        ],
        ["measured on", card["date"]],
    ]
    return _table(["", ""], rows)


def _frames(card: dict[str, Any]) -> str:
    return " and ".join(
        f"{card[name]['frames']} frames with {card[name]['trees']} trees ({title})"
        for name, title in _SETS.items()
    )


def _detection(card: dict[str, Any]) -> str:
    sets = [card[name] for name in _SETS]
    shown = [each["at_score"] for each in sets]
    kinds = ("boxes", "masks", "keypoints")
    precision = [
        " / ".join(_number(each["average_precision"][kind], 1) for kind in kinds) for each in sets
    ]
    rows = [
        ["AP of boxes / masks / keypoints, %", *precision],
        ["trees found at score 0.5, %", *(_percent(each["found_share"]) for each in shown)],
        [
            "the same, of trees that show at least half of their lower trunk, %",
            *(_percent(each["found_share_visible_half"]) for each in shown),
        ],
        [
            "false trees a frame at score 0.5",
            *(f"{each['invented_per_frame']:.2f}" for each in shown),
        ],
        ["right ones among those shown, %", *(_percent(each["precision"]) for each in shown)],
        ["mean error of the diameter, px", *(f"{each['diameter_error_px']:.1f}" for each in sets)],
    ]
    for image in card["test"].get("alone", ()):
        alone = [each["alone"][image] for each in sets]
        precision = [
            " / ".join(_number(each["average_precision"][kind], 1) for kind in kinds)
            for each in alone
        ]
        shares = (f"{_percent(x['found_share'])}, {x['invented_per_frame']:.2f}" for x in alone)
        rows += [
            [f"{image} alone: AP, %", *precision],
            [f"{image} alone: found, %, and false trees a frame", *shares],
        ]
    return _table(["", *_SETS.values()], rows)


def _reliability(figures: dict[str, Any]) -> str:
    rows = [
        [
            f"{each['from']:.1f} to {each['to']:.1f}",
            str(each["detections"]),
            _percent(each["right"]),
        ]
        for each in figures["bins"]
        if each["detections"]
    ]
    table = _table(["score", "detections", "right, %"], rows)
    return f"{table}\n\nMean difference of score and share: {figures['expected_error']:.3f}."


def _metres(name: str, metres: dict[str, Any]) -> list[str]:
    rows = []
    for key, (title, factor, unit) in _QUANTITIES.items():
        found = metres["quantities"][key]
        if found["measured"]:
            rows.append(
                [
                    title,
                    str(found["measured"]),
                    f"{factor * found['median_abs']:.1f} {unit}",
                    f"{factor * found['p90_abs']:.1f} {unit}",
                    f"{factor * found['bias']:+.1f} {unit}",
                    _percent(metres["intervals"][key]["all"]),
                ]
            )
    head = [_SETS[name], "measured", "median error", "90th percentile", "bias", "inside, %"]
    return [_table(head, rows), _by_distance(name, metres["diameter_by_distance"])]


def _by_distance(name: str, groups: dict[str, Any]) -> str:
    rows = [
        [
            f"{limits} m",
            str(group["trees"]),
            str(group["measured"]),
            f"{1000 * group['median_abs']:.0f} ({1000 * group['p90_abs']:.0f})",
        ]
        for limits, group in groups.items()
        if group["measured"]
    ]
    head = [f"diameter by distance, {_SETS[name]}", "trees", "measured", "median (90th) error, mm"]
    return _table(head, rows)


def _weakest(card: dict[str, Any]) -> str:
    rows = []
    for name, title in _SETS.items():
        for group in card[name]["weakest"][:_WEAKEST]:
            rows.append(
                [
                    title,
                    f"{group['condition']}: {group['group']}",
                    str(group["trees"]),
                    _percent(group["recall"]),
                    _number(group["boxes_ap"], 1),
                ]
            )
    return _table(["", "group", "trees", "found, %", "AP of boxes, %"], rows)


def _training(card: dict[str, Any]) -> str:
    made = card["training"]
    if made is None:
        return "Not known: the repository holds no checkpoint of this name."
    rate = f"learning rate {made['learning_rate']:g}"
    if made["schedule"] == "decay":
        rate = f"a learning rate that falls from {made['learning_rate']:g} to nothing"
    branch = made["init"]["name"].startswith("branch of")
    lines = [
        f"Last run: {made['steps']} steps of {made['batch']} frames, {'the last ' * branch}"
        f"{60 * made['hours']:.0f} minutes ({made['device']}) with {rate}, seed {made['seed']}, on"
        f" {made['frames']} simulated frames ({made['data']}). The [README](README.md) tells the"
        " runs before it."
    ]
    if made["averaged_runs"] > 1:
        lines.append(
            f"The weights are the average of those of {made['averaged_runs']} runs, of which this"
            " is one."
        )
    fitted = made["score_calibration"]
    if fitted is not None:
        before, after = fitted["expected_error"]
        done = "Scores were scaled by `perceptree calibrate-scores`"
        if fitted.get("keep_level"):
            done = (
                "How much masks count in the scores was fitted by `perceptree calibrate-scores"
                " --keep-level`"
            )
        lines.append(
            f"{done} on"
            f" {fitted['detections']} detections of other frames ({fitted['data']}): mean"
            f" difference of score and share of trees {before:.3f} before, {after:.3f} after."
        )
    parts = ["\n".join(lines), _scenes(card["training_scenes"]), *_credits(made)]
    return "\n\n".join(parts)


def _credits(made: dict[str, Any]) -> list[str]:
    """Whose weights and photographs the network has learned from."""
    parts = []
    for each in made.get("pretrained", []):
        licence = each.get("licence", "see its publisher")
        parts.append(f"Pretrained weights of the backbone: `{each['weights']}` ({licence}).")
    photographs = made.get("photographs", [])
    if photographs:
        rows = [
            [each["kind"], each["source"], each["licence"] or "not stated"] for each in photographs
        ]
        head = ["photographs of", "source", "licence and authors"]
        parts += ["Photographs on the materials of the simulated frames:", _table(head, rows)]
    return parts


def _scenes(scenes: list[dict[str, Any]]) -> str:
    """All simulated scenes that the file was made with, in any run."""
    names = ("use", "data", "seed", "scenes", "frames")
    head = ["for", "settings", "seed", "scenes", "frames"]
    rows = [[str(each[name]) for name in names] for each in scenes]
    return f"Every simulated scene that it was made with, in any run:\n\n{_table(head, rows)}"


def _percent(share: float | None) -> str:
    return "-" if share is None else f"{100 * share:.0f}"


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"
