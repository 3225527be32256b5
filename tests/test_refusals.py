"""Every public entry refuses nonsense with a ``SwingupError``, one line that names the argument or its value.

A new refusal is a value or a row here, unless a file or a fixture of one folder is needed for it.
"""

import dataclasses
import math

import gymnasium
import numpy as np
import pytest
from gymnasium.wrappers import FrameStackObservation, TimeLimit

from benchmark.controllers import HANGING
from learner.environments import LENT, TINY, Lever, Noisy
from policy.references import space_task
from refusals import refusal
from swingup import AREAPO, get_controller, judge, load_plant, loop_controller, score, search
from swingup.benchmark.boards import ROBUSTNESS
from swingup.benchmark.disturbances import DisturbanceSettings, PushRules
from swingup.benchmark.robustness_board import change_grid
from swingup.benchmark.rollout import Trajectory
from swingup.cli.exporting import plot_command
from swingup.common.errors import one_line, quoted
from swingup.export.c_header import c_header
from swingup.export.folder import export_folder
from swingup.gym import PendulumEnv, PendulumVectorEnv
from swingup.identification.excitation import excite
from swingup.learner.backend import check_actions
from swingup.learner.problem import make_problem, problem_from_record
from swingup.loop.resolve import resolve
from swingup.plant.files import save_plant
from swingup.plant.measured import measured_plant
from swingup.plant.plant import ROBOTS
from swingup.policy.shipped import load_policy
from swingup.policy.spaces import Space, box, discrete
from swingup.refine.adapt import adapt
from swingup.refine.recipe import run_recipe
from swingup.report.film import animate
from swingup.tasks.acrobot_swingup import AcrobotPractice
from swingup.tasks.presets import get_task
from swingup.tasks.task import check_task

STILL = Trajectory(np.arange(3.0), np.zeros((3, 4)), np.zeros((3, 2)))
HOLE = Trajectory(np.arange(3.0), np.full((3, 4), math.nan), np.zeros((3, 2)))


def usually(call, **usual):
    """An entry with usual arguments, which those of the table replace."""

    def entry(**given):
        return call(**(usual | given))

    entry.__name__ = getattr(call, "__name__", str(call))
    return entry


def disturbance(**given):
    return DisturbanceSettings(**given).draw(0.002, 10.0, 0)


def plot(kind, files, out):
    return plot_command(kind, files, out=out)


def c1(**numbers):
    return load_plant(load_plant("C.1").changed(**numbers))


class Choosing(AcrobotPractice):
    choices = (3, 2)


class Truthful(Lever):
    def step(self, state, action, key):
        step = super().step(state, action, key)
        return dataclasses.replace(step, reward=step.reward > 1.0)


