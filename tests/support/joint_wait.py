"""Processes of torchrun of which one works alone for longer than others wait in a step."""

import time
from datetime import timedelta

import perceptree.training.processes as waited_for

STEP_S = 2.0


def wait() -> None:
    """Share what the process of rank 0 has worked at, and meet; raise if one did not wait."""
    waited_for._TIMEOUT = timedelta(seconds=STEP_S)
    with waited_for.process_group("cpu") as processes:
        if processes.is_lead:
            time.sleep(2 * STEP_S)
        found = processes.broadcast({"box_ap": 50.0} if processes.is_lead else None)
        if processes.is_lead:
            time.sleep(2 * STEP_S)
        processes.barrier()
    if found != {"box_ap": 50.0}:
        raise RuntimeError(f"shared {found}")


if __name__ == "__main__":
    wait()
