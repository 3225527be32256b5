"""The page in a real browser: what a visitor sees and does, and that its motion is Python's."""

import dataclasses
import time

import jax
import numpy as np
import pytest

from swingup.benchmark.boards import PERFORMANCE, ROBUSTNESS
from swingup.benchmark.judge import judge
from swingup.benchmark.robustness_board import CRITERIA, upright
from swingup.common.errors import one_line
from swingup.dynamics.integrate import rk4_steps, stable_substeps
from swingup.plant.files import load_plant
from swingup.plant.plant import NAMES
from swingup.report.page import render_page
from swingup.runtime import load_controller

from .pages import EVIL, NASTY, make_evil_section

DT = 0.002
steps = jax.jit(jax.vmap(rk4_steps, (None, 0, 0, None, None)), static_argnums=4)


@pytest.fixture(scope="module")
def address(sections, tmp_path_factory):
    file = tmp_path_factory.mktemp("report") / "report.html"
    file.write_text(render_page(sections), encoding="utf-8")
    return file.as_uri()


def open_page(browser, address, **options):
    """A page that notes what it asks for and complains about."""
    page = browser.new_page(viewport={"width": 1280, "height": 900}, **options)
    page.set_default_timeout(20_000)
    page.requests, page.complaints = [], []
    page.on("request", lambda request: page.requests.append(request.url))
    page.on("pageerror", lambda error: page.complaints.append(str(error)))
    page.on("dialog", lambda dialog: page.complaints.append(dialog.message))
    page.on("console", lambda note: note.type in ("error", "warning") and page.complaints.append(note.text))
    page.goto(address)
    return page


@pytest.fixture(scope="module")
def loaded(chromium, address):
    page = open_page(chromium, address)
    yield page
    page.close()


@pytest.fixture
def page(loaded, address):
    """The one page, at rest: nothing plays or runs; no test may make it complain or ask for anything."""
    loaded.evaluate("""() => {
        swingup.players.forEach((player) => { player.pause(); player.select(0); player.seek(0); });
        Object.values(swingup.live).forEach((live) => { delete live.run; live.reset(); });
    }""")
    yield loaded
    assert loaded.complaints == []
    assert set(loaded.requests) == {address}