LEARNER = {"env": Noisy, "preset": "continuing"} | TINY
SETTINGS = {"problem": make_problem("acrobot"), "preset": "pendulum", "seed": 0, "seeds": 1, "evaluate_every": 64}
ENTRIES = {
    usually(AREAPO, **LEARNER): {
        "preset": ["best"], "learning_rat": [0.1], "sed": [1], "batch_size": [1000], "seed": [-1, "3"],
        "env": ["NoSuchTask-v0", "no_such_mod:Task-v0"], "evaluation_episodes": [-1], "evaluate_every": [0],
        "checkpoint_every": [0], "policy_layers": [64, ("8",), (), (0,)], "num_envs": [2.0, 0, True, 2**32],
        "learning_rate": ["3e-4", math.nan], "centre_values": [1], "gae_lambda": [0.9, (0.9, 1.1)],
        "gain": ["none", "trace"], "terminations": ["end"], "activation": ["Tanh"], "schedule": ["cosine"],
    },
    usually(animate, motions=[(STILL, "acrobot")], path="film.gif"): {
        "fps": [0, math.nan, "fast\n"], "size": [8, 100_000], "speed": [0.0, 1e-320], "path": ["film.png"],
    },
    usually(plot, kind="phase", files=["x"], out="out.png"): {
        "kind": ["histogram"], "files": [["missing"], ["."]], "out": ["out.gif", "out"],
    },
    usually(PendulumEnv, robot="acrobot"): {"task": ["easy"], "render_mode": ["ansi"], "plant": ["C.2"]},
    usually(gymnasium.make, id="swingup/ContinuingHopper-v0"): {
        "task": ["Hoper"], "resets": ["some"], "reset_cost": [math.nan],
    },
    usually(judge, controller=HANGING, robot="acrobot", board="robustness"): {
        "seed": [-1], "seeds": [0], "board": ["v9"], "robot": ["hexapod"], "domain": ["identified"],
        "plant": ["C.2"], "disturbance": [DisturbanceSettings(delay=0.1)],
    },
    usually(change_grid, rules=ROBUSTNESS): {"text": [
        "speed=0:1:2", "delay", "delay=0:x:3", "delay=0:inf:3", "delay=0:1:2.5", "perturbations=0",
        "m2=0.75:1.25:21:5",
    ]},
    disturbance: {
        "pushes": [PushRules(pushes=10), PushRules(pushes=0), True], "velocity_noise": [-0.1], "delay": [math.nan],
        "torque_noise": ["0.1"], "torque_response": [math.inf],
    },
    usually(get_controller, name="tvlqr", robot="acrobot"): {
        "name": [math.sin, "pid", "mine:", ":it", "..x:it", "math:pi.nothing", "a\nb:it", "\udce9:it"],
        "robot": ["cartpole"],
    },
    usually(run_recipe, policy=load_policy("ar-eapo", "acrobot")): {
        "recipe": ["hover"], "plant": ["C.3"], "domain": ["moon", "recorded"], "seed": [-1],
    },
    usually(adapt, robot="acrobot", out="out.safetensors"): {
        "robot": ["cartpole"], "domain": ["moon"], "plant": ["C.3"], "draws": [0], "frames": [0],
        "out": ["out.txt", "missing/out.safetensors"], "seed": [-1],
    },
    usually(load_policy, source="ar-eapo"): {
        "robot": ["cartpole"], "source": ["ar-eapo", "tvlqr", "globel", "nothing.safetensors"],
    },
    load_plant: {"source": ["C.2", "missing.yml"]},
    c1: {
        "gr": [0.0, 1e-300], "tl1": [-1.0, 1e-200], "g": [0.0, 1e-200], "cf1": [1e10], "m1": [math.nan],
    },
    resolve: {"plant": ["C.3", "missing.yml"], "domain": ["idenfied", "missing.yml"]},
    usually(excite, domain="C.1"): {"torque": [7.0], "joint": ["hip"], "duration": [1]},
    usually(search, env="CartPole-v1", space={"learning_rate": "1e-4:1e-2"}, trials=1, out="out"): {
        "seed": [1.5], "env": [Noisy], "space": [["learning_rate"], {"learning_rate": [1e-4]}],
    },
}  # fmt: skip
"""By entry and argument."""


