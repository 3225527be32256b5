/* Starts a study's page: embeds the plots of each part. */
(function (swingup) {
  "use strict";

  const data = JSON.parse(document.getElementById("data").textContent);
  const plots = data.plots.flatMap((items, part) =>
    items.map((item, index) => swingup.plots.embed(item, document.getElementById(`plot-${part}-${index}`))));

  swingup.ready = Promise.all(plots);
})((window.swingup = window.swingup || {}));
