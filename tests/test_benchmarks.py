"""The scripts in benchmarks/: tables and pictures from stored or made runs, plants, variants and closed forms."""

import importlib
import json
import os
import re
import runpy
import shutil
import subprocess
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from safetensors.numpy import save_file
from scipy.linalg import expm

import swingup
from swingup import AREAPO
from swingup.benchmark.boards import ROBUSTNESS
from swingup.controllers.baselines.upright import linearised
from swingup.dynamics.dynamics import UPRIGHT
from swingup.plant.plant import LEADERBOARD, get_robot
from swingup.report import draw
from swingup.tasks.acrobot_swingup import AcrobotSwingup
from swingup.tasks.pendulum import PendulumState

BENCHMARKS = Path(swingup.__file__).parents[2] / "benchmarks"

pytestmark = pytest.mark.skipif(not BENCHMARKS.is_dir(), reason="the scripts are only in a checkout")


@pytest.fixture
def script(monkeypatch):
    """Imports a script by its name for one test."""
    monkeypatch.syspath_prepend(BENCHMARKS)
    yield importlib.import_module
    for path in BENCHMARKS.glob("*.py"):
        sys.modules.pop(path.stem, None)


@pytest.fixture
def run(script, monkeypatch, capsys):
    """Runs a script with options; gives the cells of the table's lines, and the figures, which are not written."""
    figures = []
    monkeypatch.setattr(draw, "render", lambda figure, suffix: figures.append(figure) or b"")
    monkeypatch.setattr(script("study"), "write_atomically", lambda path, content: None)

    def start(name, *options):
        figures.clear()
        monkeypatch.setattr(sys, "argv", [name, *map(str, options)])
        script(name).main()
        lines = capsys.readouterr().out.splitlines()
        return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines], list(figures)

    return start


