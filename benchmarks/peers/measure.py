"""Other detectors ("peers") timed beside this project's files, in turn and on the same frames.

Among them are torchvision's networks: its exports beside this project's, and both in PyTorch.

python -m benchmarks.peers.environments make --folder DIR
edgetree bench --backbones edge-n,r50 --precision int8 --models DIR/ours
python -m benchmarks.peers.measure --folder DIR --threads 2 --rounds 5 \\
    --ours edge-n-int8=DIR/ours/edge-n-int8-800x800.onnx \\
    --ours r50-int8=DIR/ours/r50-int8-800x800.onnx --result benchmarks/results/peers.json

Every contestant runs once in each round for a short time, in a process of its own with the Python
of its environment; those that need seconds for a run or to start leave out the later rounds. All
see the six sample frames at 800x800 px with the same number of threads. A time is the bare run of
the network from an array in memory; this project's files are also timed from a 1280x720 px frame to
the trees. The peers' networks are made first if they are missing in DIR, with untrained weights;
nothing is downloaded. A contestant that fails is listed with the reason.

The first --ours is what the ratios refer to. `table.py` prints the table of a result again.
"""

from __future__ import annotations

import argparse
import fnmatch
import json
import math
import sys
import time
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from basetree.files.writing import write_text
from benchmarks.peers.contestants import ABSENT, Contestant, ours, peers
from benchmarks.peers.environments import DEVELOPMENT, packages, python_of
from benchmarks.peers.prepare import Failed, call, facts_of, frames_file, prepare
from benchmarks.peers.rounds import merge, ratio, turns
from benchmarks.peers.table import table_lines
from benchmarks.tools.program import Record, note, program
from edgetree import TreeDetector
from edgetree.doctor.machine import examine_machine

SCHEMA = "edgetree.peers/1"
WORKERS = Path(__file__).parent / "workers"
DEVELOPMENT_PACKAGES = ("numpy", "onnxruntime", "torch", "torchvision")
MIB = 1024**2


def run(contestant: Contestant, arguments: argparse.Namespace) -> Record:
    """Run a contestant once for a short time, in a process of its own."""
    folder, threads = arguments.folder.absolute(), arguments.threads
    command = [
        python_of(contestant.environment, folder),
        WORKERS / contestant.worker,
        folder / contestant.file,
        frames_file(contestant.side_px, folder, depth=contestant.depth),
        f"--threads={threads}",
        f"--seconds={arguments.seconds}",
        f"--layout={contestant.layout}",
        *contestant.options,
    ]
    return call(command, threads, folder)


def run_all(
    contestants: dict[str, Contestant], failed: dict[str, str], arguments: argparse.Namespace
) -> dict[str, list[Record]]:
    """The records of all rounds by contestant.

    Those that fail leave, and enter `failed`. Those whose turns took more than the budget together
    take no part in later rounds, except the first, which the others are compared with.
    """
    records: dict[str, list[Record]] = {name: [] for name in contestants if name not in failed}
    left_s = dict.fromkeys(records, arguments.budget) | {next(iter(contestants)): math.inf}
    for number, name in turns(list(records), arguments.rounds):
        if name in failed or left_s[name] <= 0.0:
            continue
        note(f"round {number} of {arguments.rounds}: {name}")
        start = time.perf_counter()
        try:
            records[name].append({"round": number, **run(contestants[name], arguments)})
        except Failed as error:
            failed[name] = str(error)
            del records[name]
        left_s[name] -= time.perf_counter() - start
    return records


def size_mib(file: Path) -> float:
    """Size of a network's file, with the weights beside it."""
    weights = file.with_suffix(".bin")
    parts = [file, weights] if file.suffix == ".xml" else [file]
    return round(sum(part.stat().st_size for part in parts) / MIB, 2)


