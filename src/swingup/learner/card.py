"""A run's model card: README.md in its folder, with the front matter that the Hugging Face Hub reads."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..common.errors import MALFORMED, SwingupError, duration
from ..common.files import write_atomically
from ..policy.file import read_metadata
from ..policy.policy import TASK
from .metrics import MISSING, REWARD_RATE, describe_rates, shown_rate
from .run_folder import BEST

CARD = "README.md"


def measured(metadata: Mapping[str, Any]) -> tuple[str, float | None, Mapping[str, Any]]:
    """What the score of a policy file of a run is, the score, and all that its evaluation found."""
    (result,) = metadata["scores"].values()
    score = result["score"]
    if "robot" in metadata:
        return "RealAI score", score, result
    return ("reward rate" if score == result.get(REWARD_RATE) else "mean return"), score, result


def facts(metadata: Mapping[str, Any]) -> dict[str, str]:
    """What a policy file says of its run, in words."""
    name, score, result = measured(metadata)
    rates = {} if "robot" in metadata else {"rates": describe_rates(result)}
    frames, seconds = metadata.get("frames", 0), metadata.get("seconds", 0.0)
    return {
        name: shown_rate(score),
        **rates,
        "saved after": f"{frames:,} frames in {duration(seconds)}, seed {metadata.get('seed', MISSING)}",
        "command": metadata.get("command", MISSING),
        "made by": f"swingup {metadata.get('version', MISSING)}",
    }


def best_policy(folder: Path) -> dict[str, Any]:
    """The metadata of the best policy in a run's folder."""
    file = folder / BEST
    metadata = read_metadata(file) if file.exists() else {}
    try:
        measured(metadata)
    except MALFORMED as error:
        raise SwingupError(f"{file} is not there or has no scores: name the folder of a run") from error
    return metadata


def write_card(folder: Path) -> None:
    """Describe the best policy in a run's folder."""
    metadata = best_policy(folder)
    name, score, _ = measured(metadata)
    # JSON is YAML, whatever a task is called.
    of = str(metadata.get("robot") or metadata[TASK])
    task = json.dumps(of)
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

# A policy for {of}

| | |
|---|---|
{rows}

```python
from swingup.runtime import load_policy  # NumPy alone

policy = load_policy("{BEST}")
action, _ = policy.predict(observation)
```
"""
    write_atomically(folder / CARD, card.encode(errors="backslashreplace"))  # a file's name may be no text