@pytest.fixture
def mujoco(run, tmp_path):
    """The script of the study on MuJoCo's tasks, on last returns by task and learner."""

    def start(returns, *options, **columns):
        rows = [
            {"run": list(run), "seed": seed, "frames": [9], "scores": [last], "seconds": [1.0], **columns}
            for run, values in returns.items()
            for seed, last in enumerate(values)
        ]
        (tmp_path / "runs.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
        tasks = dict.fromkeys(task for task, _ in returns)
        # No seed is missing: nothing is trained.
        return run("mujoco_learning", *tasks, "--seeds", "0", "--study", tmp_path / "runs.jsonl", *options)

    return start


def test_every_script_finds_what_it_imports_and_names(script):
    """Names of the package that a script looks up as it is imported still exist."""
    for path in sorted(BENCHMARKS.glob("*.py")):
        try:
            script(path.stem)
        except ModuleNotFoundError as error:
            # Others are peers that are not installed here.
            if str(error.name).startswith("swingup") or (BENCHMARKS / f"{error.name}.py").exists():
                raise


def test_improvement_over_tasks_of_unequal_runs(mujoco):
    found, _ = mujoco(
        {
            ("A-v1", "areapo"): [5.0, 5.0, 0.0],
            ("A-v1", "sb3-ppo"): [1.0, 2.0],
            ("B-v1", "areapo"): [10.0, 30.0],  # A's three runs win 4 of 6 pairs
            ("B-v1", "sb3-ppo"): [20.0, 20.0],  # 2 of 4 pairs
        }
    )
    assert found[3][:3] == ["A-v1", "3 (0 to 5)", "2 (1 to 2, 2 seeds only)"]
    # (4/6 + 2/4) / 2. Of all resamples 0.9 % have 0, 6.5 % at most 1/6, and 7.4 % have 1.
    assert found[-1][0].endswith("improves on sb3-ppo: 0.58 (0.17 to 1.00; at least 2 and 2 runs of 2 tasks)")
    assert mujoco({("A-v1", "areapo"): [5.0, 6.0]})[0][-1][0].endswith("improves on sb3-ppo: not run")


def test_verdicts(script):
    # Two runs each, 1 apart, with variances of 0.02: 4.303 · √(0.02 / 2 + 0.02 / 2), by Student's t of 2 degrees.
    verdict = script("study").verdict
    assert verdict([1.0, 1.2], [0.0, 0.2], 0.1) == "1.000 (0.392 to 1.608) | holds"
    words = [
        verdict([0.0, 0.2], *rest).split("| ")[1] for rest in (([1.0, 1.2], 0.1), ([0.0, 0.2], 1.0), ([0, 0], 0.1))
    ]
    assert words == ["refuted", "no effect", "not enough power"]


def test_within_the_range_the_largest_torque_turns_the_slowest_mode_back(robot):
    plant, limit = LEADERBOARD.driven(robot), 6.0
    most = runpy.run_path(str(BENCHMARKS / "holding_range.py"))["holding_range"](plant, robot)
    (A,), (B,), _ = linearised(plant, robot, UPRIGHT[None], np.zeros(1))
    # Of both unstable modes, the one with the least |w b| / λ.
    rates, modes = np.linalg.eig(A.T)
    scaled = np.abs(B @ (modes / modes[0])) * limit
    which = int(np.argmin(np.where(rates > 0, np.abs(scaled - most * rates), np.inf)))
    assert scaled[which] == pytest.approx(most * rates[which])
    w = modes[:, which].real / modes[0, which].real
    both = np.block([[A, B[:, None]], [np.zeros((1, 5))]])
    for share, returns in ((0.99, True), (1.01, False)):
        # A state of this mode alone: w e = share · most, and 0 along the other left eigenvectors.
        start = np.linalg.inv(modes.T)[:, which].real
        start *= share * most / (w @ start)
        end = expm(0.05 * both) @ np.append(start, -np.sign(w @ B) * limit)
        assert (abs(w @ end[:4]) < share * most) == returns


@pytest.mark.slow
def test_a_policy_file_of_dm_controls_acrobot_earns_in_mujoco_what_it_earns_in_the_task(
    script, tmp_path, monkeypatch
):
    pytest.importorskip("mujoco")
    module, zeros = script("acrobot_swingup"), lambda *_, **__: jnp.zeros((2, 4))
    monkeypatch.setattr(module, "STEPS", 20)
    monkeypatch.setattr("swingup.tasks.acrobot_swingup.winnable_states", zeros)  # unused
    model = AREAPO("swingup/AcrobotSwingup-v0", num_envs=2, num_steps=4, batch_size=8, evaluation_episodes=1)
    model.export_policy(tmp_path / "policy.safetensors")
    found = module.judge(tmp_path / "policy.safetensors", 7, 2).sum(axis=1)
    assert model.settings.preset == "dm-acrobot"
    random, task = np.random.default_rng([7, 1]), AcrobotSwingup()
    step, observe = jax.jit(task.step), jax.jit(task.observe)
    for expected in found:
        angles = random.uniform(-np.pi, np.pi, 2)
        state, total = PendulumState(jnp.array([angles[0] + np.pi, angles[1], 0.0, 0.0]), jnp.array(0)), 0.0
        for _ in range(20):
            taken = step(state, model.predict(np.asarray(observe(state)))[0], jax.random.key(0))
            state, total = taken.state, total + float(taken.reward)
        assert total == pytest.approx(expected, rel=1e-3)


HELD = {"acrobot": (8, 8, 16, 19, 7), "pendubot": (29, 30, 27, 22, 26)}
"""Starts of 32 from which a plant with dry friction is held, at least: the best of the designs before."""


@pytest.mark.slow
@pytest.mark.parametrize(("place", "plant"), [*enumerate(("A.0", "B.0", "C.0", "C.1", "cloudpendulum"))])
def test_the_hold_at_the_top(script, robot, place, plant):
    held = script("hold_at_top").errors_held(robot, plant) < 0.6
    assert held.sum() >= HELD[robot.name][place]


def test_joint_draws_are_off_in_all_parameters_within_half_the_ranges(script):
    cases, again = (script("adaptive_plants").joint_cases(get_robot("acrobot"), ROBUSTNESS) for _ in range(2))
    assert [case.settings for case in again] == [case.settings for case in cases]
    nominal, plants = LEADERBOARD.driven(get_robot("acrobot")), [case.scenario.parameters for case in cases]
    for names, least, most in (
        (("I1", "I2", "m2", "r1", "r2"), 0.875, 1.125),
        (("b1", "b2"), -0.05, 0.05),
        (("cf1", "cf2"), -0.1, 0.1),
        (("Ir",), 0.0, 5e-5),
    ):
        for name in names:
            drawn = np.array([getattr(plant, name) for plant in plants]) / (getattr(nominal, name) or 1.0)
            assert least <= drawn.min() < drawn.max() <= most
            assert len(set(drawn)) == 200 == len(cases)
            assert drawn.max() - drawn.min() > 0.9 * (most - least)


@pytest.mark.slow
def test_the_optimum_of_a_plant_is_held_and_scored(script):
    robot = get_robot("pendubot")
    every = script("adaptive_plants").plant_sets(robot, ROBUSTNESS)["grid"]
    cases = [case for case in every if case.settings["parameter"] == "m2"]
    (found,) = script("adaptive_failing").optima(robot, [cases[10]], ROBUSTNESS)
    # The middle of the sweep is the nominal plant; its shipped swing-up scores 0.697 with its own regulator.
    assert cases[10].settings["value"] == pytest.approx(1.0)
    assert found.reached
    assert found.held
    assert found.score == pytest.approx(0.69, abs=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("preset", ["continuing", "ppo"])
def test_constants_and_units_of_rewards_and_observations_do_not_matter(preset, script):
    """Pendulum-v1 itself pays about -1,200 before it is learned, and -150 at its best."""
    constants = script("constants")
    learn = constants.learner(preset, 1, 300_000)
    returns = {str(change): learn(constants.Pendulum(**change)).item() for change in constants.CHANGES}
    assert min(returns.values()) > -300, returns


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")
def test_causes_that_change_how_the_pendulum_moves_come_first_or_second(script, monkeypatch, capsys):
    """tests/identification has those that change what is measured or commanded."""
    causes = ["rate", "supply", "friction", "play", "spring", "mass"]
    words = ["diagnosis", "--seed", "305", "--draws", "2", "--robot", "pendubot", "--cause", *causes]
    monkeypatch.setattr(sys, "argv", words)
    script("diagnosis").main()
    rows = [line.split() for line in capsys.readouterr().out.splitlines()[-7:-1]]
    assert {cause: (int(two), int(of)) for cause, _, two, of in rows} == dict.fromkeys(causes, (2, 2))


SMALL = [
    "ablations default discounted --frames 8192 --seeds 1 --study runs.jsonl --runs runs",
    "continuing Swimmer --frames 2000 --seeds 1 --study runs.jsonl",
    "continuing Swimmer --stream --frames 2000 --seeds 1 --study runs.jsonl",
    "fast acrobot runs 1 8192",
    "guard_stops acrobot recorded --seeds 1",
    "holdable acrobot --seeds 1",
    "mujoco_learning Swimmer-v5 --frames 2000 --seeds 1 --learners areapo --study runs.jsonl",
    "plants A.0 --robots acrobot --frames 2048 --seeds 1 --results runs.jsonl --runs runs",
    "seeds_speed fast:1",
    "training_speed acrobot 131072",
    "untuned Pendulum-v1 --frames 2000 --file runs.csv",
]
"""Scripts with options that make a run short; other tests have other scripts."""


@pytest.mark.slow
@pytest.mark.parametrize("words", SMALL, ids=lambda words: words.split()[0])
def test_scripts_run(words, tmp_path):
    name, *options = words.split()
    path = os.pathsep.join(filter(None, [str(BENCHMARKS.parent / "src"), os.environ.get("PYTHONPATH")]))
    env = os.environ | {"PYTHONPATH": path}
    subprocess.run([sys.executable, BENCHMARKS / f"{name}.py", *options], cwd=tmp_path, env=env, check=True)


def test_a_study_of_another_length_is_not_mixed_in(script, tmp_path):
    study = script("study").Study(tmp_path / "runs.jsonl")
    study.add(["Hopper"], 3, [(100_096, 1.0, 2.0)])
    assert re.fullmatch(r"[0-9a-f]{8,}\+?|\d+\.\d+\.\d+", study.of("Hopper")[0]["code"])
    assert study.has(["Hopper"], 3, 100_000)
    assert not study.has(["Hopper"], 4, 50_000)
    with pytest.raises(SystemExit, match="Hopper seed 3 of 100,096 frames, not 50,000: name another --study"):
        study.has(["Hopper"], 3, 50_000)


@pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")
def test_sizes_of_headers(script):
    """12 + 4 weights and 5 biases of the layers, and means and deviations of 3 observations."""
    found = script("c_size")
    flash, _, self_test = found.measure(found.BOARDS["x86-64"], found.small_policy((4,)), "single")
    assert 4 * (12 + 4 + 5 + 6) < flash < 4_000
    assert self_test == "0"


def test_every_claim_has_a_page_a_command_and_code(script):
    module = script("claims")
    claims = module.read_claims()
    rows = [line for line in (BENCHMARKS / "README.md").read_text().splitlines() if line.startswith("| [")]
    assert len(claims) == len(rows) > 20
    for claim in claims:
        assert (BENCHMARKS / claim.page).is_file(), claim
        assert claim.command.startswith("swingup ") or (BENCHMARKS.parent / claim.command.split()[1]).is_file(), (
            claim
        )
        assert all((BENCHMARKS.parent / "src" / "swingup" / name).exists() for name in claim.folders), claim
    # A claim of the first day has older code than one of a day to come.
    first, last, alike = (
        claims[0]._replace(measured=day) for day in ("2000-01-01", "2099-01-01", "2000-01-01, same bits 2099-01-01")
    )
    assert module.changed_since(first) > module.changed_since(last) == module.changed_since(alike) == 0


def test_trainings_are_alike_if_what_both_recorded_is(script, tmp_path):
    difference = script("claims").difference

    def record(name, weight=1.0, **columns):
        (tmp_path / name).mkdir()
        row = {"seed": 0, "frames": 8, "seconds": 1.0, "score": 0.5} | columns
        (tmp_path / name / "metrics.jsonl").write_text(json.dumps(row) + "\n")
        save_file({"w": np.array([weight, np.nan])}, tmp_path / name / "last.safetensors")
        return tmp_path / name

    before = record("before")
    assert difference(before, record("slower", seconds=2.0, another=1.0)) is None
    assert difference(before, record("worse", score=0.25)) == "score is 0.25 after 8 frames, was 0.5"
    assert difference(before, record("other", weight=1.0 + 2e-16)) == "w of last.safetensors"


def test_a_study_has_a_screen_or_two():
    long = {
        page.name: count for page in BENCHMARKS.glob("*.md") if (count := len(page.read_text().splitlines())) > 40
    }
    assert long.keys() <= {"README.md"}, long
