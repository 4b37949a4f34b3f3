"""Tables of the page on accuracy."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from benchmarks.figures.hard_scenes import hard_scenes
from benchmarks.figures.pages import Record, card, stored, table

NAMES = {
    "diameter_m": "diameter at the cut",
    "dbh_m": "diameter at breast height",
    "profile": "diameters along the stem",
    "taper_cm_per_m": "taper",
    "cut_height_m": "height of the cut",
    "distance_m": "distance of the cut",
    "axis_distance_m": "distance to the axis",
    "inclination_deg": "inclination",
}
UNITS = {"diameter_m": "mm", "dbh_m": "mm", "inclination_deg": "degrees"}
MODELS = ("edge-n-depth", "edge-s-depth", "edge-n-rgb", "edge-s-rgb")


def _percent(value: float | None, digits: int = 0) -> str:
    return "" if value is None else f"{100 * value:.{digits}f} %"


def _in_unit(value: float, quantity: str, *, unit: bool = True) -> str:
    """A value in the unit that people use for its quantity."""
    name = UNITS.get(quantity, "cm")
    scale = {"mm": 1000, "cm": 100, "degrees": 1}[name]
    digits = 0 if name == "mm" else 1
    return f"{scale * value:.{digits}f}{' ' + name if unit else ''}"


def _error(errors: Record, quantity: str, *, unit: bool = True) -> str:
    """Median and 90th percentile of an absolute error."""
    far = _in_unit(errors["p90_abs"], quantity, unit=False)
    return f"{_in_unit(errors['median_abs'], quantity, unit=unit)} ({far})"


def values() -> Iterator[str]:
    """Each value with exact outlines and with the network's."""
    labels, network = stored("measure_labels"), stored("measure_edge_n_depth")
    head = ["Value", "Exact outlines: given", "error", "inside", "`edge-n-depth`: given", "error"]
    rows = []
    for name in labels["quantities"]:
        row = [NAMES[name]]
        for result in (labels, network):
            errors = result["quantities"][name]
            inside = _percent(result["intervals"][name]["all"])
            row += [f"{errors['measured']:,}", _error(errors, name), inside]
        rows.append(row)
    return table([*head, "inside"], rows)


def by_distance() -> Iterator[str]:
    """Errors of the diameter by distance."""
    labels, network = stored("measure_labels"), stored("measure_edge_n_depth")
    rows = []
    for band, errors in labels["diameter_by_distance"].items():
        start, end = band.split("-")
        far = network["diameter_by_distance"][band]
        short = 1000 * labels["naive_diameter_by_distance"][band]["median_abs"]
        cells = [_error(found, "diameter_m", unit=False) for found in (errors, far)]
        rows.append([f"{start} to {end} m", *cells, f"{short:.0f}"])
    head = [
        "Distance",
        "Exact outlines, mm",
        "`edge-n-depth`, mm",
        "Depth x width / focal length, mm",
    ]
    return table(head, rows)


def by_visibility() -> Iterator[str]:
    """Errors of the diameter by what shows of the stem."""
    rows = []
    bands = stored("measure_edge_n_depth")["diameter_by_visible_fraction"]
    for band, errors in reversed(bands.items()):
        low, high = (float(end) for end in band.split("-"))
        shown = f"{100 * low:.0f} to {min(100 * high, 100):.0f} %"
        counts = [f"{errors[name]:,}" for name in ("trees", "measured")]
        rows.append([shown, *counts, _error(errors, "diameter_m", unit=False)])
    return table(["Part of the stem that is visible", "Trees", "Measured", "Error, mm"], rows)


def levels() -> Iterator[str]:
    """Share of true values within the intervals of five levels."""
    record = stored("coverage")
    sources = {
        "labels": "exact outlines",
        "network": "`edge-n-depth`",
        "edge-s-depth": "`edge-s-depth`",
    }
    rows = []
    for name, words in NAMES.items():
        cells = []
        for source in sources:
            found = record[f"{name}, {source}"]
            shares = ", ".join(f"{100 * share:.0f}" for share in found["inside"].values())
            cells += [shares, _percent(found["beyond_3_std"], 1)]
        rows.append([words, *cells])
    head = ["Value"]
    for words in sources.values():
        head += [f"{words}: inside 50, 68, 90, 95, 99 %", "beyond 3 deviations"]
    return table(head, rows)


