"""Environments of the peers, one for each, so that their packages and licences stay apart.

python -m benchmarks.peers.environments make [NAME ...] --folder DIR
python -m benchmarks.peers.environments list --folder DIR

`make` installs the pinned packages of requirements/NAME.txt into DIR/env-NAME, with pip; without
names, those of all peers. An environment that is complete is kept.
"""

from __future__ import annotations

import subprocess
import sys
import venv
from pathlib import Path

from benchmarks.tools.program import command_line

REQUIREMENTS = Path(__file__).parent / "requirements"
DEVELOPMENT = "development"  # the environment that runs this program


def names() -> list[str]:
    """Names of the peers' environments."""
    return sorted(path.stem for path in REQUIREMENTS.glob("*.txt"))


def packages() -> dict[str, list[str]]:
    """The pinned packages of each environment."""
    texts = {name: (REQUIREMENTS / f"{name}.txt").read_text(encoding="utf-8") for name in names()}
    return {
        name: [line for line in text.splitlines() if not line.startswith("#")]
        for name, text in texts.items()
    }


def python_of(name: str, folder: Path) -> Path:
    """The Python of an environment; that of this program for `DEVELOPMENT`."""
    if name == DEVELOPMENT:
        return Path(sys.executable)
    scripts = "Scripts" if sys.platform == "win32" else "bin"
    return folder.absolute() / f"env-{name}" / scripts / "python"


def _stamp(name: str, folder: Path) -> Path:
    return folder / f"env-{name}" / "installed.txt"


def is_complete(name: str, folder: Path) -> bool:
    """Whether an environment holds the packages that its requirements name."""
    stamp = _stamp(name, folder)
    wanted = (REQUIREMENTS / f"{name}.txt").read_text(encoding="utf-8")
    return stamp.is_file() and stamp.read_text(encoding="utf-8") == wanted


def make(name: str, folder: Path) -> None:
    """Make an environment, or bring it up to date with its requirements."""
    requirements = REQUIREMENTS / f"{name}.txt"
    python = python_of(name, folder)
    if not python.exists():
        venv.create(folder / f"env-{name}", with_pip=True)
    command = [str(python), "-m", "pip", "install", "--quiet", "--requirement", str(requirements)]
    subprocess.run(command, check=True)
    _stamp(name, folder).write_text(requirements.read_text(encoding="utf-8"), encoding="utf-8")


def main() -> None:
    """Make or list the environments."""
    parser = command_line(__doc__)
    parser.add_argument("action", choices=("make", "list"))
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(names())}")
    parser.add_argument("--folder", type=Path, required=True, help="folder of the environments")
    arguments = parser.parse_args()
    unknown = set(arguments.names) - set(names())
    if unknown:
        parser.error(
            f"no environment {sorted(unknown)[0]!r}: expected some of {', '.join(names())}"
        )
    for name in arguments.names or names():
        complete = is_complete(name, arguments.folder)
        if arguments.action == "make" and not complete:
            sys.stderr.write(f"making {name}\n")
            make(name, arguments.folder)
            complete = True
        sys.stdout.write(f"{name}: {'complete' if complete else 'missing'}\n")


if __name__ == "__main__":
    main()
