"""The scripts that update, roll back and change models, with a fake pip and systemctl."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from edgetree import default_model

ROOT = Path(__file__).parents[2]
DEPLOY = ROOT / "deploy"
pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the scripts are for Linux")

# The environments hold a program edgetree that tells its version, and runs this checkout otherwise.
PYTHON3 = """#!/bin/sh
mkdir -p "$3/bin"
cat > "$3/bin/pip" << 'END'
#!/bin/sh
for last; do :; done
basename "$last" >> "$(dirname "$0")/installed"
case "$last" in
*.whl)
    version=$(basename "$last" | cut -d- -f2)
    program="$(dirname "$0")/edgetree"
    printf '#!/bin/sh\\n[ "$1" != doctor ] || exec test %s != 9.9\\n' "$version" > "$program"
    echo 'exec {edgetree} "$@"' >> "$program"
    chmod +x "$(dirname "$0")/edgetree" ;;
esac
END
chmod +x "$3/bin/pip"
"""
# The command line with a machine's folder of its own: as root, `edgetree trust` writes to /etc.
LAUNCHER = """
import sys
from pathlib import Path
import edgetree.signing.trust
edgetree.signing.trust._MACHINE_FOLDER = Path(sys.argv.pop(1))
from edgetree.cli import main
main()
"""
# The service runs unless the version or the model in use is a broken one.
SYSTEMCTL = """#!/bin/sh
echo "$1 $(readlink "$EDGETREE_ROOT/current")" >> "$EDGETREE_ROOT/calls"
[ "$1" != is-active ] || [ "$(readlink "$EDGETREE_ROOT/current")" != 8.8 ]
"""


def launched(root: Path) -> list[str]:
    """What Python runs as the command line on a machine."""
    return [str(root / "launcher.py"), str(root / "etc")]


@pytest.fixture
def machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of an installation, and fakes of what the scripts call."""
    programs, root = tmp_path / "programs", tmp_path / "opt"
    programs.mkdir()
    root.mkdir()
    program = shlex.join([sys.executable, *launched(root)])
    texts = {
        "python3": PYTHON3.replace("{edgetree}", program),
        "systemctl": SYSTEMCTL,
        "id": "#!/bin/sh\nexit 1\n",  # there is no account of the service
    }
    (root / "launcher.py").write_text(LAUNCHER)
    for name, text in texts.items():
        (programs / name).write_text(text)
        (programs / name).chmod(0o755)
    for name, value in {
        "EDGETREE_CONFIG": str(tmp_path / "none.toml"),
        "PATH": f"{programs}:{os.environ['PATH']}",
        "EDGETREE_ROOT": str(root),
        "EDGETREE_WAIT_S": "0",
        "PYTHONPATH": str(ROOT),
        "HOME": str(tmp_path),
        "XDG_CONFIG_HOME": str(tmp_path / "config"),
        "XDG_STATE_HOME": str(tmp_path / "state"),
    }.items():
        monkeypatch.setenv(name, value)
    return root


def bundle(tmp_path: Path, version: str) -> Path:
    folder = tmp_path / f"bundle-{version}"
    (folder / "wheels").mkdir(parents=True)
    (folder / "wheels" / f"edgetree-{version}-py3-none-any.whl").touch()
    (folder / "runtime.txt").touch()
    return folder


def do(script: str, *arguments: Path) -> tuple[int, str]:
    """Exit code, and the last line that it says."""
    done = subprocess.run(
        [DEPLOY / script, *arguments], capture_output=True, text=True, check=False
    )
    return done.returncode, (done.stdout + done.stderr).strip().splitlines()[-1]


def links(root: Path) -> tuple[str, str]:
    return tuple(
        os.readlink(root / name) if (root / name).is_symlink() else "-"
        for name in ("current", "previous")
    )


def test_an_update_can_be_rolled_back(tmp_path: Path, machine: Path) -> None:
    assert do("update.sh", bundle(tmp_path, "0.2.0")) == (
        0,
        "version 0.2.0 is in use; none was before",
    )
    assert do("roll_back.sh")[1].endswith("no version before 0.2.0: expected an update first")
    assert do("update.sh", bundle(tmp_path, "0.3.0"))[0] == 0
    assert links(machine) == ("0.3.0", "0.2.0")
    assert do("roll_back.sh") == (0, "version 0.2.0 is in use; 0.3.0 was before")
    assert links(machine) == ("0.2.0", "0.3.0")
    assert (machine / "calls").read_text().splitlines()[-2:] == ["restart 0.2.0", "is-active 0.2.0"]
    assert do("update.sh", tmp_path / "bundle-0.3.0")[0] == 0  # installed already
    assert links(machine) == ("0.3.0", "0.2.0")