def row(contestant: Contestant, records: Sequence[Record], folder: Path) -> Record:
    """What the result says of a contestant."""
    network, file = contestant.network, folder / contestant.file
    if network is None:
        parameters = TreeDetector.load(file).manifest.parameters
    else:
        parameters = facts_of(network, folder)["parameters"]
    frames = np.load(frames_file(contestant.side_px, folder, depth=contestant.depth), mmap_mode="r")
    return {
        "name": contestant.name,
        "gives": list(contestant.gives),
        "lacks": list(contestant.lacks),
        "licence": contestant.licence,
        "runtime": records[0]["runtime"],
        "precision": contestant.precision,
        "timed": contestant.timed,
        "input_px": [frames.shape[2], frames.shape[1]],
        "file": "/".join(file.parts[-2:]),
        "file_mib": size_mib(file),
        "parameters": parameters,
        **merge(records),
    }


def measure(contestants: dict[str, Contestant], arguments: argparse.Namespace) -> dict[str, Any]:
    """Prepare and run all contestants; returns the JSON object."""
    folder, reference = arguments.folder, next(iter(contestants))
    networks = {each.network: None for each in contestants.values() if each.network}
    unmade = prepare(networks, folder)
    failed = {
        name: unmade[each.network] for name, each in contestants.items() if each.network in unmade
    }
    records = run_all(contestants, failed, arguments)
    if reference not in records:
        raise Failed(f"{reference}: {failed[reference]}")
    rows = [row(contestants[name], found, folder) for name, found in records.items()]
    for each in rows:
        each["ratio"] = ratio(each["rounds_ms"], rows[0]["rounds_ms"])
    machine = examine_machine()
    development = [f"{package}=={version(package)}" for package in DEVELOPMENT_PACKAGES]
    return {
        "schema": SCHEMA,
        "date": time.strftime("%Y-%m-%d"),
        "machine": machine.processor,
        "instructions": machine.instructions,
        "threads": arguments.threads,
        "rounds": arguments.rounds,
        "seconds": arguments.seconds,
        "reference": reference,
        "packages": {DEVELOPMENT: development, **packages()},
        "absent": ABSENT | failed,
        "contestants": rows,
    }


def parse(parser: argparse.ArgumentParser) -> argparse.Namespace:
    """Parse and check the command line."""
    parser.add_argument("--folder", type=Path, required=True, help="environments and peers' files")
    parser.add_argument(
        "--ours", action="append", required=True, metavar="NAME=FILE", help="a file of edgetree"
    )
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=0.5, help="of a contestant in a round")
    parser.add_argument(
        "--budget",
        type=float,
        default=12.0,
        metavar="SECONDS",
        help="of a contestant's turns with start-up; when spent, it leaves out further rounds",
    )
    parser.add_argument("--only", nargs="+", default=["*"], metavar="PATTERN", help="peers' names")
    arguments = parser.parse_args()
    for given in arguments.ours:
        if not Path(given.partition("=")[2]).is_file():
            parser.error(f"--ours is {given!r}: expected NAME=FILE with a file that is there")
    if min(arguments.threads, arguments.rounds) < 1:
        parser.error("--threads and --rounds: expected 1 or more")
    return arguments


def all_contestants(arguments: argparse.Namespace) -> dict[str, Contestant]:
    """This project's files and the chosen peers, by name."""
    found = []
    for given in arguments.ours:
        name, _, file = given.partition("=")
        found += ours(name, Path(file), TreeDetector.load(file).manifest)
    for peer in peers():
        if any(fnmatch.fnmatch(peer.name, pattern) for pattern in arguments.only):
            found.append(peer)
    return {each.name: each for each in found}


def main() -> None:
    """Print the table, and optionally write the result to a file."""
    parser = program(__doc__)
    arguments = parse(parser)
    try:
        result = measure(all_contestants(arguments), arguments)
    except Failed as error:
        parser.error(str(error))
    if arguments.result:
        text = json.dumps(result, indent=1, ensure_ascii=False) + "\n"
        write_text(arguments.result, text)
    sys.stdout.write("\n".join(table_lines(result)) + "\n")


if __name__ == "__main__":
    main()
