"""Fault injection: what killed, ended and starved commands leave behind, and what is lost.

python -m benchmarks.faults --result benchmarks/results/faults.json

Each command first runs undisturbed. Then it runs with a fault, and afterwards once more without:

- killed: SIGKILL at a random moment;
- ended: SIGTERM at a random moment; it must end by itself, without temporary files;
- disk full: its folder is on a file system with too little room, of a random size; it must end
  with one line and an exit code that is not 0. Needs the right to mount tmpfs (Linux, root);
- clock jumps: each reading of the wall clock is up to a year off, in either direction.

After a fault, every result that has its final name must be whole: equal to the undisturbed one,
or for a checkpoint, complete.
After the repetition all results must be equal, and no temporary file may be left. States and logs
of trainings, which grow, are only used for the repetition. Prints a table in Markdown; outcomes are
added to the result file.
"""

from __future__ import annotations

import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path

from basetree.errors import InputError
from basetree.files.writing import write_text
from benchmarks.tools.program import program, read_record
from edgetree import sample_frames
from perceptree.models import TreeRCNN, load_checkpoint, make_spec, save_checkpoint

SAMPLES = 4
DISK = "256m"
RUNNING_S = 1800
GROWING = re.compile(
    r"(state\.pt|log\.jsonl|tfevents\S*|progress\S*|\.frame-cache/.*"
    r"|[^/]+\.\d+\.(jsonl|csv|geojson)|unfinished_[^/]+)$"  # of runs of `edgetree live` before
)
TEMPORARY = re.compile(r"/?\.[^/]*\.part(/|$)")
# Also inside the header of a checkpoint: JSON in JSON, padded with spaces.
TIMES = re.compile(
    rb'\\?"(detect_ms|elapsed_s|frames_per_s|waiting_share|age_s)\\?": [0-9.e+-]+'
    rb'|"stages_ms": {[^}]*}|(?<=}) +'
)
HEADER_BYTES = 8  # of the length of a checkpoint's header
JUMPING_CLOCK = """import random, time
_now, _year = time.time, 365 * 86400
time.time = lambda: _now() + random.uniform(-_year, _year)
"""


@dataclass(frozen=True)
class Job:
    """A command to disturb: its arguments for an output folder, and the number of trials."""

    name: str
    arguments: Callable[[Path], list[str]]
    trials: int


@dataclass
class Outcome:
    """What happened in all trials of one command with one fault."""

    command: str
    fault: str
    trials: int = 0
    finished_before: int = 0
    left_temporary: int = 0
    faults: list[str] = field(default_factory=list)

    def row(self) -> str:
        """A row of the table in Markdown."""
        lost = "; ".join(sorted(set(self.faults))) or "nothing"
        finished = "-" if self.fault == "clock jumps" else self.finished_before
        return (
            f"| `{self.command}` | {self.fault} | {self.trials} | {finished} |"
            f" {self.left_temporary} | {lost} |"
        )


def results_of(folder: Path) -> dict[str, bytes]:
    """The content of all results in a folder by name, without times and without temporary files."""
    found = {}
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        if path.is_file() and not GROWING.search(name) and not TEMPORARY.search(name):
            skipped = HEADER_BYTES if path.suffix == ".safetensors" else 0
            found[name] = TIMES.sub(b"", path.read_bytes()[skipped:])
    return found


def is_whole(path: Path, content: bytes, expected: bytes | None) -> bool:
    """Whether a result is complete; a checkpoint may also be of an earlier step.

    Lines that `edgetree live` writes as they come may be fewer.
    """
    if content == expected:
        return True
    if path.parent.name == "live":
        whole_lines = content[: content.rfind(b"\n") + 1]
        return (expected or b"").startswith(whole_lines)
    if path.suffix != ".safetensors":
        return False
    try:
        load_checkpoint(path)
    except InputError:
        return False
    return True


def temporary_in(folder: Path) -> list[str]:
    """Names of the temporary files in a folder."""
    return [path.name for path in folder.rglob("*") if TEMPORARY.search(path.name)]


def start(arguments: list[str], extra_path: Path | None = None) -> subprocess.Popen[str]:
    """Start a command in a process group of its own."""
    paths = [str(extra_path or ""), os.environ.get("PYTHONPATH", "")]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, paths))}
    return subprocess.Popen(
        [sys.executable, "-m", *arguments],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
        start_new_session=True,
    )