ACROBOT, PENDUBOTS = ROBOTS["acrobot"], get_task("paper", ROBOTS["pendubot"])
ADAPTIVE, AR_EAPO = load_policy("adaptive", "acrobot"), load_policy("ar-eapo", "acrobot")
TOGETHER = {
    "a plant goes with a robot, not with Swimmer-v5": lambda: make_problem("Swimmer-v5", "B.0"),
    "robot = None and env = None": lambda: problem_from_record({"robot": None, "env": None}),
    # 2 s / 0.01 * 25 = 5000 frames of 2048 * 2048 = 4.2 million pixels.
    "5000 frames of 4194304 pixels": lambda: animate([(STILL, "acrobot")], "film.gif", speed=0.01, size=2048),
    "for the pendubot, not for the acrobot": lambda: PendulumEnv("acrobot", PENDUBOTS),
    "AcrobotPractice has actions to choose from": lambda: PendulumEnv("acrobot", AcrobotPractice()),
    "has a plant of its own": lambda: PendulumVectorEnv("pendubot", task=PENDUBOTS, plant="A.0"),
    "sees its plant already": lambda: adapt("acrobot", "out.safetensors", policy=ADAPTIVE),
    "is for the pendubot, not the acrobot": lambda: judge(get_controller("lqr", "pendubot"), "acrobot"),
    "make it shorter": lambda: judge(HANGING, "acrobot", change_grid(ROBUSTNESS, "delay=0:5:3")),
    "shapes (3,), (2, 4) and (3, 2)": lambda: score(dataclasses.replace(STILL, x=np.zeros((2, 4))), "acrobot"),
    "are not finite: end it": lambda: score(dataclasses.replace(STILL, u=HOLE.x[:, 2:]), "acrobot"),
    "'ar-eapo': it has a plant of its own": lambda: get_controller("ar-eapo", "pendubot", plant="B.0"),
    "C.1 has tl2 = 0, and": lambda: get_task("smooth", ACROBOT, load_plant("C.1").changed(tl1=0.0, tl2=0.0)),
    "limit = -1": lambda: loop_controller(get_controller("lqr", "acrobot"), "acrobot", limit=-1),
    "the policy is for the acrobot, not the pendubot": lambda: adapt("pendubot", "out.safetensors", policy=AR_EAPO),
    "leave them out with a policy": lambda: adapt("acrobot", "out.safetensors", policy=AR_EAPO, frames=64),
    "has no motor at joint = 'shoulder'": lambda: excite(c1(tl1=0.0), joint="shoulder"),
    "unknown robot 'hexapod'": lambda: get_task("paper", "hexapod"),
    "l2 = 0 must be positive": lambda: measured_plant(
        values={"m1": 1.0, "m2": 1.0, "l1": 1.0, "l2": 0.0, "tl1": 1.0}
    ),
    "I2 and theta2 say the same": lambda: measured_plant("C.1", {"I2": 0.05, "theta2": 0.06}),
    "theta5 and m2r2 say the same": lambda: measured_plant("C.1", {"theta5": 0.05, "m2r2": 0.06}),
    "theta3 / l1 = 0.25 and m2r2 = 0.05 say the same": lambda: measured_plant(
        "C.1", {"theta3": 0.05, "l1": 0.2, "theta5": 0.05}
    ),
    "no pendulum has these base parameters": lambda: save_plant("a.urdf", c1(I2=0.06, gr=6.0, Ir=0.01)),
    "delay has more than 10000 simulations": lambda: judge(
        HANGING, "acrobot", change_grid(ROBUSTNESS, "delay=0:0.04:9999:9999")
    ),
    "tl2 = 0, and the acrobot's motor is": lambda: animate([(STILL, "acrobot")], "film.gif", plant=c1(tl2=0.0)),
    "estimator setting dt = 0.2": lambda: dataclasses.replace(
        ADAPTIVE,
        plant=ADAPTIVE.plant.changed(l1=0.01),
        estimator=dataclasses.replace(ADAPTIVE.estimator, dt=0.05, longest_gap=0.05),
    ),
    "an action reaches 3000000001, beyond C's 32 bits": lambda: c_header(
        space_task("far", discrete(2, 3_000_000_000), box((3,)))
    ),
    "choices = (3, 2) for action_size = 1": lambda: check_task(Choosing()),
    "in plain Python: call it as it is": lambda: loop_controller(get_controller("math:sin", "acrobot"), "acrobot"),
    "the acrobot, not the pendubot": lambda: loop_controller(get_controller("lqr", "acrobot"), "pendubot"),
    "form numpy is not for a pendulum: use realaigym": lambda: export_folder(ADAPTIVE, "out", "numpy"),
    "has no resets to choose": lambda: gymnasium.make("swingup/ContinuingSwimmer-v0", resets="chosen"),
    "puts TimeLimit inside FrameStackObservation: pass the function": lambda: AREAPO(
        TimeLimit(FrameStackObservation(gymnasium.make("CartPole-v1"), 2), 100), **TINY
    ),
    "puts TimeLimit inside TimeLimit": lambda: AREAPO(TimeLimit(gymnasium.make("CartPole-v1"), 1000), **TINY),
    "log_std_init has no effect on discrete actions": lambda: AREAPO(Noisy, log_std_init=-1.0, **TINY),
    "reward of step() of Truthful is bool": lambda: check_task(Truthful()),
    "an environment that was passed in serves one": lambda: AREAPO(Noisy(), seeds=2, **LENT),
    "callback = 3": lambda: AREAPO(Noisy, **TINY).learn(64, 3),
    "1024 of 1024 steps gave a reward that is not finite": lambda: AREAPO(Lever(first=math.nan), **TINY).learn(64),
    "a run of the robot pendubot: leave env out": lambda: make_problem("pendubot").on("acrobot"),
    "evaluation_episodes = 2 has no effect with environments that were passed in": lambda: AREAPO(
        Noisy(), **(TINY | {"num_envs": 1, "batch_size": 16})
    ),
    "1024 of 1024 resets gave an observation that is not finite": lambda: AREAPO(Lever(shown=math.nan), **TINY),
    "no LQR can hold this pendubot upright": lambda: get_controller("lqr", "pendubot", plant=c1(I2=1e-12, r2=0.0)),
    "estimator setting acceleration_noise": lambda: dataclasses.replace(
        ADAPTIVE, plant=ADAPTIVE.plant.changed(g=9e8)
    ),
    "give tl2 a torque limit (N m)": lambda: get_task("global", ACROBOT, c1(tl2=0.0)),
    "has tl2 = 0, and the acrobot's motor is at joint 2": lambda: get_controller(
        "lqr", "acrobot", plant=c1(tl2=0.0)
    ),
    "trained with actions of no space": lambda: check_actions({}, Space((1,), "float32", low=[-1.0], high=[1.0])),
}
"""Arguments of which each alone is good."""


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: entry.__name__)
def test_nonsense_is_named(entry, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, values in ENTRIES[entry].items():
        for value in values:
            told = refusal(entry, **{name: value})
            words = (name, value, quoted(value), *(value if isinstance(value, list) else ()))
            assert any(one_line(word) in told for word in words), (value, told)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("words", TOGETHER)
def test_what_does_not_go_together_is_named(words):
    assert words in refusal(TOGETHER[words])
