"""Feed mutated files to every reader, in a process that may die.

    python tests/fuzz/fuzzing.py 100000     # cases; a second number is the seed, 0 by default

Each case starts from a seed of one format: a small valid file, or a file of ``corpus``. A reader
may return, or raise an error that is meant for the user. Anything else is a finding: another error,
more than 5 s of processor time, or more than 1 GiB of memory asked for, used or not. The file of a
finding is written to ``corpus``, whose files are read in every run. The formats are in ``formats``.

Memory is measured and not limited: a reader would take a refused request for a broken file.
Requests that the system refuses are counted too, where numpy or OpenCV make them.
"""

from __future__ import annotations

import hashlib
import multiprocessing
import os
import random
import resource
import sys
import tempfile
import time
from collections.abc import Iterator
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from formats import FORMATS

from basetree.errors import EdgetreeError, InputError

CORPUS = Path(__file__).with_name("corpus")
_LONGEST_S, _LARGEST_BYTES = 5, 2**30
_LONGEST_WAIT_S = 120  # for an answer, of a busy machine too
_ALLOWED = (InputError, EdgetreeError, InputError)
_PAGE_BYTES = resource.getpagesize()
_MOST_USED_BYTES = 2 * _LARGEST_BYTES  # a process that uses more is ended at once
_SHORT_WAIT_S = 0.02
_TOKENS = (
    *(b"0", b"-1", b"1e300", b"1e-300", b"nan", b"inf", b"9" * 400, b"0x" + b"f" * 30, b"null"),
    *(b"[", b"]", b"{", b"}", b"<a>", b"</a>", b"&a ", b"*a", b"<<: ", b"!!int ", b"!!float "),
    *(b"? ", b"- ", b": ", b"\n---\n", b"\0", b'"', b"'", b"\\ud800", b"\xff\xff\xff\xff", b"\x80"),
)


class Finding(NamedTuple):
    """A file that a reader did not bear, and what happened."""

    format: str
    data: bytes
    problem: str


def mutated(data: bytes, rng: random.Random) -> bytes:
    """Change a file in one to four places."""
    content = bytearray(data)
    for _ in range(rng.randint(1, 4)):
        at = rng.randrange(len(content) + 1)
        end = min(len(content), at + rng.choice((0, 1, 1, 2, 8, 64)))
        how = rng.randrange(6)
        if how == 0 and at < len(content):
            content[at] ^= 1 << rng.randrange(8)
        elif how == 1:
            del content[at:]
        elif how == 2:
            content[at:end] = content[at:end] * rng.choice((2, 3, 50))
        elif how == 3:
            content[at:end] = rng.randbytes(rng.randint(0, 4))
        else:
            content[at:end] = rng.choice(_TOKENS)
    return bytes(content)


def cases(count: int, seed: int) -> Iterator[tuple[str, bytes]]:
    """Yield the corpus unchanged, then mutated files; (format, content)."""
    known = {name: list(form.seeds) for name, form in FORMATS.items()}
    for path in sorted(CORPUS.glob("*.bin")):
        name, data = path.name.split("-")[0], path.read_bytes()
        known[name].append(data)
        yield name, data
    rng = random.Random(seed)
    for _ in range(count):
        name = rng.choice(list(FORMATS))
        yield name, mutated(rng.choice(known[name]), rng)


def problem_of(name: str, data: bytes, folder: Path) -> str:
    """Read one file; return what went wrong, or an empty text."""
    path = folder / f"file-{name}"
    path.write_bytes(data)
    try:
        FORMATS[name].read(path)
    except _ALLOWED as error:
        return "a message of several lines" if "\n" in str(error) else ""
    except UnicodeDecodeError:
        return "" if name == "manifest" else "UnicodeDecodeError"
    except Exception as error:  # noqa: BLE001 - the finding
        return f"{type(error).__name__}: {error}"[:300]
    return ""


def _asked_bytes() -> int:
    """The largest size that this process has had, with memory that it never used."""
    with open("/proc/self/status", encoding="ascii") as status:
        line = next(line for line in status if line.startswith("VmPeak"))
    return int(line.split()[1]) * 1024


