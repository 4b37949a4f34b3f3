"""Programs in other languages: what they find in conformance kits, and their time beside Python's.

python -m benchmarks.hosts --model rgb --model depth \\
    --host "node=node examples/hosts/node/run-kit.js {kit} {out} 2 {rounds}" \\
    --host "cpp=examples/hosts/cpp/build/run_kit {kit} {out} 2 {rounds}" \\
    --result benchmarks/results/hosts.json

A kit is made of each model. The hosts run it in turn, several times, this package in Python among
them. The time of a turn is the median over the frames, from a frame in memory to its trees; that of
a host is its fastest turn, which other load on the machine disturbs least. A command without
{rounds} is run once and not timed, as under an emulator.
"""

from __future__ import annotations

import shlex
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from benchmarks.tools.program import finish, machine, note, program
from edgetree.catalogue import find_model
from edgetree.conformance import Results, compare_results, make_kit, read_results

PYTHON = f"{shlex.quote(sys.executable)} -m edgetree conformance run {{kit}} --out {{out}}"
ROUNDS = 3


def run(command: str, kit: Path, out: Path) -> Results:
    """What a host finds in a kit."""
    words = shlex.split(command.format(kit=kit, out=out, rounds=ROUNDS))
    subprocess.run(words, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    return read_results(out)


def findings(kit: Path, found: Results) -> dict[str, Any]:
    """What the check says of a host."""
    comparison = compare_results(kit, found)
    return {
        "runtime": f"{found.runtime} {found.runtime_version}",
        "processor": found.processor,
        "passed": comparison.passed,
        "unmatched": comparison.unmatched,
        "differences": {
            each.name: {
                "p95": round(each.p95, 5),
                "largest": round(each.largest, 5),
                "allowed": each.allowed,
                "outside": each.outside,
                "values": each.values,
            }
            for each in comparison.quantities
        },
    }


def measure(model: Path, hosts: dict[str, str], turns: int, folder: Path) -> dict[str, Any]:
    """All hosts on the kit of one model."""
    kit, expected = make_kit(model, folder / "kit")
    results: dict[str, dict[str, Any]] = {}
    times_ms: dict[str, list[float]] = {name: [] for name in hosts}
    for turn in range(turns):
        for name, command in hosts.items():
            if turn and "{rounds}" not in command:
                continue
            note(f"{model.name}: {name}, turn {turn + 1}")
            found = run(command, folder / "kit", folder / "results.json")
            results.setdefault(name, findings(folder / "kit", found))
            if found.median_ms is not None:
                times_ms[name].append(found.median_ms)
    for name, values in times_ms.items():
        if values:
            results[name]["turns_ms"] = [round(value, 2) for value in values]
            results[name]["to_python"] = round(min(values) / min(times_ms["python"]), 3)
    return {
        "model": model.name,
        "precision": kit.precision,
        "model_sha256": kit.model_sha256,
        "trees": sum(len(frame.trees) for frame in expected.frames),
        "covered": expected.covered,
        "hosts": results,
    }


def main() -> None:
    """Run the hosts on the kits of all models."""
    parser = program(__doc__)
    parser.add_argument("--model", action="append", required=True, help="name or file")
    parser.add_argument("--host", action="append", default=[], metavar="NAME=COMMAND")
    parser.add_argument("--turns", type=int, default=3)
    parser.add_argument("--threads", type=int, default=2, help="threads of the host in Python")
    arguments = parser.parse_args()
    python = f"{PYTHON} --threads {arguments.threads} --rounds {{rounds}}"
    hosts = {"python": python} | dict(given.split("=", 1) for given in arguments.host)
    models = []
    for model in arguments.model:
        with tempfile.TemporaryDirectory() as folder:
            models.append(measure(find_model(model), hosts, arguments.turns, Path(folder)))
    result = {
        "machine": machine(),
        "threads": arguments.threads,
        "rounds": ROUNDS,
        "turns": arguments.turns,
        "models": models,
    }
    finish(result, arguments.result)


if __name__ == "__main__":
    main()
