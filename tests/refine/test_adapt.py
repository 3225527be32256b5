"""Adapting: the domain that follows from a plant and a domain, its file, and what is kept."""

import dataclasses
import types

import pytest

from swingup.loop.resolve import resolve
from swingup.plant.files import load_plant
from swingup.plant.plant import LEADERBOARD
from swingup.policy.pendulum import write_pendulum_policy
from swingup.policy.shipped import load_policy
from swingup.refine import adapt as adapting
from swingup.refine.adapt import Watch, adapt, save_domain
from swingup.refine.recipe import GUESS, RefinementReport, run_recipe

LOOP = "delay: 0.02\nquantum1: 0.001\npassive_limit: 0\n"
FILES = {
    "ranges about a named base": "plant: C.1\nm1: [0.5, 0.55]\n",
    "ranges and a loop": f"plant: C.1\nm1: [0.5, 0.55]\n{LOOP}",
    "a guess and a loop": f"plant: C.1\nm1: 0.5\n{LOOP}",
    "another design": f"plant: C.1\ndesign: C.0\nm1: [0.5, 0.55]\nvelocities: differences\n{LOOP}",
}


@pytest.mark.parametrize("content", FILES.values(), ids=FILES)
def test_the_domain_of_a_plants_file_keeps_its_values_and_loop_and_reads_back(tmp_path, content):
    source, c1, recorded = tmp_path / "mine.yml", load_plant("C.1"), resolve(domain="recorded")
    source.write_text(content)
    found = resolve(source, "recorded", GUESS)
    low, high = found.low, found.high
    # A guess of 0.5 kg is off by 10 %; the other parameters are C.1's, or within 10 % of them.
    is_guess = "m1: 0.5\n" in content
    assert (low.plant.m1, high.plant.m1) == pytest.approx((0.45, 0.55) if is_guess else (0.5, 0.55))
    assert (low.plant.m2, high.plant.m2) == pytest.approx(
        (0.9 * c1.m2, 1.1 * c1.m2) if is_guess else (c1.m2, c1.m2)
    )
    # The file has the last word on its loop; the rest of the loop is that of ``recorded``.
    names = "delay", "quantum1", "passive_limit"
    if LOOP in content:
        assert [(getattr(low.loop, name), getattr(high.loop, name)) for name in names] == [
            (0.02,) * 2,
            (0.001,) * 2,
            (0, 0),
        ]
    else:
        assert all(low.value(name) == recorded.low.value(name) for name in names)
    assert low.value("velocity_noise") == recorded.low.value("velocity_noise")
    saved = save_domain(tmp_path / "out-adapt.yml", found, "a test")
    again = resolve(domain=saved.name)
    for end, other in ((again.low, found.low), (again.high, found.high)):
        assert end.plant.values() == pytest.approx(other.plant.values())
        assert end.loop == other.loop
    assert again.design.values() == pytest.approx(found.design.values())


def test_a_recipe_takes_a_plant_by_its_name_or_itself():
    policy = load_policy("adaptive", "acrobot")
    by_name, itself = (run_recipe(policy, (), plant=plant) for plant in ("leaderboard", LEADERBOARD))
    assert by_name.plant.values() == pytest.approx(itself.plant.values())
    other = run_recipe(policy, (), plant="C.0").plant
    assert other.values() == pytest.approx(load_plant("C.0").frictionless().driven(policy.robot).values())
    lone = load_policy("ar-eapo", "acrobot")
    assert run_recipe(lone, (), plant="leaderboard").plant == run_recipe(lone, ()).plant


@pytest.mark.parametrize(
    ("successes", "stages", "best"),
    [
        # The first suffices; the second does not help; the third of four does not help; all four help.
        ([50], 1, 1), ([30, 20], 2, 1), ([30, 40, 40], 3, 2), ([10, 20, 30, 40], 4, 4), ([10, 20, 49], 3, 3),
    ],
)  # fmt: skip
def test_an_adaptation_keeps_the_best_so_far_and_ends_where_a_stage_does_not_help(
    tmp_path, monkeypatch, successes, stages, best
):
    made, policy, recipes, lines = load_policy("adaptive", "acrobot"), load_policy("ar-eapo", "acrobot"), [], []

    def refined(base, recipe, seed, report, **_):
        recipes.append(recipe)
        marked = dataclasses.replace(made.regulator, leave=10.0 + len(recipes))
        report(RefinementReport((), 1, 1, 1, 0.0, dataclasses.replace(made, regulator=marked), None, {}))

    monkeypatch.setattr(adapting, "run_recipe", refined)
    monkeypatch.setattr(adapting, "save_refined", lambda path, now, *_: write_pendulum_policy(path, now.policy, {}))
    judged = iter([*successes, -1])
    monkeypatch.setattr(adapting, "judge", lambda *_, **__: types.SimpleNamespace(successes=next(judged)))
    out = tmp_path / "mine.safetensors"
    found = adapt("acrobot", out, policy=policy, draws=50, watch=Watch(log=lines.append))
    assert recipes == ["adapt", *["recover"] * (stages - 1)]
    assert found.policy.regulator.leave == load_policy(str(out), "acrobot").regulator.leave == 10.0 + best
    assert (found.domain.name, found.result.successes) == ("recorded", -1)
    assert (f"{out} has the one before" in lines) == (best < stages)