def wait_until(condition, seconds=10.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it did not happen"
        time.sleep(0.02)


def test_what_is_drawn_is_what_was_measured(page, sections):
    rows = sections[0].shows[0].runs["undisturbed"]
    drawn, expected = page.evaluate(
        """([time, q1]) => {
        const panel = swingup.players[0].figures.series.panels[1];
        const path = panel.plot.querySelector("g[data-name='q1, undisturbed'] path").getAttribute("d");
        const points = path.slice(1).split("L").map((pair) => pair.split(" ").map(Number));
        return [points, time.map((t, row) => [panel.toX(t), panel.toY(q1[row])])];
    }""",
        [rows.time.tolist(), rows.x[:, 0].tolist()],
    )
    np.testing.assert_allclose(drawn, expected, atol=0.1)  # pixels
    bars = page.locator("#acrobot [data-plot=robustness] g[data-name='ar-eapo'] rect")
    row = next(row for row in sections[0].tables[1].rows if row.controller == "ar-eapo")
    height = page.evaluate("swingup.figures[0].panels[0].height")
    percent = [float(bar.get_attribute("height")) / height * 105 for bar in bars.all()]
    np.testing.assert_allclose(percent, [row.values[name] for name in CRITERIA], atol=1e-3)


def test_a_visitor_plays_chooses_and_swings_up(page, either_robot):
    name, button = either_robot.name, page.locator(f"#{either_robot.name} [data-play]")
    player, live = f"swingup.players[{either_robot.joint == 0:d}]", f"swingup.live.{name}"
    button.click()
    wait_until(lambda: page.evaluate(f"{player}.time") > 0.3)
    button.click()
    stopped = page.evaluate(f"{player}.time")
    page.wait_for_timeout(100)
    assert page.evaluate(f"{player}.time") == stopped
    page.locator(f"#{name} .choice span", has_text=NASTY).click()
    assert page.evaluate(f"{player}.state('undisturbed').x") == [0, 0, 0, 0]  # it hangs
    page.evaluate(f"{live}.advance(1)")
    assert page.evaluate(f"{live}.x") == [0, 0, 0, 0]  # until it is asked
    page.locator(f"#{name} [data-do=policy]").click()
    wait_until(lambda: page.evaluate(f"{live}.time") > 0.2)
    for do in (None, "right"):  # the policy recovers from a push
        if do is not None:
            page.locator(f"#{name} [data-do={do}]").press("Enter")
        page.evaluate(f"{live}.advance(8)")
        assert upright(np.array([page.evaluate(f"{live}.x")]), ROBUSTNESS.tolerance).all()


def test_the_slider_scrubs(page, sections):
    root, show = page.locator("#acrobot"), sections[0].shows[0]
    slider = root.locator("input[type=range]")
    for row in (0, 137, 820):
        slider.fill(f"{row / 100:.2f}")
        for run, rows in show.runs.items():
            state = page.evaluate("(run) => swingup.players[0].state(run)", run)
            # Times are rounded to single precision as well: up to 5e-7 s of a motion at some 20 rad/s.
            np.testing.assert_allclose(state["x"], rows.x[row], rtol=0, atol=2e-5)
            np.testing.assert_allclose(state["u"], rows.u[row], rtol=1e-6, atol=1e-6)
        assert root.locator("[data-time]").inner_text() == f"{row / 100:.2f} s"
        # The marks in the time series and the phase portraits follow.
        assert (root.locator("line.now").count(), root.locator("circle.now").count()) == (4, 4)
        assert page.evaluate("swingup.players[0].figures.series.time") == pytest.approx(row / 100)
    slider.press("ArrowRight")
    assert page.evaluate("swingup.players[0].time") == pytest.approx(8.21)
    page.evaluate("swingup.players[0].seek(0.505)")  # between rows
    state, rows = page.evaluate("swingup.players[0].state('undisturbed')"), show.runs["undisturbed"]
    np.testing.assert_allclose(state["x"], (rows.x[50] + rows.x[51]) / 2, rtol=1e-5)
    np.testing.assert_allclose(state["u"], rows.u[50], rtol=1e-6)  # held


def test_a_force_is_a_joint_torque_by_the_jacobian(page):
    # Power of the force on the point's velocity = power of the torques on the joints' rates.
    power = page.evaluate("""() => {
        const p = swingup.robots.acrobot.parameters, x = [0.3, -1.1, 2.0, -3.0], force = [1.5, -0.7];
        return [[0, 0.12], [1, 0.25]].map(([link, along]) => {
            const { velocity } = swingup.physics.pointOn(p, x, link, along);
            const torque = swingup.physics.torqueOfForce(p, x, link, along, force);
            return [velocity[0] * force[0] + velocity[1] * force[1], x[2] * torque[0] + x[3] * torque[1]];
        });
    }""")
    np.testing.assert_allclose(*np.transpose(power), rtol=1e-12)


def test_steps_are_pythons(page):
    random = np.random.default_rng(0)
    x = random.uniform([-7, -7, -15, -15], [7, 7, 15, 15], (300, 4))
    u = random.uniform(-6, 6, (300, 2))
    for name, number in (("C.1", 1), ("cloudpendulum", 4)):  # with frictions and the motors' inertia
        plant = load_plant(name)
        assert stable_substeps(plant, DT) == number
        ours = page.evaluate(
            "([p, x, u, dt, n]) => x.map((state, i) => swingup.physics.rk4Step(p, state, u[i], dt, n))",
            [{name: float(getattr(plant, name)) for name in NAMES}, x.tolist(), (u / 100).tolist(), DT, number],
        )
        with jax.enable_x64(True):
            np.testing.assert_allclose(ours, steps(plant, x, u / 100, DT, number), rtol=1e-9, atol=1e-12)
    for robot, acting in (("pendubot", [6, 0]), ("acrobot", [0, -6])):  # clipped, and none on passive joints
        rows = page.evaluate("(robot) => swingup.simulate(robot, [0, 0, 0, 0], 2, () => [9, -9])", robot)
        assert rows["u"][0] == acting
    rows = page.evaluate("swingup.simulate('acrobot', [0, 0, 0, 0], 3, (x, t) => [0, t])")
    assert rows["u"] == [[0, 0], [0, DT], [0, 2 * DT]]


def test_the_closed_loop_is_pythons(page, either_robot):
    robot, rules = either_robot, dataclasses.replace(PERFORMANCE, duration=3.0)
    rows = page.evaluate("(robot) => swingup.simulate(robot, [0, 0, 0, 0], 1500)", robot.name)
    expected = judge(load_controller("ar-eapo", robot.name), robot, rules).trajectory
    assert len(rows["x"]) == 1500 == len(expected.time)
    np.testing.assert_allclose(rows["time"], expected.time, rtol=0, atol=1e-12)
    # Both compute in double precision. A torque that is wrong by 1e-3 N m (4e-3 rad) or late by one step (0.2 rad)
    # is far beyond. Upright, the loop forgets.
    np.testing.assert_allclose(rows["x"], expected.x, rtol=0, atol=1e-8)
    np.testing.assert_allclose(rows["x"][-1], expected.x[-1], rtol=0, atol=1e-9)
    np.testing.assert_allclose(rows["u"], expected.u, rtol=0, atol=1e-7)


def test_foreign_names_run_no_code(chromium, tmp_path):
    file = tmp_path / "evil.html"
    file.write_text(render_page([make_evil_section()], title=f"Evil {EVIL[0]}"), encoding="utf-8")
    page = open_page(chromium, file.as_uri())
    for index in range(len(EVIL)):
        page.evaluate(f"document.querySelectorAll('.choice input')[{index}].click()")
    tip, tips = page.locator("[data-plot=robustness] .tip div"), set()
    for bars in page.locator("[data-plot=robustness] g[data-name]").all():
        bars.locator("rect").first.hover(force=True)
        page.wait_for_timeout(20)
        tips.update(text.rsplit(": ", 1)[0] for text in tip.all_inner_texts())
    assert len(tips & {one_line(name) for name in EVIL}) >= 3  # as text, where names of ours stand alone
    assert page.evaluate("window.attacked") is None
    assert page.complaints == []
    assert set(page.requests) == {file.as_uri()}
    assert page.locator(".choice span").all_inner_texts() == [one_line(name) for name in EVIL]
    page.close()


def freeze(page, live):
    """From here on time passes only as the test lets it, until the next test."""
    page.evaluate(f"{live}.run = () => null; {live}.pause()")
    wait_until(lambda: not page.evaluate(f"{live}.running"))


def picture(page, selector):
    return page.evaluate("(selector) => document.querySelector(selector).toDataURL()", selector)


def test_an_arrow_key_pushes_the_tip(page):
    live, canvas, start = "swingup.live.acrobot", page.locator("#acrobot .live canvas"), [0.7, -0.4, 0, 0]
    canvas.focus()
    freeze(page, live)
    page.evaluate(f"{live}.x = {start}")
    before = picture(page, "#acrobot .live canvas")
    canvas.press("ArrowLeft")
    page.evaluate(f"{live}.advance(0.002)")
    assert picture(page, "#acrobot .live canvas") != before  # the push shows
    pushed = """(x) => {
        const p = swingup.robots.acrobot.parameters;
        return swingup.physics.rk4Step(p, x, swingup.physics.torqueOfForce(p, x, 1, p.l2, [-1, 0]), 0.002);
    }"""
    assert page.evaluate(f"{live}.x") == page.evaluate(pushed, start)
    page.evaluate(f"{live}.advance(0.2)")
    assert page.evaluate(f"{live}.pushes.length") == 0
    page.locator("#acrobot input[type=range]").press("ArrowRight")  # outside of the pendulum it means what it meant
    assert page.evaluate(f"{live}.pushes.length") == 0


def test_live_buttons(page):
    root, live = page.locator("#pendubot .live"), "swingup.live.pendubot"
    assert page.evaluate(f"[{live}.time, {live}.policyOn]") == [0, False]  # it hangs until it is asked
    page.evaluate(f"{live}.advance(1)")
    assert page.evaluate(f"{live}.x") == [0, 0, 0, 0]
    for name in ("Motor off", "Swing up"):
        root.locator("[data-do=policy]").click()
        assert root.locator("[data-do=policy]").inner_text() == name
    root.locator("[data-do=reset]").click()
    root.locator("[data-do=right]").press("Enter")
    page.evaluate(f"{live}.advance(0.2)")
    assert page.evaluate(f"{live}.x")[0] > 0.005
    root.locator("[data-do=pause]").click()
    stopped = page.evaluate(f"{live}.time")
    page.wait_for_timeout(100)
    assert page.evaluate(f"{live}.time") == stopped
    root.locator("[data-do=reset]").click()
    assert page.evaluate(f"[{live}.time, ...{live}.x]") == [0, 0, 0, 0, 0]
