"""The page in a real browser: what a visitor sees and does, and that its motion is Python's."""

import shutil
import time

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from policies import lone_policy
from swingup.benchmark.judge import judge
from swingup.benchmark.rules import CRITERIA
from swingup.common.text import one_line
from swingup.dynamics.dynamics import tip_height
from swingup.dynamics.integrate import rk4_step
from swingup.plant.plant import LEADERBOARD, NAMES, load_plant
from swingup.plant.robots import ROBOTS
from swingup.report.page import render_page

from .pages import EVIL, NASTY, make_evil_section, make_sections

playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
CHROMIUM = shutil.which("chromium")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")

OPTIONS = [
    "--no-sandbox", "--headless", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
]  # fmt: skip
DT = 0.002


@pytest.fixture(scope="module")
def sections():
    return make_sections()


@pytest.fixture(scope="module")
def address(sections, tmp_path_factory):
    file = tmp_path_factory.mktemp("report") / "report.html"
    file.write_text(render_page(sections), encoding="utf-8")
    return file.as_uri()


@pytest.fixture(scope="module")
def browser():
    with playwright.sync_playwright() as tool:
        chromium = tool.chromium.launch(executable_path=CHROMIUM, args=OPTIONS)
        yield chromium
        chromium.close()


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
def loaded(browser, address):
    page = open_page(browser, address)
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


def picture(page, selector):
    """A canvas's pixels, as text."""
    return page.evaluate("(selector) => document.querySelector(selector).toDataURL()", selector)


def drawn_numbers(page, figure, panel, name):
    """The numbers of a curve as its path shows them, by the panel's scales."""
    return np.array(
        page.evaluate(
            """([figure, panel, name]) => {
                const { range, width, height, plot } = eval(figure).panels[panel];
                const paths = [...plot.querySelectorAll("g[data-name] path")];
                const path = paths.find((each) => each.parentNode.dataset.name === name);
                const back = ([low, high], share) => low + share * (high - low);
                return path.getAttribute("d").slice(1).split("L").map((pair) => pair.split(" ").map(Number))
                    .map(([x, y]) => [back(range.x, (x - 58) / width), back(range.y, 1 - (y - 8) / height)]);
            }""",
            [figure, panel, name],
        )
    )


