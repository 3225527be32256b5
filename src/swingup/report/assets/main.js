/* Starts the page: one player, one live pendulum and the plots of each robot. */
(function (swingup) {
  "use strict";

  const data = JSON.parse(document.getElementById("data").textContent);
  const plots = [];

  swingup.robots = {};
  swingup.players = [];
  swingup.live = {};

  for (const section of data.sections) {
    const act = section.policy && swingup.makePolicy(section.policy, section.driven);
    const robot = { parameters: section.parameters, dt: section.dt, driven: section.driven, act };
    swingup.robots[section.robot] = robot;
    const root = document.getElementById(section.robot);
    const [live, player, robustness] = [".live", ".player", ".robustness"].map((name) => root.querySelector(name));
    if (live) {
      swingup.live[section.robot] = new swingup.Live(live, section, robot);
    }
    if (player) {
      swingup.players.push(new swingup.Player(player, section));
      plots.push(swingup.plots.followPlayer(player, section.plots, swingup.players.at(-1)));
    }
    if (robustness) {
      plots.push(swingup.plots.robustnessBars(robustness, section.plots.robustness));
    }
  }

  swingup.ready = Promise.all(plots);
})((window.swingup = window.swingup || {}));