def finish(process: subprocess.Popen[str]) -> tuple[int, str]:
    """Wait for a command; its exit code and what it printed to stderr."""
    _, said = process.communicate(timeout=RUNNING_S)
    return process.returncode, said


def signalled(job: Job, out: Path, number: signal.Signals, after_s: float) -> tuple[bool, str]:
    """Run with a signal after some seconds; whether it had ended before, and what was wrong."""
    process = start(job.arguments(out))
    try:
        process.communicate(timeout=after_s)
        return True, ""
    except subprocess.TimeoutExpired:
        pass
    if number == signal.SIGKILL:
        os.killpg(process.pid, number)
        process.communicate()
        return False, ""
    process.send_signal(number)
    code, said = finish(process)
    if "Traceback" in said:
        return False, "a traceback"
    # Python itself ends by the signal until the command line has started.
    return code == 0, "" if code in (0, 128 + number, -number) else f"exit code {code}"


def starved(job: Job, out: Path, room: float) -> tuple[bool, str]:
    """Run with a share of the room that it needs; whether that was enough, and what was wrong."""
    ballast = out / "ballast"
    free = shutil.disk_usage(out).free
    with ballast.open("wb") as file:
        file.truncate(0)
        os.posix_fallocate(file.fileno(), 0, max(1, free - int(room)))
    code, said = finish(start(job.arguments(out / "out")))
    ballast.unlink()
    lines = [line for line in said.splitlines() if "no space left" in line.lower()]
    if code == 0:
        return True, ""
    if "Traceback" in said:
        return False, "a traceback"
    return False, "" if lines else f"no line about the disk, but {said.strip()[-200:]!r}"


def disturbed(
    job: Job, fault: str, whole: dict[str, bytes], took_s: float, rng: random.Random
) -> Outcome:
    """Run all trials of one command with one fault."""
    outcome = Outcome(job.name, fault)
    for _ in range(job.trials):
        outcome.trials += 1
        with folder_for(fault) as folder:
            out = folder / "out"
            if fault == "clock jumps":
                (folder / "clock").mkdir()
                (folder / "clock/sitecustomize.py").write_text(JUMPING_CLOCK)
                code, said = finish(start(job.arguments(out), folder / "clock"))
                ended, wrong = True, "" if code == 0 else said.strip()[-200:]
            elif fault == "disk full":
                needed = sum(map(len, whole.values()))
                ended, wrong = starved(job, folder, needed * rng.uniform(0.02, 1.0))
            else:
                number = signal.SIGKILL if fault == "killed" else signal.SIGTERM
                ended, wrong = signalled(job, out, number, took_s * rng.uniform(0.05, 1.0))
            outcome.finished_before += ended
            outcome.faults += [wrong] if wrong else []
            outcome.faults += after_fault(job, fault, out, whole, outcome)
    return outcome


def after_fault(
    job: Job, fault: str, out: Path, whole: dict[str, bytes], outcome: Outcome
) -> Iterator[str]:
    """Check what is there after a fault and after a repetition; yields what is wrong."""
    for name, content in results_of(out).items():
        if fault != "ended" and not is_whole(out / name, content, whole.get(name)):
            yield f"{name} is not whole"
    left = temporary_in(out)
    outcome.left_temporary += bool(left)
    if left and fault != "killed":
        yield "temporary files are left"
    code, said = finish(start(job.arguments(out)))
    again = results_of(out)
    if code:
        yield f"the repetition failed: {said.strip()[-200:]}"
    elif again != whole:
        differing = [name for name in whole | again if whole.get(name) != again.get(name)]
        yield f"other results after the repetition: {', '.join(differing[:3])}"
    if temporary_in(out):
        yield "temporary files are left after the repetition"


