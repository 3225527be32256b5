/* Starts the page: one player, one live pendulum and the figures of each robot, or the figures of a report about logs. */
(function (swingup) {
  "use strict";

  const data = JSON.parse(document.getElementById("data").textContent);

  Object.assign(swingup, { robots: {}, players: [], live: {}, figures: [] });

  for (const section of data.sections) {
    const act = section.policy && swingup.makePolicy(section.policy, section.driven);
    const { parameters, dt, substeps, driven } = section;
    const robot = { parameters, dt, substeps, driven, act };
    swingup.robots[section.robot] = robot;
    const root = document.getElementById(section.robot);
    const [live, player, robustness] = [".live", ".player", "[data-plot=robustness]"].map((name) => root.querySelector(name));
    if (live) {
      swingup.live[section.robot] = new swingup.Live(live, section, robot);
    }
    if (player) {
      swingup.players.push(new swingup.Player(player, section));
    }
    if (robustness) {
      swingup.figures.push(new swingup.Figure(robustness, section.robustness));
    }
  }
  data.figures.forEach((figure, part) => {
    if (figure) {
      swingup.figures.push(new swingup.Figure(document.getElementById(`plot-${part}`), figure));
    }
  });
})((window.swingup = window.swingup || {}));