def lidar() -> Iterator[str]:
    """Stems by rotating scanners."""
    rows = []
    for name, scores in stored("metres_lidar").items():
        _, rings, place = name.split("-")
        cells = [rings, {"near": "3 to 8 m", "far": "8 to 16 m"}[place]]
        for quantity in ("diameter_m", "dbh_m", "distance_m"):
            found = scores[quantity]
            cells += [f"{found['given']} of {found['stems']}", f"{100 * found['rmse']:.1f} cm"]
            cells.append(_percent(found["inside"][3]))
        rows.append(cells)
    head = ["Rings", "Distance"]
    for words in ("Diameter", "Breast height", "Distance of the cut"):
        head += [f"{words}: given", "RMS error", "inside"]
    return table(head, rows)


def without_depth() -> Iterator[str]:
    """Values by the ways that need no depth."""
    ways = {
        "camera height, given": "camera's height, exact outlines",
        "camera height, network": "camera's height, `edge-n-rgb`",
        "marker, given": "marker on the stem, exact outlines",
        "marker, network": "marker on the stem, `edge-n-rgb`",
        "motion ahead": "motion, 2 m ahead",
        "motion aside": "motion, 2 m to the side",
    }
    rows = []
    for key, found in stored("without_depth").items():
        way, _, quantity = key.rpartition(", ")
        metres = quantity == "cut_height_m"
        sizes = [
            f"{100 * found[name]:.1f} {'cm' if metres else '%'}"
            for name in ("median_error", "median_std")
        ]
        given = f"{found['given']} of {found['stems']}"
        beyond = _percent(found["beyond_3_std"], 1)
        rows.append(
            [ways[way], NAMES[quantity], given, *sizes, _percent(found["inside_95"]), beyond]
        )
    head = ["Way", "Value", "Measured", "Error", "Stated deviation", "Inside 95 %"]
    return table([*head, "Beyond 3 deviations"], rows)


def sensors() -> Iterator[str]:
    """Breast height of cylinders in front of other depth cameras."""
    kinds = {
        "stereo": "stereo",
        "stereo-2x2": "stereo, 2x2",
        "tof": "time of flight",
        "tof-2x2": "time of flight, 2x2",
        "exact": "exact",
    }
    sizes = ("1280x720", "848x480", "640x480", "256x192")
    record = stored("sensors")
    rows = []
    for kind, words in kinds.items():
        cells = []
        for size in sizes:
            found = record[f"control {size} {kind} edge-n-depth"]["dbh_m"]
            bias = f"{100 * found['bias']:+.1f}, {100 * found['rmse']:.1f} cm"
            cells.append(f"{bias}, {_percent(found['inside'][3])}")
        rows.append([words, *cells])
    return table(["Depth camera", *sizes], rows)


def sensor_cards() -> Iterator[str]:
    """What the depth networks find through other depth cameras."""
    models = stored("sensor_cards")["models"]
    real = {
        "tof_trees": "18 captures of trees, time of flight 240x180",
        "tof_portrait": "24 captures of one stem, time of flight 180x240",
    }
    rows = []
    for name, first in models["edge-n-depth"].items():
        cells = [real.get(name, name), str(first["trees"])]
        for model in ("edge-n-depth", "edge-s-depth"):
            found = models[model][name]
            outward = found.get("outward_px")
            edge = "" if outward is None else f"{outward:+.1f} ± {found['std_px']:.1f}"
            cells += [_percent(found["found"]), _percent(found.get("right")), edge]
        rows.append(cells)
    head = ["Camera", "Trees"]
    for model in ("edge-n-depth", "edge-s-depth"):
        head += [f"`{model}`: found", "right", "edge outward, px"]
    return table(head, rows)