def test_a_version_that_was_installed_by_hand_is_gone_back_to(
    tmp_path: Path, machine: Path
) -> None:
    assert do("update.sh", bundle(tmp_path, "0.2.0"))[0] == 0
    (machine / "0.2.0" / "complete").unlink()  # which only update.sh leaves
    assert do("update.sh", bundle(tmp_path, "0.3.0"))[0] == 0
    assert do("roll_back.sh") == (0, "version 0.2.0 is in use; 0.3.0 was before")


def test_packages_that_cannot_be_installed_are_told(tmp_path: Path, machine: Path) -> None:
    python = tmp_path / "programs" / "python3"
    python.write_text(PYTHON3.replace("for last; do :; done", "exit 1"))
    code, line = do("update.sh", bundle(tmp_path, "0.2.0"))
    assert (code, "runtime.txt cannot be installed: expected wheels for" in line) == (2, True)
    assert line.endswith("; no version stays in use")
    assert links(machine) == ("-", "-")


@pytest.mark.parametrize("script", ["update.sh", "install_model.sh"])
def test_nothing_given_is_told(machine: Path, script: str) -> None:
    code, line = do(script)
    assert (code, f"is given: expected {script}" in line) == (2, True)


def test_a_folder_that_cannot_be_written_is_told(
    tmp_path: Path, machine: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("EDGETREE_ROOT", str(tmp_path / "none"))
    code, line = do("update.sh", bundle(tmp_path, "0.2.0"))
    assert (
        code,
        line.endswith("none cannot be written: expected an existing folder, and sudo"),
    ) == (
        2,
        True,
    )


def test_a_model_that_the_set_up_does_not_name_is_not_changed(
    tmp_path: Path, machine: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = tmp_path / "edgetree.toml"
    monkeypatch.setenv("EDGETREE_CONFIG", str(config))
    config.write_text(f'model = "depth"\n# model = "{machine}/model.onnx"\n')
    code, line = do("install_model.sh", default_model("depth"))
    assert (code, line.endswith(f'expected model = "{machine}/model.onnx" in it')) == (2, True)
    assert not (machine / "model.onnx").exists()
    config.write_text(f'model = "{machine}/model.onnx"\n')
    assert do("install_model.sh", default_model("depth"))[0] == 0


def test_a_model_that_was_copied_by_hand_is_kept(
    tmp_path: Path, machine: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (machine / "model.onnx").write_bytes(b"by hand")
    (tmp_path / "programs" / "systemctl").write_text("#!/bin/sh\nexit 1\n")
    code, line = do("install_model.sh", default_model("depth"))
    assert (code, "runs neither" in line) == (2, True)
    assert (machine / "model.onnx").read_bytes() == b"by hand"


@pytest.mark.parametrize(
    ("version", "line"),
    [
        ("9.9", "update.sh: version 9.9 is not healthy: 0.2.0 stays in use"),
        (
            "8.8",
            "update.sh: the service does not run with version 8.8: went back to 0.2.0, see"
            " journalctl -u edgetree",
        ),
        ("0.2.0", "update.sh: version 0.2.0 is in use already: expected a bundle of another"),
    ],
)
def test_an_update_that_fails_leaves_the_version_in_use(
    tmp_path: Path, machine: Path, version: str, line: str
) -> None:
    first = bundle(tmp_path, "0.2.0")
    assert do("update.sh", first)[0] == 0
    second = first if version == "0.2.0" else bundle(tmp_path, version)
    assert do("update.sh", second) == (2, line)
    assert links(machine) == ("0.2.0", "-")


@pytest.mark.parametrize("version", ["0.3.0", "8.8"])
def test_an_update_whose_connection_ends_is_ended_well(
    tmp_path: Path, machine: Path, version: str
) -> None:
    for number in ("0.1.0", "0.2.0"):
        assert do("update.sh", bundle(tmp_path, number))[0] == 0
    hang_up = SYSTEMCTL.replace("#!/bin/sh", '#!/bin/sh\n[ "$1" != restart ] || kill -HUP "$PPID"')
    (tmp_path / "programs" / "systemctl").write_text(hang_up)
    do("update.sh", bundle(tmp_path, version))
    expected = ("0.3.0", "0.2.0") if version == "0.3.0" else ("0.2.0", "0.1.0")
    assert links(machine) == expected


def test_that_neither_version_runs_is_told(tmp_path: Path, machine: Path) -> None:
    assert do("update.sh", bundle(tmp_path, "0.2.0"))[0] == 0
    (tmp_path / "programs" / "systemctl").write_text("#!/bin/sh\nexit 1\n")
    code, line = do("update.sh", bundle(tmp_path, "0.3.0"))
    assert (code, "neither with version 0.3.0 nor with 0.2.0 again" in line) == (2, True)
    assert links(machine) == ("0.2.0", "-")


def test_the_account_of_the_service_reads_what_is_installed(tmp_path: Path, machine: Path) -> None:
    model = tmp_path / "model.onnx"
    model.write_bytes(default_model("depth").read_bytes())
    model.chmod(0o600)
    for script, given in (("update.sh", bundle(tmp_path, "0.2.0")), ("install_model.sh", model)):
        subprocess.run([DEPLOY / script, given], check=True, umask=0o077, capture_output=True)
    assert (machine / "model.onnx").stat().st_mode & 0o044 == 0o044
    assert (machine / "0.2.0" / "bin").stat().st_mode & 0o055 == 0o055


def test_signatures_are_checked_as_the_account_of_the_service(
    tmp_path: Path, machine: Path
) -> None:
    assert do("update.sh", bundle(tmp_path, "0.2.0"))[0] == 0
    programs = tmp_path / "programs"
    asked = '#!/bin/sh\necho "$@" > "$EDGETREE_ROOT/asked"\nexit 1\n'
    for name, text in {"id": "#!/bin/sh\n", "runuser": asked}.items():
        (programs / name).write_text(text)
        (programs / name).chmod(0o755)
    model = tmp_path / "model.onnx"
    model.touch()
    Path(f"{model}.sig").touch()
    assert do("install_model.sh", model)[1].endswith("is refused: no model stays in use")
    words = (machine / "asked").read_text().split()
    assert words[:2] == ["-u", "edgetree"]
    assert "STATE_DIRECTORY=/var/lib/edgetree" in words
    assert words[-4:-1] == [f"{machine}/current/bin/edgetree", "trust", "--check"]
    (machine / "model.onnx").symlink_to(model)
    code, line = do("update.sh", bundle(tmp_path, "0.3.0"))
    assert (code, line.endswith("refuses the model in use: 0.2.0 stays in use")) == (2, True)


def test_what_an_interrupted_update_left_is_made_anew(tmp_path: Path, machine: Path) -> None:
    (machine / "0.2.0" / "bin").mkdir(parents=True)
    (machine / "0.2.0" / "bin" / "half").touch()
    assert do("update.sh", bundle(tmp_path, "0.2.0"))[0] == 0
    assert not (machine / "0.2.0" / "bin" / "half").exists()
    assert do("update.sh", tmp_path)[0] == 2


def test_the_lists_that_a_bundle_holds_are_installed(tmp_path: Path, machine: Path) -> None:
    folder = bundle(tmp_path, "0.2.0")
    (folder / "extras.txt").touch()
    assert do("update.sh", folder)[0] == 0
    installed = (machine / "0.2.0" / "bin" / "installed").read_text().split()
    assert installed == ["runtime.txt", "extras.txt", "edgetree-0.2.0-py3-none-any.whl"]


def test_models_are_changed_and_taken_back_with_signatures(tmp_path: Path, machine: Path) -> None:
    pytest.importorskip("cryptography")
    assert do("update.sh", bundle(tmp_path, "0.2.0"))[0] == 0

    def edgetree(*words: object) -> None:
        subprocess.run([sys.executable, *launched(machine), *map(str, words)], check=True)

    office = tmp_path / "office"
    office.mkdir()
    for name in ("old", "new", "unsigned"):
        (office / f"{name}.onnx").write_bytes(default_model("depth").read_bytes())
    edgetree("sign", "--new-key", office / "key.pem")
    edgetree("trust", office / "key.pub", "--require")
    for number, name in enumerate(("old", "new"), 1):
        edgetree("sign", office / f"{name}.onnx", "--key", office / "key.pem", "--version", number)

    assert (machine / "etc" / "trust.json").is_file() or os.geteuid() != 0

    def opens() -> int:
        words = [*launched(machine), "live", "none", "--model", machine / "model.onnx"]
        done = subprocess.run([sys.executable, *words], capture_output=True, text=True, check=False)
        return int("was used here before" not in done.stderr and "signature" not in done.stderr)

    assert do("install_model.sh", office / "old.onnx")[0] == 0
    old = os.readlink(machine / "model.onnx")
    assert opens()
    assert do("install_model.sh", office / "new.onnx")[0] == 0
    assert opens()
    # A changed file is refused, and the model in use stays.
    in_use = os.readlink(machine / "model.onnx")
    with (office / "old.onnx").open("ab") as file:
        file.write(b"\0")
    code, line = do("install_model.sh", office / "old.onnx")
    assert (code, line.endswith(f"is refused: {in_use} stays in use")) == (2, True)
    assert os.readlink(machine / "model.onnx") == in_use
    # The older file with its older signature is too old; signed again, it is accepted.
    (machine / "model.onnx").unlink()
    (machine / "model.onnx").symlink_to(old)
    assert not opens()
    (office / "old.onnx").write_bytes(default_model("depth").read_bytes())
    edgetree("sign", office / "old.onnx", "--key", office / "key.pem", "--version", 3)
    assert do("install_model.sh", office / "old.onnx")[0] == 0
    assert opens()
