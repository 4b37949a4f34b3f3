"""Make a shipped model again, from nothing: frames, trainings, scores, file and card.

python -m release.make edge-s-depth --work /data/models
python -m release.make edge-n-rgb --work /data/models --textures PHOTOGRAPHS
python -m release.make edge-s-depth --dry-run
python -m release.make edge-s-depth --work /tmp/try --small

`recipes/NAME.sh` holds the commands of each model, one a line, with what is known of how it was
made. They run in the folder --work, each is printed as it starts, and a command that has ended well
is not run again: the same call goes on after an interruption. `WORK/NAME.done` lists those
commands; from a line that was changed on, all are run again. Remove the folders of their runs
before: a training goes on from the state that it finds, or refuses it.

--dry-run prints the commands. --small tries them out in minutes: a few small frames, two steps a
training at hardly any rate, which begins with the repository's weights where it would begin with
none, and a float32 file. --device cpu trains without a GPU, for days.
"""

from __future__ import annotations

import os
import shlex
import string
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from basetree.files.writing import write_text
from benchmarks.tools.program import command_line

ROOT = Path(__file__).resolve().parents[1]
RECIPES = Path(__file__).parent / "recipes"
FOLDERS = ("models", "checkpoints")
MAKE = ["python", "-m", "release.make"]
SYNTH, TRAIN, EXPORT = ("perceptree", "synth"), ("perceptree", "train"), ("edgetree", "export")
SCALE = ("perceptree", "calibrate-scores")
SMALL: Mapping[tuple[str, ...], Mapping[str, str]] = {
    SYNTH: {"--frames": "6", "--views": "2", "--width": "640", "--height": "360"},
    TRAIN: {"--steps": "2", "--batch": "4", "--learning-rate": "1e-6", "--workers": "0"},
    EXPORT: {"--precision": "fp32"},
}
# A frozen test set has no smaller form: its mix, with all frames in the split `test`.
FROZEN = {"test": ("paper", "44"), "field-test": ("field", "45")}

Words = list[str]


class RecipeError(Exception):
    """A recipe cannot be read; the message says what was expected."""


def names() -> list[str]:
    """Names of the recipes."""
    return sorted(path.stem for path in RECIPES.glob("*.sh"))


def read_recipe(name: str, values: Mapping[str, str]) -> list[Words]:
    """The commands of a recipe, each as its words.

    Args:
        name: Name of the recipe.
        values: What the names `$RECIPES` and `$TEXTURES` stand for.

    Raises:
        RecipeError: There is no such recipe, or a name stands for nothing.
    """
    path = RECIPES / f"{name}.sh"
    if not path.is_file():
        raise RecipeError(f"no recipe is called {name!r}: expected one of {', '.join(names())}")
    lines = path.read_text("utf-8").replace("\\\n", " ").splitlines()
    try:
        return [
            words
            for line in lines
            if (words := shlex.split(string.Template(line).substitute(values), comments=True))
        ]
    except KeyError as error:
        option = f"--{error.args[0].lower()}"
        raise RecipeError(f"{name} needs {option}: expected a folder") from error


def with_options(words: Words, options: Mapping[str, str]) -> Words:
    """A command with options changed, or added if it does not have them."""
    changed = list(words)
    for option, value in options.items():
        if option in changed:
            changed[changed.index(option) + 1] = value
        else:
            changed += [option, value]
    return changed


def without_gpu(words: Words) -> Words:
    """A command that trains on the processor."""
    if words[:3] == MAKE:
        return [*words, "--device", "cpu"]
    if "--device" not in words:
        return words
    return with_options(words, {"--device": "cpu", "--precision": "auto"})


def small(words: Words) -> Words:
    """A command for a few frames and steps."""
    if words[:3] == MAKE:
        return [*words, "--small"]
    kind = tuple(words[:2])
    if kind == SCALE:  # too few detections to fit a scale to: the same scores
        return ["perceptree", "average", words[2], words[2], *words[-2:]]
    options = dict(SMALL.get(kind, {}))
    preset = words[words.index("--preset") + 1] if kind == SYNTH else ""
    if preset in FROZEN:
        mix, seed = FROZEN[preset]
        options |= {"--preset": mix, "--seed": seed, "--settings": str(RECIPES / "only-test.json")}
    if kind == TRAIN and "--branch" in words:
        # The repository's weights need not have the settings of today's presets.
        options["--init"] = f"{words[words.index('--branch') + 1]}/best.safetensors"
    elif kind == TRAIN and ("--init" not in words or "imagenet" in words):
        modality = "rgb" if "rgb" in words else "depth"
        options["--init"] = str(ROOT / "checkpoints" / f"edge-n-{modality}.safetensors")
    return without_gpu(with_options(words, options))


def executable(words: Words) -> Words:
    """The command line that runs a command with this Python."""
    module = words[2:] if words[0] == "python" else words
    return [sys.executable, "-m", *module]


def done_before(commands: Sequence[Words], record: Path) -> int:
    """How many of the first commands have ended well in an earlier call."""
    lines = record.read_text("utf-8").splitlines() if record.is_file() else []
    count = 0
    for words, line in zip(commands, lines, strict=False):
        if shlex.join(words) != line:
            break
        count += 1
    return count


def make(name: str, commands: Sequence[Words], work: Path) -> int:
    """Run the commands that have not been run; returns the exit code of the first that fails."""
    for folder in FOLDERS:
        (work / folder).mkdir(parents=True, exist_ok=True)
    record = work / f"{name}.done"
    paths = [str(ROOT), os.environ.get("PYTHONPATH", "")]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, paths))}
    first = done_before(commands, record)
    for number, words in enumerate(commands):
        if number < first:
            continue
        tell(f"{name}, {number + 1} of {len(commands)}: {shlex.join(words)}")
        ended = subprocess.run(executable(words), cwd=work, env=environment, check=False)
        if ended.returncode:
            tell(f"{name}: the command ended with exit code {ended.returncode}")
            return ended.returncode
        done = [shlex.join(each) for each in commands[: number + 1]]
        write_text(record, "".join(f"{line}\n" for line in done))
    tell(f"{name}: made in {work}, {first} of {len(commands)} commands before this call")
    return 0


def tell(line: str) -> None:
    """Print a line at once, before what the next command prints."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def main() -> None:
    """Make a model, or print how."""
    parser = command_line(__doc__)
    parser.add_argument("name", choices=names(), metavar="NAME", help=", ".join(names()))
    parser.add_argument("--work", type=Path, default=Path(), help="folder to work in; default: .")
    parser.add_argument("--textures", type=Path, help="folder of photographs, for colour")
    parser.add_argument("--device", choices=("cpu", "cuda"), default="cuda", help="of trainings")
    parser.add_argument("--dry-run", action="store_true", help="print the commands")
    parser.add_argument("--small", action="store_true", help="a few frames and steps")
    options = parser.parse_args()
    values = {"RECIPES": str(RECIPES)}
    textures = options.textures or os.environ.get("TEXTURES")
    if textures:
        # Recipes that this one makes first take it from there.
        os.environ["TEXTURES"] = values["TEXTURES"] = str(Path(textures).absolute())
    elif options.dry_run:
        values["TEXTURES"] = "TEXTURES"
    try:
        commands = read_recipe(options.name, values)
    except RecipeError as error:
        parser.error(str(error))
    if options.device == "cpu":
        commands = [without_gpu(words) for words in commands]
    if options.small:
        commands = [small(words) for words in commands]
    if options.dry_run:
        for words in commands:
            tell(shlex.join(words))
        return
    sys.exit(make(options.name, commands, options.work.absolute()))


if __name__ == "__main__":
    main()