@contextmanager
def folder_for(fault: str) -> Iterator[Path]:
    """A new folder; for a full disk with a small file system of its own."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if fault != "disk full":
            yield folder
            return
        subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={DISK}", "none", name], check=True)
        try:
            yield folder
        finally:
            subprocess.run(["umount", "--lazy", name], check=True)


def can_mount() -> bool:
    """Whether this process may mount a file system."""
    try:
        with folder_for("disk full"):
            return True
    except (OSError, subprocess.CalledProcessError):
        return False


def jobs(folder: Path, share: float) -> list[Job]:
    """The commands to disturb, with their inputs in a folder."""
    for kind in ("images", "depth"):
        (folder / kind).mkdir()
    for sample in sample_frames()[:SAMPLES]:
        shutil.copy(sample.image_path, folder / "images")
        shutil.copy(sample.depth_path, folder / "depth" / f"{sample.name}.png")
    camera = {"schema": "calib.camera/1", **sample_frames()[0].camera.to_dict()}
    (folder / "camera.json").write_text(json.dumps(camera))
    spec = make_spec("edge-n", "rgb", 96, 160, fpn_width=16, box_head_width=16)
    save_checkpoint(folder / "small.safetensors", TreeRCNN(spec), {"steps": 0})
    frames = ["--frames", "6", "--width", "160", "--height", "96", "--views", "2", "--seed", "3"]
    synth = ["perceptree", "synth", "--preset", "plain", "--workers", "1", *frames, "--out"]
    data = folder / "data"
    subprocess.run([sys.executable, "-m", *synth, str(data)], check=True, capture_output=True)
    train = ["--height", "96", "--width", "160", "--batch", "2", "--workers", "1", "--modality"]
    train += ["rgb", "--steps", "8", "--evaluate-every", "4", "--cache", str(folder / "cache")]

    def run(out: Path) -> list[str]:
        files = [f"--{kind}={out / 'trees'}.{kind}" for kind in ("jsonl", "csv", "coco")]
        depth = ["--depth", str(folder / "depth"), "--camera", str(folder / "camera.json")]
        frames = str(folder / "images")
        return ["edgetree", "run", frames, "--model=depth", *depth, *files, f"--out={out}/drawn"]

    def live(out: Path) -> list[str]:
        (out / "live").mkdir(parents=True, exist_ok=True)
        files = [f"--{name}={out / 'live/stems'}.{name}" for name in ("jsonl", "csv")]
        depth = ["--depth", str(folder / "depth"), "--camera", str(folder / "camera.json")]
        stems = f"--map={out / 'stems.geojson'}"
        return ["edgetree", "live", str(folder / "images"), *depth, *files, stems]

    def export(out: Path) -> list[str]:
        given = [str(folder / "small.safetensors"), "--data", str(folder / "images")]
        return ["edgetree", "export", *given, "--out", str(out / "model.onnx")]

    found = [
        Job("edgetree run", run, 20),
        Job("edgetree live", live, 20),
        Job("edgetree export", export, 8),
        Job("perceptree synth", lambda out: [*synth, str(out)], 12),
        Job(
            "perceptree train",
            lambda out: ["perceptree", "train", str(data), *train, "--out", str(out)],
            10,
        ),
    ]
    return [Job(job.name, job.arguments, max(1, round(job.trials * share))) for job in found]


def show(line: str) -> None:
    """Print a line at once."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def main() -> None:
    """Disturb all commands, print the table, and optionally write the results to a file."""
    parser = program(__doc__)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--share", type=float, default=1.0, help="share of the trials to make")
    parser.add_argument(
        "--only", help="part of a command and its fault, such as 'synth, disk full'"
    )
    options = parser.parse_args()
    faults = ["killed", "ended", *["disk full"] * can_mount(), "clock jumps"]
    record = read_record(options.result)
    show("| command | fault | trials | of them ended before | left temporary files | lost |")
    show("| --- | --- | --- | --- | --- | --- |")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for job in jobs(folder, options.share):
            wanted = [f for f in faults if (options.only or "") in f"{job.name}, {f}"]
            if not wanted:
                continue
            before = time.perf_counter()
            code, said = finish(start(job.arguments(folder / job.name)))
            took_s = time.perf_counter() - before
            if code:
                sys.exit(f"{job.name} failed undisturbed: {said}")
            whole = results_of(folder / job.name)
            for fault in wanted:
                rng = random.Random(f"{options.seed} {job.name} {fault}")
                outcome = disturbed(job, fault, whole, took_s, rng)
                show(outcome.row())
                record[f"{job.name}, {fault}"] = {"seed": options.seed, **asdict(outcome)}
                if options.result:
                    write_text(options.result, json.dumps(record, indent=1) + "\n")
    sys.exit(any(outcome["faults"] for outcome in record.values()))


if __name__ == "__main__":
    main()
