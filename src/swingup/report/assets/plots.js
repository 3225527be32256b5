/* Embeds Bokeh's plots, fills them with the player's runs, and gives them the style sheet's colours. */
(function (swingup) {
  "use strict";

  /** Columns of a run for Bokeh's sources, made once. */
  function columnsOf(run, parameters) {
    if (!run) {
      return { t: [], q1: [], q2: [], dq1: [], dq2: [], u1: [], u2: [], height: [] };
    }
    if (!run.columns) {
      const take = (rows, width, i) => run.time.map((_, row) => rows[width * row + i]);
      run.columns = { t: run.time, u1: take(run.u, 2, 0), u2: take(run.u, 2, 1) };
      ["q1", "q2", "dq1", "dq2"].forEach((name, i) => (run.columns[name] = take(run.x, 4, i)));
      const state = (row) => run.x.subarray(4 * row, 4 * row + 4);
      run.columns.height = run.time.map((_, row) => swingup.physics.tipHeight(parameters, state(row)));
    }
    return run.columns;
  }

  /** Models of a plot's document by their name. */
  function named(models, name) {
    return models.filter((model) => model.name === name);
  }

  /** Embed one plot and return its models. */
  async function embed(item, element) {
    const views = await Bokeh.embed.embed_item(item, element);
    const models = [...views.roots[0].model.document.all_models];
    paint(models);
    swingup.dark.addEventListener("change", () => paint(models));
    return models;
  }

  /** Colours of the style sheet for axes, grids, and all glyphs and lines that are tagged with a variable. */
  function paint(models) {
    const style = getComputedStyle(document.documentElement);
    const read = (name) => style.getPropertyValue(name).trim();
    const [ink, muted, guide] = ["--ink", "--muted", "--guide"].map(read);
    for (const model of models) {
      if (model.type.endsWith("Axis")) {
        Object.assign(model, {
          axis_line_color: guide, major_tick_line_color: guide, major_label_text_color: muted, axis_label_text_color: ink,
        });
      } else if (model.type === "Grid") {
        model.grid_line_color = guide;
        model.grid_line_alpha = 0.7;
      } else if (model.type === "Span" && model.tags.length) {
        model.line_color = read(model.tags[0]);
      } else if (model.tags.length && String(model.tags[0]).startsWith("--")) {
        const colour = read(model.tags[0]);
        ["fill_color", "line_color"].filter((name) => name in model).forEach((name) => (model[name] = colour));
      }
    }
  }

  /** The plots that follow a player: time series and phase portraits. */
  async function followPlayer(root, items, player) {
    const { parameters } = player.section;
    const elements = [...root.querySelectorAll("[data-plot]")].filter((element) => items[element.dataset.plot]);
    const parts = await Promise.all(elements.map((element) => embed(items[element.dataset.plot], element)));
    const models = parts.flat();
    const spans = named(models, "now");

    function showRun() {
      for (const run of ["clean", "disturbed"]) {
        named(models, run)
          .filter((model) => model.type === "ColumnDataSource")
          .forEach((source) => (source.data = columnsOf(player.show.runs[run], parameters)));
      }
      const others = player.shows.filter((show) => show !== player.show && show.runs.clean);
      const columns = others.map((show) => columnsOf(show.runs.clean, parameters));
      const data = { t: columns.map(({ t }) => t), height: columns.map(({ height }) => height) };
      named(models, "others").forEach((source) => (source.data = data));
    }

    function showTime() {
      spans.forEach((span) => (span.location = player.time));
      for (const run of ["clean", "disturbed"]) {
        const state = player.state(run);
        const [q1, q2, dq1, dq2] = state ? state.x.map((value) => [value]) : [[], [], [], []];
        named(models, `${run}-now`).forEach((source) => (source.data = { q1, q2, dq1, dq2 }));
      }
    }

    player.watchers.push((_, what) => (what === "show" ? showRun() : showTime()));
    models
      .filter((model) => model.type === "Figure" && model.tags.includes("time"))
      .forEach((figure) => figure.on_event("tap", (event) => player.seek(event.x)));
    showRun();
    showTime();
    return models;
  }

  /** The bars of the robustness criteria; the legend's boxes show and hide controllers. */
  async function robustnessBars(root, item) {
    const models = await embed(item, root.querySelector("[data-plot=robustness]"));
    root.querySelectorAll("[data-series]").forEach((box) => {
      const bars = named(models, `bars-${box.dataset.series}`);
      const update = () => bars.forEach((model) => (model.visible = box.checked));
      box.addEventListener("change", update);
      update();
    });
    return models;
  }

  swingup.plots = { embed, followPlayer, robustnessBars, columnsOf };
})((window.swingup = window.swingup || {}));
