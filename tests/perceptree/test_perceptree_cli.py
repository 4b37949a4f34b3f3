"""The perceptree command line: JSON output, errors in one line, next steps."""

import json
import signal
import subprocess
import sys
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path

import pytest

Result = tuple[int, str, str]
Call = Callable[..., Result]


def test_train_and_eval_print_one_object_and_agree(call: Call, posts: Path, tmp_path: Path) -> None:
    size = ("--height", 64, "--width", 128)
    out = tmp_path / "run"
    code, printed, told = call("train", posts, "--out", out, *size, "--steps", 2, "--json")
    assert (code, told) == (0, "")
    report = json.loads(printed)
    assert report["steps"] == 2
    assert report["checkpoint"] == str(out / "best.safetensors")
    code, printed, told = call("eval", report["checkpoint"], posts, "--split", "val", "--json")
    assert (code, told) == (0, "")
    figures, val = json.loads(printed), report["val"]
    assert figures["average_precision"]["boxes"]["ap"] == pytest.approx(val["box_ap"], abs=1e-3)
    assert figures["data"]["trees"] == val["trees"]
    code, printed, _ = call("eval", report["checkpoint"], posts, "--split", "val")
    assert code == 0
    assert "3 frames, 4 trees" in printed
    assert "AP50" in printed


@pytest.mark.parametrize("words", [(), ("data",)])
def test_without_a_command_it_shows_the_help(call: Call, words: tuple[str, ...]) -> None:
    shown = call(*words)
    assert shown == call(*words, "--help")
    assert shown[0] == 0


@pytest.mark.parametrize(
    "words",
    [
        ("train", "{}/none", "--out", "{}/run"),
        ("train", "{}", "--out", "{}/run", "--modality", "x"),
        ("train", "{}", "--out", "{}/run", "--init", "{}/none"),
        ("import", "{}/none.pth"),
    ],
)
def test_invalid_options_are_rejected_before_torch_is_loaded(
    tmp_path: Path, words: tuple[str, ...]
) -> None:
    script = (
        "import sys\nfrom perceptree.cli import main\ntry:\n    main()\n"
        "except SystemExit as end:\n    assert end.code == 2\nassert 'torch' not in sys.modules\n"
    )
    filled = [word.format(tmp_path) for word in words]
    done = subprocess.run([sys.executable, "-c", script, *filled], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "")
    assert done.stderr.count("\n") == 1


def test_the_version_is_printed(call: Call) -> None:
    assert call("--version") == (0, f"perceptree {version('edgetree')}\n", "")


def test_an_unknown_option_is_one_line_with_a_hint(call: Call) -> None:
    code, printed, told = call("train", "--nope")
    assert (code, printed, told.count("\n")) == (2, "", 1)
    assert "No such option: --nope" in told
    assert "see `perceptree train --help`" in told


def test_an_interrupted_training_says_how_to_continue(
    call: Call, posts: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from perceptree.commands import train as command

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(command.TrainingBar, "__call__", interrupt)
    size = ("--height", 64, "--width", 128)
    code, printed, told = call("train", posts, "--out", tmp_path / "run", *size, "--steps", 3)
    assert (code, printed) == (130, "")
    assert told == "perceptree: interrupted; run the same command again to resume\n"
    assert (tmp_path / "run/state.pt").is_file()


def test_a_terminated_training_saves_its_state(
    call: Call, posts: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from perceptree.commands import train as command

    def terminate(*_: object) -> None:
        signal.raise_signal(signal.SIGTERM)

    monkeypatch.setattr(command.TrainingBar, "__call__", terminate)
    size = ("--height", 64, "--width", 128, "--no-masks", "--no-keypoints")
    out = tmp_path / "run"
    code, printed, told = call("train", posts, "--out", out, *size, "--steps", 3)
    assert (code, printed) == (143, "")
    assert told == "perceptree: interrupted; run the same command again to resume\n"
    assert (out / "state.pt").is_file()
    assert not list(out.glob(".*"))
    assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL


MISTAKES = {
    "no dataset": (("train", "{}/none", "--out", "{}/run"), "none: no such file or folder"),
    "modality": (("train", "{}", "--out", "{}/run", "--modality", "x"), "--modality is 'x'"),
    "size": (("train", "{}", "--out", "{}/run", "--height", 20), "expected 32 to 8192 px"),
    "two ends": (
        ("train", "{}", "--out", "{}/run", "--steps", 3, "--minutes", 1),
        "expected exactly one",
    ),
    "scene's folder": (
        ("scene", "--out", "{}/train_RGB.json/x.glb"),
        "x.glb: cannot create its folder",
    ),
    "batch": (("train", "{}", "--out", "{}/run", "--batch", 0), "batch is 0"),
    "no checkpoint": (("eval", "{}/no.safetensors", "{}"), "no.safetensors: no such file"),
    "not a checkpoint": (
        ("eval", "{}/train_RGB.json", "{}"),
        "train_RGB.json: not a readable safetensors file",
    ),
    "split": (("eval", "{}/x", "{}", "--split", "spring"), "--split is 'spring'"),
    "option": (("train", "{}", "--speed", "9"), "--speed"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_an_error_is_one_line_and_exit_code_2(call: Call, posts: Path, mistake: str) -> None:
    arguments, expected = MISTAKES[mistake]
    code, printed, told = call(*(str(part).replace("{}", str(posts)) for part in arguments))
    assert (code, printed) == (2, "")
    assert told.startswith("perceptree: ")
    assert told.count("\n") == 1
    assert expected in told


def test_the_help_does_not_load_torch() -> None:
    code = "import sys, perceptree.cli\nassert 'torch' not in sys.modules, 'torch is loaded'"
    subprocess.run([sys.executable, "-c", code], check=True, cwd=Path(__file__).parents[2])