def _size_bytes(process: str = "self", field: int = 0) -> int:
    """The size of a process (field 0), or what of it is in memory (field 1)."""
    with open(f"/proc/{process}/statm", encoding="ascii") as statm:
        return int(statm.read().split()[field]) * _PAGE_BYTES


def _note_refused_requests(refused: list[str]) -> None:
    """Note the requests for memory that numpy and OpenCV are refused, whoever catches the error."""
    kind = np._core._exceptions._ArrayMemoryError
    begin = kind.__init__

    def noted(error: MemoryError, shape: tuple[int, ...], dtype: np.dtype[np.generic]) -> None:
        refused.append(f"an array of {shape} {dtype}")
        begin(error, shape, dtype)

    def on_error(code: int, function: str, message: str, *_: object) -> None:
        if code == cv2.Error.StsNoMem:
            refused.append(message)

    kind.__init__ = noted
    cv2.redirectError(on_error)


def _work(pipe: Connection) -> None:
    """Read files until told to stop, and measure the memory that each asks for."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # libraries print what they find wrong
    refused: list[str] = []
    _note_refused_requests(refused)
    with tempfile.TemporaryDirectory() as folder:
        while (case := pipe.recv()) is not None:
            used_s = int(sum(resource.getrusage(resource.RUSAGE_SELF)[:2]))
            allowed_s = used_s + _LONGEST_S + 1
            resource.setrlimit(resource.RLIMIT_CPU, (allowed_s, resource.RLIM_INFINITY))
            size, largest = _size_bytes(), _asked_bytes()
            problem = problem_of(*case, Path(folder))
            asked = _asked_bytes()
            if asked > largest and asked - size > _LARGEST_BYTES:
                problem = f"memory: {(asked - size) >> 20} MiB asked for"
            elif refused:
                problem = f"memory: refused {refused[0]}"
            pipe.send(problem)


def _answer(pipe: Connection, worker: BaseProcess) -> str:
    """Wait for a worker's answer; end one that uses too much memory or does not answer.

    Raises:
        EOFError: If it has ended.
    """
    largest = _size_bytes(str(worker.pid), 1) + _MOST_USED_BYTES
    until = time.monotonic() + _LONGEST_WAIT_S
    while not pipe.poll(_SHORT_WAIT_S):
        if worker.is_alive() and _size_bytes(str(worker.pid), 1) > largest:
            worker.kill()
            return f"memory: more than {_MOST_USED_BYTES >> 20} MiB used"
        if time.monotonic() > until:
            worker.kill()
            return f"no answer in {_LONGEST_WAIT_S} s"
    return str(pipe.recv())


def fuzz(count: int, seed: int = 0) -> list[Finding]:
    """Read the corpus and ``count`` mutated files; return the findings.

    The workers are forks. Call it in a process of its own: a fork of a process with threads may
    wait for ever for a lock that one of them held.
    """
    context = multiprocessing.get_context("fork")
    findings: list[Finding] = []
    worker = None
    for name, data in cases(count, seed):
        if worker is None:
            pipe, other = context.Pipe()
            worker = context.Process(target=_work, args=(other,), daemon=True)
            worker.start()
            other.close()
        try:
            pipe.send((name, data))
            problem = _answer(pipe, worker)
        except (EOFError, ConnectionError):
            worker.join()
            problem = f"the process ended with {worker.exitcode} (out of time or memory)"
        if problem:
            findings.append(Finding(name, data, problem))
            worker.kill()  # the largest size of a process is never forgotten
            worker.join()
            worker = None
    if worker is not None:
        pipe.send(None)
        worker.join()
    return findings


def main() -> None:
    """Fuzz as the command line says, and keep the files of findings."""
    count, seed = int(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 0
    findings = {finding.problem: finding for finding in fuzz(count, seed)}.values()
    for finding in findings:
        digest = hashlib.sha256(finding.data).hexdigest()[:12]
        path = CORPUS / f"{finding.format}-{digest}.bin"
        path.write_bytes(finding.data)
        print(f"{path.name}: {finding.problem}")
    sys.exit(bool(findings))


if __name__ == "__main__":
    main()
