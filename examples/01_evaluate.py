"""Score the shipped policy of each robot by the benchmark's rules and inspect its trajectory.

Usage: python examples/01_evaluate.py
"""

import numpy as np

import swingup


def main() -> None:
    """Print the score, the swing-up time and the angles at the end."""
    for robot in ("acrobot", "pendubot"):
        controller = swingup.get_controller("adaptive", robot)
        card = swingup.load_policy("adaptive", robot).metadata
        result = swingup.judge(controller, robot, name=card["command"])
        criteria, trajectory = result.criteria, result.trajectory
        assert trajectory is not None
        print(f"{robot}: score {criteria.score:.3f}, up after {criteria.swingup_time:.2f} s")
        print(f"  made by: {result.controller}")
        q1, q2 = trajectory.x[-1, :2]
        print(f"  at the end: q1 = {np.degrees(q1):.1f}°, q2 = {np.degrees(q2):.1f}°; upright is 180° and 0°")
        print(f"  largest torque: {np.abs(trajectory.u).max():.2f} N m")


if __name__ == "__main__":
    main()