def wait_until(condition, seconds=10.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it did not happen"
        time.sleep(0.02)


def test_tables_and_plots_are_rendered(page, sections):
    # Two boards and two robots; published rows and two of ours.
    assert page.locator("table").count() == 4
    assert page.locator("tr.ours").count() == 8
    assert page.locator("tr.published").count() > 20
    names = page.locator("[data-plot]").evaluate_all("(all) => all.map((plot) => plot.dataset.plot)")
    assert names == 2 * ["robustness", "series", "phases"]
    bars = page.locator("#acrobot [data-plot=robustness] g[data-name='ar-eapo'] rect")
    row = next(row for row in sections[0].tables[1].rows if row.controller == "ar-eapo")
    height = page.evaluate("swingup.figures[0].panels[0].height")
    percent = [float(bar.get_attribute("height")) / height * 105 for bar in bars.all()]
    np.testing.assert_allclose(percent, [row.values[name] for name in CRITERIA], atol=1e-3)


def test_curves_are_the_runs(page, sections):
    rows = sections[0].shows[0].clean
    for panel, (name, values) in enumerate({"tip": None, "q1": rows.x[:, 0], "dq2": rows.x[:, 3]}.items()):
        if values is None:
            values = -0.2 * np.cos(rows.x[:, 0]) - 0.3 * np.cos(rows.x[:, :2].sum(axis=1))
        drawn = drawn_numbers(page, "swingup.players[0].figures.series", panel, f"{name}, undisturbed")
        # Places are rounded to a tenth of a pixel.
        np.testing.assert_allclose(drawn[:, 0], rows.time, atol=2e-3)
        np.testing.assert_allclose(drawn[:, 1], values, atol=np.ptp(values) / 500)


def test_a_drag_zooms_all_times_and_a_double_click_shows_the_whole(page):
    series, svg = (
        "swingup.players[0].figures.series",
        page.locator("#acrobot [data-plot=series] .panel-plot").nth(1),
    )
    svg.scroll_into_view_if_needed()
    box = svg.bounding_box()
    left, width = box["x"] + 58, box["width"] - 72  # without the margins
    page.mouse.move(left + 0.2 * width, box["y"] + 70)
    page.mouse.down()
    page.mouse.move(left + 0.4 * width, box["y"] + 70, steps=3)
    page.mouse.up()
    ranges = page.evaluate(f"{series}.panels.map(({{ range }}) => range.x)")
    np.testing.assert_allclose(ranges, 4 * [[2, 4]], atol=0.02)
    assert page.evaluate(f"{series}.back.hidden") is False
    page.mouse.dblclick(left + 0.5 * width, box["y"] + 70)
    np.testing.assert_allclose(page.evaluate(f"{series}.panels[0].range.x"), [0, 10], atol=0.02)


def test_the_pointer_shows_the_values_at_its_time(page, sections):
    svg = page.locator("#acrobot [data-plot=series] .panel-plot").nth(1)
    svg.scroll_into_view_if_needed()
    box = svg.bounding_box()
    page.mouse.move(box["x"] + 58 + 0.3 * (box["width"] - 72), box["y"] + 50)
    words = page.locator("#acrobot [data-plot=series] .tip div").all_inner_texts()
    assert words[0].startswith("time (s): 3")
    shown = dict(word.split(": ") for word in words[1:-1])
    row = round(100 * float(words[0].split(": ")[1]))
    assert float(shown["q1, undisturbed"]) == pytest.approx(sections[0].shows[0].clean.x[row, 0], rel=1e-3)


def test_the_page_explains_its_words(page):
    terms = page.locator(".primer dt").all_inner_texts()
    assert terms == ["Two links, one motor", "Acrobot and pendubot", "AR-EAPO", "Scores"]
    text = page.locator(".primer").inner_text()
    for words in ("at the elbow", "at the shoulder", "reinforcement learning", "RealAI score", "robustness score"):
        assert words in text
    assert page.locator(".primer").bounding_box()["height"] < 500  # at 1280 pixels: short
    assert page.locator(".primer ~ .robot").count() == 2  # it comes before the robots


def test_names_are_shown_as_they_are(page):
    assert page.locator(".choice span", has_text=NASTY).count() == 2
    assert page.locator("img").count() == 0
    assert page.locator(".aside", has_text="broken").count() == 2


def test_play_moves_and_pause_stops(page):
    canvas = "#acrobot [data-run=disturbed] canvas"
    button = page.locator("#acrobot [data-play]")
    before = picture(page, canvas)
    button.click()
    assert button.inner_text() == "Pause"
    wait_until(lambda: page.evaluate("swingup.players[0].time") > 0.3)
    button.click()
    stopped = page.evaluate("swingup.players[0].time")
    after = picture(page, canvas)
    assert after != before
    page.wait_for_timeout(150)
    assert page.evaluate("swingup.players[0].time") == stopped
    assert picture(page, canvas) == after


def test_play_ends_at_the_end_and_begins_again(page):
    page.evaluate("swingup.players[1].seek(9.9); swingup.players[1].play()")
    wait_until(lambda: not page.evaluate("swingup.players[1].playing"))
    assert page.evaluate("swingup.players[1].time") == pytest.approx(9.99)
    page.evaluate("swingup.players[1].play()")
    wait_until(lambda: 0 < page.evaluate("swingup.players[1].time") < 5)


def test_speed_scales_the_time(page):
    page.locator("#acrobot .transport select").select_option("0.1")
    page.evaluate("swingup.players[0].play()")
    page.wait_for_timeout(400)
    assert 0 < page.evaluate("swingup.players[0].time") < 0.2
    page.locator("#acrobot .transport select").select_option("1")


@pytest.mark.parametrize("index", [0, 1], ids=list(ROBOTS))
def test_the_slider_scrubs(page, sections, index):
    slider = page.locator(f"#{sections[index].robot} input[type=range]")
    show = sections[index].shows[0]
    for row in (0, 137, 820):
        slider.fill(f"{row / 100:.2f}")
        for run in ("undisturbed", "disturbed"):
            state = page.evaluate("([i, run]) => swingup.players[i].state(run)", [index, run])
            rows = getattr(show, "clean" if run == "undisturbed" else run)
            # Times are rounded to single precision as well: up to 5e-7 s of a motion at some 20 rad/s.
            np.testing.assert_allclose(state["x"], rows.x[row], rtol=0, atol=2e-5)
            np.testing.assert_allclose(state["u"], rows.u[row], rtol=1e-6, atol=1e-6)
        assert slider.get_attribute("aria-valuetext") == f"{row / 100:.2f} seconds"
        assert page.locator(f"#{sections[index].robot} [data-time]").inner_text() == f"{row / 100:.2f} s"
        # The marks in the time series and the phase portraits follow.
        root = page.locator(f"#{sections[index].robot}")
        assert root.locator("line.now").count() == 4
        assert root.locator("circle.now").count() == 4
        assert page.evaluate(f"swingup.players[{index}].figures.series.time") == pytest.approx(row / 100)
    slider.press("ArrowRight")
    assert page.evaluate(f"swingup.players[{index}].time") == pytest.approx(8.21)


def test_between_rows_states_are_interpolated(page, sections):
    page.evaluate("swingup.players[0].seek(0.505)")
    rows = sections[0].shows[0].clean
    state = page.evaluate("swingup.players[0].state('undisturbed')")
    np.testing.assert_allclose(state["x"], (rows.x[50] + rows.x[51]) / 2, rtol=1e-5)
    np.testing.assert_allclose(state["u"], rows.u[50], rtol=1e-6)  # held


def test_another_controller_changes_the_picture_and_the_plots(page, sections):
    page.locator("#acrobot .choice span", has_text=NASTY).click()
    assert NASTY in page.locator("#acrobot [data-run=undisturbed] canvas").get_attribute("aria-label")
    drawn = drawn_numbers(page, "swingup.players[0].figures.series", 1, "q1, undisturbed")
    assert np.abs(drawn[:, 1]).max() < 0.05  # it hangs


def test_a_click_on_a_time_series_moves_the_time(page):
    plot = page.locator("#acrobot [data-plot=series]")
    plot.scroll_into_view_if_needed()
    box = plot.bounding_box()
    page.mouse.click(box["x"] + box["width"] / 2, box["y"] + 100)
    wait_until(lambda: 3 < page.evaluate("swingup.players[0].time") < 7)


def test_the_legend_hides_bars(page):
    bars = page.locator("#acrobot g[data-name='ar-eapo']")
    assert bars.count() == 1
    root = page.locator("#acrobot [data-plot=robustness] label:text-is('ar-eapo') input")
    root.uncheck()
    assert bars.count() == 0
    root.check()


@pytest.mark.parametrize("index", [0, 1], ids=list(ROBOTS))
def test_the_live_pendulum_swings_up_and_recovers_from_a_pull(page, sections, index):
    section = sections[index]
    live, canvas = f"swingup.live.{section.robot}", page.locator(f"#{section.robot} .live canvas")
    canvas.scroll_into_view_if_needed()
    before = picture(page, f"#{section.robot} .live canvas")
    page.locator(f"#{section.robot} [data-do=policy]").click()
    wait_until(lambda: page.evaluate(f"{live}.time") > 0.2)  # it runs by itself from then on
    assert picture(page, f"#{section.robot} .live canvas") != before
    page.evaluate(f"{live}.advance(8)")
    assert is_upright(page.evaluate(f"{live}.x"))
    freeze(page, live)  # what a pull does depends on its length
    box = canvas.bounding_box()
    middle, scale = box["x"] + box["width"] / 2, box["width"] / 1.15  # 1 m is the full height of the picture
    shoulder, top = box["y"] + box["height"] / 2, box["y"] + box["height"] * (0.5 - 0.5 / 1.15)

    def tip():
        angles = page.evaluate(f"{live}.x")[:2]
        return 0.2 * np.sin(angles[0]) + 0.3 * np.sin(sum(angles))

    before = tip()
    page.mouse.move(middle + scale * before, top + 3)
    page.mouse.down()
    page.mouse.move(middle + scale * (before + 0.06), top + 3, steps=5)
    page.evaluate(f"{live}.advance(0.4)")
    assert tip() > before + 0.02
    page.mouse.up()
    assert page.evaluate(f"{live}.hand") is None
    page.evaluate(f"{live}.advance(8)")
    assert is_upright(page.evaluate(f"{live}.x"))
    # Pulled all the way down and held there, it swings up again.
    page.mouse.move(middle + scale * tip(), top + 3)
    page.mouse.down()
    page.mouse.move(middle + 0.3 * scale, shoulder)
    page.evaluate(f"{live}.advance(1)")
    page.mouse.move(middle, shoulder + 0.5 * scale, steps=3)
    page.evaluate(f"{live}.advance(2)")
    height = float(tip_height(LEADERBOARD.driven(ROBOTS[section.robot]), jnp.array(page.evaluate(f"{live}.x"))))
    assert height < -0.2  # well below the shoulder, although the policy pulls, too
    page.mouse.up()
    page.evaluate(f"{live}.advance(8)")
    assert is_upright(page.evaluate(f"{live}.x"))


def test_pushes_act_on_both_joints_and_pass(page):
    for robot in ROBOTS:
        live = f"swingup.live.{robot}"
        page.evaluate(f"{live}.push([3, 0], 0.02); {live}.pause(); {live}.advance(0.002)")
        first = page.evaluate(f"{live}.x")
        with jax.enable_x64(True):
            parameters = LEADERBOARD.driven(ROBOTS[robot])
            expected = rk4_step(parameters, jnp.zeros(4), jnp.array([3.0, 0.0]), DT)
        np.testing.assert_allclose(first, expected, atol=1e-14)
        page.evaluate(f"{live}.push([0, -2], 0.02); {live}.pause(); {live}.advance(0.1)")
        assert page.evaluate(f"{live}.pushes.length") == 0
        assert page.evaluate(f"{live}.u") == [0, 0]


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
    for of_force, of_torque in power:
        assert of_force == pytest.approx(of_torque, rel=1e-12)


def test_live_buttons(page):
    root, live = page.locator("#pendubot .live"), "swingup.live.pendubot"
    page.evaluate(f"{live}.advance(1)")
    assert page.evaluate(f"{live}.x") == [0, 0, 0, 0]  # it hangs without a policy
    root.locator("[data-do=policy]").click()
    assert root.locator("[data-do=policy]").inner_text() == "Motor off"
    root.locator("[data-do=policy]").click()
    assert root.locator("[data-do=policy]").inner_text() == "Swing up"
    root.locator("[data-do=reset]").click()
    root.locator("[data-do=right]").press("Enter")
    assert root.locator("[data-do=pause]").inner_text() == "Pause"
    page.evaluate(f"{live}.advance(0.2)")
    assert page.evaluate(f"{live}.x")[0] > 0.005
    root.locator("[data-do=pause]").click()
    stopped = page.evaluate(f"{live}.time")
    page.wait_for_timeout(100)
    assert page.evaluate(f"{live}.time") == stopped
    root.locator("[data-do=reset]").click()
    assert page.evaluate(f"[{live}.time, ...{live}.x]") == [0, 0, 0, 0, 0]


def is_upright(x):
    error = np.array(x) - [np.pi, 0, 0, 0]
    error[:2] = (error[:2] + np.pi) % (2 * np.pi) - np.pi
    return bool(np.all(np.abs(error) < [0.35, 0.35, 1.0, 1.0]))


def test_one_step_is_pythons(page):
    random = np.random.default_rng(0)
    x = random.uniform([-7, -7, -15, -15], [7, 7, 15, 15], (300, 4))
    u = random.uniform(-6, 6, (300, 2))
    parameters = load_plant("C.1")  # with frictions and the motors' inertia
    values = {name: float(getattr(parameters, name)) for name in NAMES}
    ours = page.evaluate(
        "([p, x, u, dt]) => x.map((state, i) => swingup.physics.rk4Step(p, state, u[i], dt))",
        [values, x.tolist(), u.tolist(), DT],
    )
    with jax.enable_x64(True):
        expected = jax.vmap(rk4_step, (None, 0, 0, None))(parameters, jnp.asarray(x), jnp.asarray(u), DT)
    np.testing.assert_allclose(ours, expected, rtol=0, atol=1e-12)


def test_a_second_without_a_controller_is_pythons(page, robot):
    steps, amplitude = 500, np.array(robot.actuation) * 3.0
    rows = page.evaluate(
        "([robot, a]) => swingup.simulate(robot, [0, 0, 0, 0], 500, (x, t) => a.map((v) => v * Math.sin(6 * t)))",
        [robot.name, amplitude.tolist()],
    )
    with jax.enable_x64(True):
        parameters, x = LEADERBOARD.driven(robot), jnp.zeros(4)
        step = jax.jit(rk4_step)
        for k in range(steps):
            np.testing.assert_allclose(rows["x"][k], x, rtol=0, atol=1e-9)
            x = step(parameters, x, jnp.asarray(amplitude * np.sin(6 * (k * DT))), DT)
    np.testing.assert_allclose(rows["final"], x, rtol=0, atol=1e-9)


def test_torques_are_clipped_and_passive_joints_have_none(page, robot):
    rows = page.evaluate("(robot) => swingup.simulate(robot, [0, 0, 0, 0], 2, () => [9, -9])", robot.name)
    assert rows["u"][0] == ([6, 0] if robot.joint == 0 else [0, -6])


def in_double(controller):
    """The controller with a network that computes in double precision throughout, as the page does."""
    actor = jax.tree.map(lambda leaf: np.asarray(leaf, np.float64), controller.policy.actor)
    return eqx.tree_at(lambda c: c.policy.actor, controller, actor)


def test_the_closed_loop_is_pythons(page, robot):
    steps = 5000
    rows = page.evaluate("(robot) => swingup.simulate(robot, [0, 0, 0, 0], 5000)", robot.name)
    expected = judge(in_double(lone_policy("ar-eapo", robot)[0]), robot).trajectory
    assert len(rows["x"]) == steps == len(expected.time)
    np.testing.assert_allclose(rows["time"], expected.time, rtol=0, atol=1e-12)
    # Both compute in double precision. A torque that is wrong by 1e-3 N m (4e-3 rad) or late by one step (0.2 rad)
    # is far beyond. Upright, the loop forgets.
    np.testing.assert_allclose(rows["x"], expected.x, rtol=0, atol=1e-8)
    np.testing.assert_allclose(rows["x"][-1], expected.x[-1], rtol=0, atol=1e-9)
    np.testing.assert_allclose(rows["u"], expected.u, rtol=0, atol=1e-7)


def test_the_live_pendulum_hangs_until_it_is_asked(browser, address):
    page = open_page(browser, address)
    page.wait_for_timeout(200)
    state = page.evaluate("Object.values(swingup.live).map((live) => [live.time, live.policyOn])")
    assert state == [[0, False], [0, False]]
    page.locator("#acrobot [data-do=policy]").click()
    wait_until(lambda: page.evaluate("swingup.live.acrobot.time") > 0.1)
    assert page.evaluate("swingup.live.pendubot.time") == 0
    page.close()


def test_foreign_names_run_no_code(browser, tmp_path):
    file = tmp_path / "evil.html"
    file.write_text(render_page([make_evil_section()], title=f"Evil {EVIL[0]}"), encoding="utf-8")
    page = open_page(browser, file.as_uri())
    for index in range(len(EVIL)):
        page.evaluate(f"document.querySelectorAll('.choice input')[{index}].click()")
    plot = page.locator("[data-plot=robustness] .panel-plot")
    plot.scroll_into_view_if_needed()
    box = plot.bounding_box()
    tips = set()
    for x in range(70, 270, 8):  # the bars of the first criterion
        page.mouse.move(box["x"] + x, box["y"] + 0.6 * box["height"])
        page.wait_for_timeout(20)
        tips.update(
            text.rsplit(": ", 1)[0] for text in page.locator("[data-plot=robustness] .tip div").all_inner_texts()
        )
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


@pytest.mark.parametrize(("key", "force"), [("ArrowRight", [1, 0]), ("ArrowLeft", [-1, 0]), ("ArrowUp", [0, 1])])
def test_an_arrow_key_pushes_the_tip(page, robot, key, force):
    live, canvas = f"swingup.live.{robot.name}", page.locator(f"#{robot.name} .live canvas")
    start = [0.7, -0.4, 0, 0]
    canvas.focus()
    freeze(page, live)
    page.evaluate("addEventListener('keydown', (event) => (window.taken = event.defaultPrevented), { once: true })")
    page.evaluate(f"{live}.x = {start}")
    before = picture(page, f"#{robot.name} .live canvas")
    canvas.press(key)
    page.evaluate(f"{live}.advance(0.002)")
    assert page.evaluate("window.taken")  # the key does not scroll as well
    assert picture(page, f"#{robot.name} .live canvas") != before  # the push shows
    expected = page.evaluate(
        """([robot, x, force]) => {
            const p = swingup.robots[robot].parameters;
            return swingup.physics.rk4Step(p, x, swingup.physics.torqueOfForce(p, x, 1, p.l2, force), 0.002);
        }""",
        [robot.name, start, force],
    )
    assert page.evaluate(f"{live}.x") == expected
    page.evaluate(f"{live}.advance(0.2)")
    assert page.evaluate(f"{live}.pushes.length") == 0


def test_an_upright_pendulum_recovers_from_arrow_keys(page, robot):
    live, root = f"swingup.live.{robot.name}", page.locator(f"#{robot.name} .live")
    root.locator("[data-do=policy]").click()
    freeze(page, live)
    page.evaluate(f"{live}.advance(8)")
    assert is_upright(page.evaluate(f"{live}.x"))
    root.locator("[data-do=policy]").press("ArrowRight")  # the focus is on the button
    page.evaluate(f"{live}.advance(0.1)")
    assert not np.allclose(page.evaluate(f"{live}.x.slice(2)"), 0, atol=0.05)
    page.evaluate(f"{live}.advance(8)")
    assert is_upright(page.evaluate(f"{live}.x"))


def test_arrow_keys_outside_a_pendulum_keep_their_meaning(page):
    slider = page.locator("#acrobot input[type=range]")
    slider.scroll_into_view_if_needed()
    slider.press("ArrowRight")
    page.locator("#acrobot .choice input").first.press("ArrowRight")
    assert page.evaluate("Object.values(swingup.live).map((live) => live.pushes.length)") == [0, 0]


def test_narrow_and_dark(page):
    light = picture(page, "#acrobot .live canvas")
    page.emulate_media(color_scheme="dark")
    wait_until(lambda: picture(page, "#acrobot .live canvas") != light)
    page.set_viewport_size({"width": 360, "height": 740})
    page.wait_for_timeout(100)
    assert page.evaluate("document.documentElement.scrollWidth") <= 360
    page.emulate_media(color_scheme="light")
    page.set_viewport_size({"width": 1280, "height": 900})
