"""A run's model card: README.md in its folder, with the front matter that the Hugging Face Hub reads."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..common.errors import duration
from ..common.files import write_atomically
from ..policy.file import read_metadata
from ..policy.policy import TASK
from .metrics import REWARD_RATE, describe_rates, shown_rate
from .run_folder import BEST, LAST

CARD = "README.md"


def measured(metadata: Mapping[str, Any]) -> tuple[str, float | None, Mapping[str, Any]]:
    """What the score of a policy file of a run is, the score, and all that its evaluation found."""
    (result,) = metadata["scores"].values()
    score = result["score"]
    if "robot" in metadata:
        return "RealAI score", score, result
    return ("reward rate" if score == result[REWARD_RATE] else "mean return"), score, result


def facts(metadata: Mapping[str, Any]) -> dict[str, str]:
    """What a policy file says of its run, in words."""
    name, score, result = measured(metadata)
    rates = {} if "robot" in metadata else {"rates": describe_rates(result)}
    return {
        name: shown_rate(score),
        **rates,
        "saved after": f"{metadata['frames']:,} frames in {duration(metadata['seconds'])}, seed {metadata['seed']}",
        "command": metadata["command"],
        "made by": f"swingup {metadata['version']}",
    }


def best_policy(folder: Path) -> tuple[str, dict[str, Any]]:
    """The file of a run's best policy, or of its last where none has a score, and the file's metadata."""
    file = BEST if (folder / BEST).exists() else LAST
    return file, read_metadata(folder / file)


def write_card(folder: Path) -> None:
    """Describe the best policy in a run's folder."""
    file, metadata = best_policy(folder)
    name, score, _ = measured(metadata)
    # JSON is YAML, whatever a task is called.
    task = json.dumps(str(metadata.get("robot") or metadata[TASK]))
    results = f"""
model-index:
- name: AR-EAPO
  results:
  - task: {{type: reinforcement-learning, name: reinforcement-learning}}
    dataset: {{type: {task}, name: {task}}}
    metrics:
    - {{type: mean_reward, name: {name}, value: {score}}}"""
    rows = "\n".join(f"| {fact} | `{value}` |" for fact, value in facts(metadata).items())
    card = f"""---
library_name: swingup
pipeline_tag: reinforcement-learning
tags: [reinforcement-learning, {task}]{"" if score is None else results}
---

# A policy for {json.loads(task)}

| | |
|---|---|
{rows}

```python
from swingup.runtime import load_policy  # NumPy alone

policy = load_policy("{file}")
action, _ = policy.predict(observation)
```
"""
    write_atomically(folder / CARD, card.encode())
