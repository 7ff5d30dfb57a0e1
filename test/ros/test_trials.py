"""The trials of tools/trials, a few rounds of each: endings and kills lose nothing."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("domain")]

ROOT = Path(__file__).parents[2]
TRIALS = ROOT / "tools/trials"
#: Programs that start nodes and end them.
STARTERS = {
    "fleets": [str(TRIALS), "fleets", "--count", "1", "--robots", "1"],
    "live_path": [str(ROOT / "benchmarks/live_path.py"), "--robots", "1"],
}
#: Ends a hang; a busy machine is far from it.
DEADLINE_S = 300.0


@pytest.mark.parametrize(
    "trial",
    [["kills", "--count", "2"], ["fleets", "--count", "1", "--robots", "2"]],
    ids=lambda trial: trial[0],
)
def test_a_few_rounds_of_a_trial(trial: list[str]) -> None:
    done = subprocess.run(
        [sys.executable, str(TRIALS), *trial, "--patience", "250"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "troubles: 0" in done.stdout


def heirs_of(folder: Path) -> dict[int, bytes]:
    """Processes whose folder for temporary files is this one, and their command lines."""
    wanted, found = b"TMPDIR=" + os.fsencode(folder), {}
    for process in Path("/proc").glob("[0-9]*"):
        try:
            if wanted in (process / "environ").read_bytes().split(b"\0"):
                found[int(process.name)] = (process / "cmdline").read_bytes()
        except OSError:
            continue
    return found


@pytest.mark.skipif(sys.platform != "linux", reason="asks Linux which processes there are")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=lambda n: n.name)
@pytest.mark.parametrize("starter", list(STARTERS))
def test_who_is_interrupted_leaves_nothing_behind(
    starter: str, number: signal.Signals, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    trial = subprocess.Popen(
        [sys.executable, *STARTERS[starter]],
        env=os.environ | {"TMPDIR": str(tmp_path)},
        start_new_session=True,
    )
    end_s = time.monotonic() + DEADLINE_S
    try:
        while not any(b"map_fusion" in command for command in heirs_of(tmp_path).values()):
            assert trial.poll() is None
            assert time.monotonic() < end_s
            time.sleep(0.1)
        trial.send_signal(number)
        assert trial.wait(DEADLINE_S) == 128 + number
        # A process that was just being started ends by itself when it sees that its parent has.
        while heirs_of(tmp_path) and time.monotonic() < end_s:
            time.sleep(0.1)
        assert not heirs_of(tmp_path)
        assert not list(tmp_path.iterdir())
        assert "Traceback" not in capfd.readouterr().err
    finally:
        for process in heirs_of(tmp_path):
            os.kill(process, signal.SIGKILL)
