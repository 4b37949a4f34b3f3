"""Simulate scenes in several processes, which end with the main process in any case.

The renderer is imported only in these processes, which saves memory in the main process.
"""

from __future__ import annotations

import contextlib
import logging
import multiprocessing
import multiprocessing.connection
import os
import signal
import threading
from collections.abc import Generator, Iterator
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from typing import TYPE_CHECKING, Any

from perceptree.errors import DatasetError
from perceptree.simulator.dataset.scene_job import SceneJob, draw_scene
from perceptree.simulator.kernel_cache import is_compiled
from perceptree.simulator.photographs.folder import PhotoFolder

if TYPE_CHECKING:
    from perceptree.simulator.dataset.frames import Assets

_log = logging.getLogger(__name__)
_TELL_S = 0.5

_assets: Assets | None = None
_drawn: Any = None  # counts the frames of all processes


def draw_scenes(jobs: list[SceneJob], workers: int) -> Generator[int]:
    """Simulate scenes and write their files.

    Args:
        jobs: The scenes.
        workers: Maximum number of processes.

    Yields:
        Number of frames that were drawn since it was told last, twice a second.

    Raises:
        OSError: If a file cannot be written.
        DatasetError: If a process is killed.
    """
    if not jobs:
        return
    if not is_compiled():
        _log.warning(
            "the renderer is compiled before the first frame: one to two minutes, and only the"
            " first time on this machine"
        )
    context = multiprocessing.get_context("spawn")
    ended, running = context.Pipe(duplex=False)
    count = min(workers, len(jobs))
    drawn, told = context.Value("q", 0), 0
    start = (ended, jobs[0].plan.photographs, drawn)
    with ended, running, ProcessPoolExecutor(count, context, _start_worker, start) as pool:
        try:
            with _interrupts_held():
                pending = {pool.submit(_draw, job) for job in jobs}
            while pending:
                done, pending = wait(pending, _TELL_S, FIRST_COMPLETED)
                for scene in done:
                    scene.result()
                now = drawn.value
                yield now - told
                told = now
        except BrokenProcessPool as error:
            raise DatasetError(
                f"{jobs[0].directory}: a simulating process was killed, perhaps for lack of memory;"
                " finished scenes are kept: run the same command again to resume, with fewer"
                " --workers if it happens again"
            ) from error
        except BaseException:
            running.close()  # ends the processes, which need not finish their scenes
            raise
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


@contextlib.contextmanager
def _interrupts_held() -> Iterator[None]:
    """Block Ctrl-C here and in processes started in the block, until they can handle it."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _start_worker(
    ended: multiprocessing.connection.Connection, photographs: PhotoFolder | None, drawn: Any
) -> None:
    threading.Thread(target=_end_with_parent, args=(ended,), daemon=True).start()

    import cv2
    import numba

    from perceptree.simulator.dataset.frames import make_assets

    global _assets, _drawn  # one set of textures per process
    _drawn = drawn
    if signal.getsignal(signal.SIGINT) != signal.SIG_IGN:  # as in a shell's background jobs
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    numba.set_num_threads(1)
    cv2.setNumThreads(1)
    _assets = make_assets(photographs)


def _end_with_parent(ended: multiprocessing.connection.Connection) -> None:
    """End this process when its parent process closes the pipe or ends, even if it was killed."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    multiprocessing.connection.wait([parent.sentinel, ended])
    os._exit(1)


def _draw(job: SceneJob) -> int:
    assert _assets is not None
    return draw_scene(job, _assets, _count_frame)


def _count_frame() -> None:
    with _drawn.get_lock():
        _drawn.value += 1
