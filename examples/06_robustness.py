"""Run the robustness benchmark with its 722 simulations and list where the shipped policy fails."""

from collections import Counter

import swingup

controller = swingup.get_controller("ar-eapo", "pendubot")
result = swingup.judge(controller, "pendubot", "robustness", seed=1, name="ar-eapo")
for column, value in result.values.items():
    print(f"{column:<16}{value:8.3f}")  # percentages, and the score from 0 to 1

failed = [run.as_dict() for run in result.runs if not run.success]
print("failures:", dict(Counter(entry["criterion"] for entry in failed)))
print("model errors with which it fails:")
for entry in failed:
    if entry["criterion"] == "model":
        print(f"  {entry['parameter']:<5}{'x ' if entry['relative'] else '= '}{entry['value']:g}")
