"""Entry point of `edgetree`, `python -m edgetree`."""

import sys
from typing import NoReturn

from basetree.program.interrupts import interrupt_afterwards

__all__: list[str] = []


def main() -> NoReturn:
    """Import the command line and run it; Ctrl-C during the import ends it in one line, too."""
    try:
        with interrupt_afterwards():
            from edgetree.cli import main as run
    except KeyboardInterrupt:
        sys.stderr.write("edgetree: interrupted\n")
        sys.exit(130)
    run()


if __name__ == "__main__":
    main()
