"""Train a policy from Python, print its progress, and resume it, in about one minute.

Usage: python examples/03_train.py [FOLDER [FRAMES]]. The defaults are a temporary folder and 100,000 frames. A
policy that swings up takes some 5 million frames: `swingup train acrobot`.
"""

import sys
import tempfile
from pathlib import Path

from swingup.learner.run import Run, resume_run, start_run
from swingup.learner.run_settings import make_run_settings


def main(folder: Path, frames: int) -> None:
    """Train for half of the frames, then resume from the checkpoint for the rest."""
    narrow = {"centre_values": True, "policy_layers": (64, 64), "value_layers": (64, 64)}
    settings = make_run_settings("pendubot", "pendulum", narrow, evaluate_every=16_384, checkpoint_every=65_536)
    show(start_run(settings, folder, frames // 2))
    show(resume_run(folder, frames))


def show(run: Run) -> None:
    """Advance a run to its end and print a line for each report."""
    for report in run.advance():
        print(f"{report.frames:7,} frames: reward {report.best.reward:.3f}, score {report.score:.3f}")


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as temporary:
        main(
            Path(sys.argv[1] if len(sys.argv) > 1 else temporary) / "run",
            int(sys.argv[2]) if len(sys.argv) > 2 else 100_000,
        )
