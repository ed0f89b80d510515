"use strict";
// Draws every figure, keeps their time axes the same, and leads one hairline down the page.
(async () => {
  const options = { displayModeBar: false, responsive: true, doubleClick: "reset" };
  const plots = [...document.querySelectorAll(".plot")];
  // Those that stand alone have an x axis of their own: a stretch of time, a distance, no time at all.
  const timed = plots.filter((plot) => !("alone" in plot.dataset));
  let following = false;

  async function follow(leader) {
    if (following) return;
    following = true;
    const range = [...leader.layout.xaxis.range];
    for (const plot of timed) {
      const own = plot.layout && plot.layout.xaxis.range;
      if (own && (own[0] !== range[0] || own[1] !== range[1])) {
        await Plotly.relayout(plot, { "xaxis.range": [...range] });
      }
    }
    following = false;
  }

  for (const plot of plots) {
    const figure = JSON.parse(document.getElementById("data-" + plot.dataset.figure).textContent);
    await Plotly.newPlot(plot, figure.data, figure.layout, options);
    if (timed.includes(plot)) plot.on("plotly_relayout", () => follow(plot));
  }

  // A drive's way from above: a ring shows where the car is at the time pointed at.
  const map = plots.find((plot) => plot.layout && plot.layout.meta && "here" in plot.layout.meta);
  async function locate(time_s) {
    const { way, here } = map.layout.meta;
    const { x, y, customdata } = map.data[way];
    const at = customdata.findIndex((told) => told[0] >= time_s);
    const row = at < 0 ? customdata.length - 1 : at;
    await Plotly.restyle(map, { x: [[x[row]]], y: [[y[row]]] }, [here]);
  }
  if (map) timed.forEach((plot) => plot.on("plotly_hover", (event) => locate(event.points[0].x)));

  // On paper every figure is as wide as page.css makes the page, whatever the window was.
  const resize = (width) => plots.forEach((plot) => Plotly.relayout(plot, { width, autosize: !width }));
  window.addEventListener("beforeprint", () => resize(1164));
  window.addEventListener("afterprint", () => resize(null));

  // All timed figures have the same margins, so one line marks the same moment in each of them.
  const main = document.querySelector("main");
  const hairline = document.getElementById("hairline");
  main.addEventListener("mousemove", (event) => {
    const over = timed.includes(event.target.closest(".plot"));
    hairline.style.display = over ? "block" : "none";
    if (!over) return;
    const first = timed[0].getBoundingClientRect();
    const last = timed[timed.length - 1].getBoundingClientRect();
    const frame = main.getBoundingClientRect();
    hairline.style.left = event.clientX - frame.left + "px";
    hairline.style.top = first.top - frame.top + "px";
    hairline.style.bottom = frame.bottom - last.bottom + "px";
  });
  main.addEventListener("mouseleave", () => { hairline.style.display = "none"; });
  document.documentElement.dataset.drawn = String(plots.length);
})();
