"""Callbacks for other people's tools: Weights & Biases, MLflow, Gymnasium's RecordVideo, and the Hugging Face Hub.

Usage: python examples/04_callbacks.py [wandb] [mlflow] [video] [hub]. Each word needs its package; without one the
reports are printed. The run's folder is runs/callbacks, which must not exist yet.
"""

import sys
from collections.abc import Callable

import gymnasium

from swingup import AREAPO, play
from swingup.learner.progress import TrainingReport

FOLDER, REPOSITORY = "runs/callbacks", "me/cartpole"


def wandb(model: AREAPO) -> Callable:
    """Log each report offline; `wandb sync` sends it later."""
    import wandb

    run = wandb.init(project="swingup", mode="offline", config=model.settings.as_dict())
    return lambda model, report: run.log(report.best.as_dict(), step=report.frames)


def mlflow(model: AREAPO) -> Callable:
    """Log each report in mlflow.db, which `mlflow ui --backend-store-uri sqlite:///mlflow.db` shows."""
    import mlflow

    mlflow.set_tracking_uri("sqlite:///mlflow.db")
    mlflow.start_run()
    mlflow.log_params(model.settings.as_dict()["config"])

    def log(model: AREAPO, report: TrainingReport) -> None:
        numbers = {name: value for name, value in report.best.as_dict().items() if value is not None}
        mlflow.log_metrics(numbers, step=report.frames)

    return log


def video(model: AREAPO) -> Callable:
    """Film an episode at each report; it needs gymnasium[classic-control,other]."""

    def film(model: AREAPO, report: TrainingReport) -> None:
        env = gymnasium.make("CartPole-v1", render_mode="rgb_array")
        with gymnasium.wrappers.RecordVideo(env, "videos", name_prefix=f"frames-{report.frames}") as filmed:
            play(model, filmed, episodes=1)

    return film


def hub(model: AREAPO) -> Callable:
    """Upload the run's folder at each report: its README.md is the model card."""
    from huggingface_hub import HfApi

    api = HfApi()  # of the account of `hf auth login`
    api.create_repo(REPOSITORY, exist_ok=True)
    words = {"repo_id": REPOSITORY, "folder_path": FOLDER, "ignore_patterns": ["checkpoints/*"]}
    return lambda model, report: api.upload_folder(**words, commit_message=str(report))


def main(*words: str) -> None:
    """Train for some seconds."""
    model = AREAPO("CartPole-v1", folder=FOLDER, evaluate_every=4_096)
    tools = {each.__name__: each for each in (wandb, mlflow, video, hub)}
    model.learn(8_000, [tools[word](model) for word in words] or (lambda model, report: print(report)))


if __name__ == "__main__":
    main(*sys.argv[1:])
