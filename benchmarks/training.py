"""Speed of training, compared with the former trainer, and a time profile of a step.

python -m benchmarks.training DATA --result FILE.json [--former CHECKOUT]

DATA is a dataset of `perceptree synth`. `edge-n` is trained on depth at 640x384 px, 8 frames
per step. CHECKOUT is a checkout of the commit before this engine (f4cffdb). Its trainer alternates
with this one, in separate processes, in its original form (bfloat16 autocast on every CPU) and with
float32. Then a step is profiled in the precision that training chooses here, and compared with the
measured peak of this machine in matrix products.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import torch
from torch.profiler import ProfilerActivity, profile
from torch.utils.flop_counter import FlopCounterMode

from benchmarks.tools.program import finish, machine, program
from edgetree.bench.peak import machine_peak
from perceptree.data import FrameStore, read_split
from perceptree.models import TreeRCNN, make_spec
from perceptree.training import TrainSettings
from perceptree.training.hardware import fastest_precision, keep_freed_memory
from perceptree.training.optimizer import make_optimizer

ROOT = Path(__file__).resolve().parents[1]
BATCH = 8
LEFT_OUT_STEPS = 2
PEAK_S = 1.0
GROUPS = {
    "convolutions": ("convolution", "_Depthwise"),
    "batch norms": ("batch_norm",),
    "activations": ("threshold", "clamp_min", "relu"),
    "matrix products": ("mm",),
    "pooling of regions": ("embedding_bag", "_WeightedSums"),
    "optimizer and average": ("_foreach", "lerp", "addcdiv", "addcmul", "Optimizer"),
}

RUN = """
import json, sys, time
from pathlib import Path
import torch
data, out, steps = Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3])
if sys.argv[4] == "fp32":
    whole = torch.autocast
    torch.autocast = lambda kind, *rest, **more: whole(kind, enabled=False)
from perceptree.models import make_spec
from perceptree.training import TrainSettings, train
marks = []
waited = []
def note(status):
    marks.append(time.perf_counter())
    waited.append(getattr(status, "waiting_share", None))
ends = {"evaluations": 1} if "evaluations" in TrainSettings.__dataclass_fields__ else {}
train(make_spec("edge-n", "depth"), TrainSettings(steps=steps, **ends), data, out, note)
print(json.dumps({"marks": marks, "waited": waited[-1]}))
"""


def frames_per_s(code: Path, data: Path, steps: int, precision: str) -> dict[str, Any]:
    """Frames per second of a short training by the code in a folder, after the first steps."""
    with tempfile.TemporaryDirectory() as out:
        done = subprocess.run(
            [sys.executable, "-c", RUN, str(data), out, str(steps), precision],
            cwd=code,
            env=os.environ | {"PYTHONPATH": str(code)},
            capture_output=True,
            text=True,
            check=True,
        )
    found = json.loads(done.stdout.splitlines()[-1])
    marks = found["marks"]
    rate = BATCH * (len(marks) - LEFT_OUT_STEPS) / (marks[-1] - marks[LEFT_OUT_STEPS - 1])
    return {"frames_per_s": rate, "waiting_share": found["waited"]}


def in_turn(data: Path, former: Path | None, steps: int, rounds: int) -> dict[str, Any]:
    """Frames per second of this trainer and the former one, alternating."""
    runs = {"now": (ROOT, "as it is")}
    if former is not None:
        runs |= {"former, fp32": (former, "fp32"), "former, bf16": (former, "as it was")}
    rates: dict[str, list[float]] = {name: [] for name in runs}
    waiting = []
    for number in range(rounds):
        for name, (code, precision) in runs.items():
            if name == "former, bf16" and number:
                continue  # with emulated bfloat16 a round takes minutes
            found = frames_per_s(code, data, steps, precision)
            rates[name].append(found["frames_per_s"])
            if name == "now":
                waiting.append(found["waiting_share"])
            sys.stderr.write(f"{name}: {found['frames_per_s']:.2f} frames/s\n")
    medians = {name: statistics.median(values) for name, values in rates.items()}
    return {
        "frames_per_s": rates,
        "median": medians,
        "ratio": {name: medians["now"] / value for name, value in medians.items()},
        "waiting_share": max(waiting),
    }


def profiled_step(data: Path) -> dict[str, Any]:
    """Profile a training step: its arithmetic, and the fraction of its time by kind of work."""
    precision = fastest_precision(torch.device("cpu"))
    keep_freed_memory()
    spec = make_spec("edge-n", "depth")
    model, store = TreeRCNN(spec).train(), FrameStore(read_split(data, "train"), spec)
    samples = [store[number % len(store)] for number in range(BATCH)]
    images = torch.stack([torch.from_numpy(sample.image) for sample in samples])
    targets = [sample.targets() for sample in samples]
    optimizer = make_optimizer(model, TrainSettings(steps=1))

    def step() -> None:
        optimizer.zero_grad(set_to_none=True)
        with torch.autocast("cpu", torch.bfloat16, enabled=precision == "bf16"):
            losses = model.losses(images, targets)
        torch.stack(list(losses.values())).sum().backward()  # type: ignore[no-untyped-call]
        optimizer.step()

    with FlopCounterMode(display=False) as counter:
        step()
    step()
    start_s = time.perf_counter()
    step()
    step_s = time.perf_counter() - start_s
    with profile(activities=[ProfilerActivity.CPU]) as profiler:
        step()
    shares = dict.fromkeys([*GROUPS, "the rest"], 0.0)
    rows = profiler.key_averages()
    total = sum(row.self_cpu_time_total for row in rows)
    for row in rows:
        group = next((g for g, words in GROUPS.items() if any(w in row.key for w in words)), None)
        shares[group or "the rest"] += row.self_cpu_time_total / total
    gflop = counter.get_total_flops() / 1e9
    return {
        "precision": precision,
        "gflop": gflop,
        "step_s": step_s,
        "gflops": gflop / step_s,
        "shares": shares,
    }


def main() -> None:
    """Run all measurements and write the result."""
    parser = program(__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("--former", type=Path)
    parser.add_argument("--steps", type=int, default=8)
    parser.add_argument("--rounds", type=int, default=3)
    arguments = parser.parse_args()
    speed = in_turn(arguments.data, arguments.former, arguments.steps, arguments.rounds)
    step = profiled_step(arguments.data)
    products = machine_peak(torch.get_num_threads(), PEAK_S)
    peak = {
        name: 2 * rate  # a multiply-add is two operations
        for name, kind in (("fp32", "float32"), ("bf16", "bfloat16"))
        if (rate := products[kind]) is not None
    }
    shares_of_peak = {f"share_of_{name}_peak": step["gflops"] / peak[name] for name in peak}
    result = {
        "machine": machine(),
        "cores": os.cpu_count(),
        "instructions": torch.backends.cpu.get_cpu_capability(),
        "torch": torch.__version__,
        "speed": speed,
        "peak_gflops": peak,
        "step": step | shares_of_peak,
    }
    finish(result, arguments.result)


if __name__ == "__main__":
    main()
