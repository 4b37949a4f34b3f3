"""How often `edgetree check` passes, fails, or is undecided, on simulated tables of stems.

python -m benchmarks.check_rates --result benchmarks/results/check_rates.json

Diameters are uniform from 15 to 60 cm, the true errors from 3 to 7 % of them. Errors are normal,
or Student's t with four degrees of freedom, scaled to the same standard deviation. The factor is
the true errors divided by the stated ones. Rows with gross errors have readings of ten times the
diameter, or of a tenth. Each row has 1,000 trials with seeds from 1000 on.
Needs no model. `--stems` runs some numbers of stems only; results are added to the file.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from basetree.files.writing import write_text
from benchmarks.tools.program import Record, note, program, read_record
from edgetree.check.matching import Pair
from edgetree.check.quantities import QuantityCheck, Share, check_quantity
from edgetree.check.stems import CaliperStem, MeasuredStem
from edgetree.check.verdict import judge
from edgetree.measure import Estimate, Failure

FIRST_SEED = 1000
STEMS = (3, 5, 10, 20, 30, 60, 200)
OUTCOMES = ("passed", "failed", "undecided")


@dataclass(frozen=True)
class Machine:
    """A simulated machine and the table of its caliper."""

    name: str
    bias: float = 0.0
    factor: float = 1.0
    refused: float = 0.0
    gross: int = 0


MACHINES = (
    Machine("unbiased"),
    *(Machine(f"bias {share:.0%}", bias=share) for share in (0.02, 0.03, 0.05, 0.1)),
    *(Machine(f"factor {factor:g}", factor=factor) for factor in (0.1, 0.5, 2.0, 4.0)),
    *(Machine(f"refuses {share:.0%}", refused=share) for share in (0.1, 0.3, 0.6, 0.9)),
    *(Machine(f"{count} gross", gross=count) for count in (1, 2)),
    *(Machine(f"bias 10%, {count} gross", bias=0.1, gross=count) for count in (1, 2)),
)


def pairs_of(machine: Machine, stems: int, heavy: bool, seed: int) -> tuple[Pair, ...]:
    """One trial's matched stems."""
    rng = np.random.default_rng(seed)
    true_m = rng.uniform(0.15, 0.6, stems)
    share = rng.uniform(0.03, 0.07, stems)
    noise = rng.standard_t(4, stems) / np.sqrt(2) if heavy else rng.normal(size=stems)
    measured_m = true_m * (1 + machine.bias + share * noise)
    std_m = true_m * share / machine.factor
    wrong = rng.choice(stems, machine.gross, replace=False)
    typed_m = true_m.copy()
    typed_m[wrong] *= rng.choice([0.1, 10.0], machine.gross)
    refused = rng.random(stems) < machine.refused
    pairs = []
    for number in range(stems):
        value = Estimate(float(measured_m[number]), float(std_m[number]))
        given = Failure("no depth") if refused[number] else value
        pairs.append(
            Pair(
                MeasuredStem("a", number, {"diameter_m": given}),
                CaliperStem(number + 2, {"diameter_m": Estimate(float(typed_m[number]), 0.0)}),
            )
        )
    return tuple(pairs)


def rates(machine: Machine, stems: int, heavy: bool, trials: int) -> Record:
    """Shares of the outcomes, and the mean of the stated power to see a bias of 3 %."""
    outcomes: Counter[str] = Counter()
    powers = []
    for seed in range(FIRST_SEED, FIRST_SEED + trials):
        pairs = pairs_of(machine, stems, heavy, seed)
        check = check_quantity("diameter_m", pairs)
        if not isinstance(check, QuantityCheck):
            outcomes["nothing to compare"] += 1
            continue
        refused = len(check.not_measured)
        verdict = judge({"diameter_m": check}, Share(refused, stems))
        outcomes[verdict.outcome] += 1
        powers.append(verdict.power["diameter_m"].small_bias)
    shares = {name: outcomes[name] / trials for name in (*OUTCOMES, "nothing to compare")}
    return {**shares, "power_3_percent": round(float(np.mean(powers)), 3)}


def table(result: Record, heavy: str) -> str:
    """Passed / failed / undecided of 100 cases, in Markdown."""
    lines = ["| machine | " + " | ".join(map(str, STEMS)) + " |", "| --- " * 8 + "|"]
    for machine in MACHINES:
        cells = [result.get(f"{machine.name}, {heavy}, {stems}") for stems in STEMS]
        words = ["" if each is None else _cell(each) for each in cells]
        lines.append(f"| {machine.name} | " + " | ".join(words) + " |")
    return "\n".join(lines)


def _cell(rates: Record) -> str:
    return " / ".join(f"{rates[name] * 100:.0f}" for name in OUTCOMES)


def run(stems: Sequence[int], trials: int, path: Path | None) -> Record:
    """Add the rows of some numbers of stems to the results in a file."""
    result = read_record(path)
    for count in stems:
        for machine in MACHINES:
            for heavy in (False, True):
                name = f"{machine.name}, {'t4' if heavy else 'normal'}, {count}"
                result[name] = rates(machine, count, heavy, trials)
                note(name, result[name])
    return result


def main() -> None:
    """The command line."""
    import json

    parser = program(__doc__)
    parser.add_argument("--stems", type=int, nargs="+", default=list(STEMS))
    parser.add_argument("--trials", type=int, default=1000)
    arguments = parser.parse_args()
    result = run(arguments.stems, arguments.trials, arguments.result)
    if arguments.result is not None:
        write_text(arguments.result, json.dumps(result, indent=1) + "\n")
    for heavy in ("normal", "t4"):
        print(f"\n{heavy}\n\n{table(result, heavy)}")  # noqa: T201


if __name__ == "__main__":
    main()
