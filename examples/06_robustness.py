"""Run the robustness benchmark with its 722 simulations and list where the shipped policy fails."""

from collections import Counter

import swingup

controller = swingup.get_controller("ar-eapo", "pendubot")
result = swingup.robustness(controller, "pendubot", "ar-eapo", seed=1)
for criterion, percent in result.percent.items():
    print(f"{criterion:<16}{percent:6.1f} %")
print(f"{'overall':<16}{result.overall:8.3f}")

failed = [entry.as_dict() for entry in result.results if not entry.success]
print("failures:", dict(Counter(entry["criterion"] for entry in failed)))
print("model errors with which it fails:")
for entry in failed:
    if entry["criterion"] == "model":
        print(f"  {entry['parameter']:<5}{'x ' if entry['relative'] else '= '}{entry['value']:g}")
