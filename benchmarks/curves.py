"""Draw the learning curves of the runs in benchmarks/runs: mean reward and score against frames.

Usage: python benchmarks/curves.py [PNG], by default benchmarks/curves.png. Needs matplotlib.
"""

import sys
from pathlib import Path

import matplotlib

from swingup.learner.metrics import read_metrics

matplotlib.use("Agg")
from matplotlib import pyplot as plt

HERE = Path(__file__).parent
PAPER = {"acrobot": 0.633, "pendubot": 0.659}
"""The paper's RealAI scores."""


def main(path: Path) -> None:
    """One column a robot; every run a line."""
    figure, axes = plt.subplots(2, 2, figsize=(10, 6), sharex=True, layout="constrained")
    for column, (robot, paper) in enumerate(PAPER.items()):
        reward, score = axes[:, column]
        for file in sorted((HERE / "runs").glob(f"{robot}-*.jsonl")):
            rows = read_metrics(file)
            frames = [row["frames"] / 1e6 for row in rows]
            preset = file.stem.removeprefix(f"{robot}-").rpartition("-")[0]
            (line,) = reward.plot(frames, [row["reward"] for row in rows], label=preset)
            score.plot(frames, [row["score"] for row in rows], ".", markersize=2, color=line.get_color())
            score.plot(frames, [row["best_score"] for row in rows], color=line.get_color(), label=f"{preset}, best")
        score.axhline(paper, color="grey", linestyle="--", linewidth=1, label="paper")
        reward.set(title=robot, ylabel="mean reward of a step", ylim=(-0.7, 0.0))
        score.set(xlabel="frames (millions)", ylabel="RealAI score")
        reward.legend()
        score.legend(loc="lower right")
    figure.savefig(path, dpi=110)
    print(f"saved {path}")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE / "curves.png")