def models() -> Iterator[str]:
    """What the cards of the packaged files say."""
    cards = [card(name) for name in MODELS]

    def row(words: str, cell: Callable[[Record], str]) -> list[str]:
        return [words, *(" / ".join(cell(own[s]) for s in ("test", "field_test")) for own in cards)]

    def score(name: str) -> Callable[[Record], str]:
        return lambda found: f"{found['average_precision'][name]:.1f}"

    def share(name: str) -> Callable[[Record], str]:
        return lambda found: _percent(found["at_score"][name])

    def metres(name: str) -> Callable[[Record], str]:
        return lambda found: _in_unit(found["metres"]["quantities"][name]["median_abs"], name)

    def inside(name: str) -> Callable[[Record], str]:
        return lambda found: _percent(found["metres"]["intervals"][name]["all"])

    rows = [
        row("AP of boxes", score("boxes")),
        row("AP of masks", score("masks")),
        row("AP of keypoints", score("keypoints")),
        row("trees found", share("found_share")),
        row("found of those that show at least half", share("found_share_visible_half")),
        row("right ones among those shown", share("precision")),
        row("false trees a frame", lambda found: f"{found['at_score']['invented_per_frame']:.2f}"),
        row("diameter, mean error in px", lambda found: f"{found['diameter_error_px']:.1f}"),
    ]
    for name in ("diameter_m", "dbh_m", "cut_height_m", "distance_m", "inclination_deg"):
        rows.append(row(f"{NAMES[name]} with depth, median error", metres(name)))
        rows.append(row("inside its 95 % interval", inside(name)))
    return table(["`test` / `field-test`", *(f"`{name}`" for name in MODELS)], rows)


def both_images() -> Iterator[str]:
    """What a model of colour and depth finds with both and with one, beside models of one."""
    others = {name: card(name) for name in ("edge-s-depth", "edge-s-rgb", "edge-n-rgb")}

    def cells(found: list[Record]) -> list[str]:
        scores = [each["average_precision"] for each in found]
        kinds = ("boxes", "masks", "keypoints")
        precision = (" / ".join(f"{score[kind]:.1f}" for kind in kinds) for score in scores)
        shown = [each.get("at_score", each) for each in found]
        right = " / ".join(_percent(each["found_share"]) for each in shown)
        false = " / ".join(f"{each['invented_per_frame']:.2f}" for each in shown)
        return [*precision, right, false]

    sets = ("test", "field_test")
    models = {name: card(name) for name in ("edge-s", "edge-s-any")}
    rows = [
        [f"`{name}`, both images", *cells([found[each] for each in sets])]
        for name, found in models.items()
    ]
    for image in ("depth", "colour"):
        for name, found in models.items():
            alone = [found[each]["alone"][image] for each in sets]
            rows.append([f"`{name}`, {image} alone", *cells(alone)])
        rows += [
            [f"`{name}`", *cells([found[each] for each in sets])]
            for name, found in others.items()
            if name.endswith("depth") == (image == "depth")
        ]
    head = ["", "AP of boxes / masks / keypoints, `test`", "`field-test`"]
    return table([*head, "trees found", "false trees a frame"], rows)


def false_trees() -> Iterator[str]:
    """What the false trees of the files are, a frame."""
    record = stored("false_trees")
    words = {
        "further": f"stems 10 to {record['reach_m']:.0f} m away",
        "again": "a tree again",
        "loose": "a stem, the box off",
        "other": "others",
    }
    rows = []
    for name, own in record["models"].items():
        counts = own["false"], *(own["kinds"][kind] for kind in words)
        rows.append([f"`{name}`", *(f"{count / own['frames']:.3f}" for count in counts)])
    return table([f"`{record['test_set']}`, a frame", "false trees", *words.values()], rows)


def reach() -> Iterator[str]:
    """Trees found and false trees, without and with the camera."""
    rows = []
    for name, sets in stored("reach")["models"].items():
        pairs = [sets[data] for data in ("test_set", "field_test_set")]
        for words, way in (("image alone", "without_camera"), ("with the camera", "with_camera")):
            found = " / ".join(_percent(pair[way]["found_share"]) for pair in pairs)
            false = " / ".join(f"{pair[way]['false_per_frame']:.2f}" for pair in pairs)
            rows.append([f"`{name}`, {words}", found, false])
    return table(["`test` / `field-test`", "trees found", "false trees a frame"], rows)


TABLES: dict[str, Callable[[], Iterator[str]]] = {
    "values": values,
    "by-distance": by_distance,
    "by-visibility": by_visibility,
    "levels": levels,
    "hard-scenes": hard_scenes,
    "lidar": lidar,
    "without-depth": without_depth,
    "sensors": sensors,
    "sensor-cards": sensor_cards,
    "models": models,
    "both-images": both_images,
    "false-trees": false_trees,
    "reach": reach,
}
