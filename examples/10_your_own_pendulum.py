"""From the logs of a real pendulum to a plant: identify it, with intervals, and judge a policy on it."""

from pathlib import Path

import swingup

LOGS = Path(__file__).parent / "logs"

found = swingup.identify(
    [LOGS / "C1-excitation-1.csv", LOGS / "C1-excitation-2.csv"], test=[LOGS / "C1-excitation-3.csv"], start="C.1"
)
result = found.as_dict()
print("parameter        value   95 % interval")
for name in ("m1 r1 + m2 l1", "m2 r2", "I1 + m2 l1^2", "I2"):
    low, high = result["intervals"][name]
    print(f"{name:14} {result['parameters'][name]:7.4f}   {low:.4f} to {high:.4f}")
for model, errors in result["errors"].items():
    print(f"held-out error of the {model} model after 0.25 s: {errors['0.25']['angle']:.3f} rad")

domain = found.save("mine.yml")  # the plant, and the ranges that the logs leave beside it
print(f"wrote mine.yml and {domain}: swingup evaluate acrobot --board sim2real --domain {domain}")

# adaptive finds its plant while it swings up, in a loop as the recorded robot has it.
SEEDS = 5
policy = swingup.get_controller("adaptive", "acrobot")
trials = swingup.judge(policy, "acrobot", "sim2real", SEEDS, domain="recorded", plant="mine.yml")
print(f"adaptive on it: {trials.successes} of {SEEDS} swing-ups held")
