"use strict";
// Draws the plots of a report. `surefootReport` comes from data.js: groups of panels
// with their curves, labels of the runs, and moments to mark.
(() => {
  const report = window.surefootReport;
  const drawn = new Map();
  const hidden = { runs: new Set(), kinds: new Set() };
  const LEGEND_ROW = 18; // pixels; two names fit beside each other
  let range = null;

  const ink = (name) =>
    getComputedStyle(document.documentElement).getPropertyValue(name).trim();

  function axisOf(panel) {
    const axis = { gridcolor: ink("--line"), zeroline: false, fixedrange: false };
    if (panel.words.length === 0)
      return { ...axis, title: { text: `${panel.title} [${panel.unit}]` } };
    return {
      ...axis,
      title: { text: panel.title, standoff: 8 }, // beside the longest word
      automargin: true,
      tickvals: panel.words.map((_, row) => row),
      ticktext: panel.words,
      range: [-0.3, panel.words.length - 0.7],
    };
  }

  function layoutOf(panel) {
    return {
      autosize: true,
      height: 240 + LEGEND_ROW * Math.max(0, Math.ceil(panel.curves.length / 2) - 1),
      margin: { l: 66, r: 34, t: 8, b: 40 }, // buttons stand to the right of the curves
      paper_bgcolor: "rgba(0,0,0,0)",
      plot_bgcolor: "rgba(0,0,0,0)",
      font: { family: "system-ui, sans-serif", size: 12, color: ink("--ink") },
      legend: { orientation: "h", x: 0, y: 1.0, yanchor: "bottom", font: { size: 10 } },
      showlegend: true,
      modebar: {
        orientation: "v",
        bgcolor: ink("--page"),
        color: ink("--soft"),
        activecolor: ink("--ink"),
      },
      hovermode: "x unified",
      hoverlabel: { bgcolor: ink("--page"), font: { color: ink("--ink") } },
      dragmode: "zoom",
      xaxis: {
        title: { text: "time [s]", standoff: 4 },
        gridcolor: ink("--line"),
        zeroline: false,
        range: range ? [...range] : [...report.span],
        hoverformat: ".3f",
      },
      yaxis: axisOf(panel),
      shapes: report.marks.map((mark) => ({
        type: "line",
        xref: "x",
        yref: "paper",
        x0: mark.time,
        x1: mark.time,
        y0: 0,
        y1: 1,
        line: { color: mark.colour, width: 1, dash: "dashdot" },
        label: {
          text: mark.text,
          textposition: "start",
          font: { size: 10, color: mark.colour },
        },
      })),
    };
  }

  const isShown = (curve) =>
    !hidden.runs.has(curve.run) && !hidden.kinds.has(curve.kind);

  // The first run is drawn first and widest: where runs coincide, it shows on both sides.
  const widthOf = (curve) =>
    (curve.dash === "solid" ? 1.4 : 1.2) +
    (1.4 * (report.runs.length - 1 - curve.run)) / Math.max(report.runs.length - 1, 1);

  const traceOf = (panel, curve) => ({
    type: "scatter",
    mode: "lines",
    name: curve.name,
    x: curve.x,
    y: curve.y,
    visible: isShown(curve),
    line: {
      color: curve.colour,
      dash: curve.dash,
      width: widthOf(curve),
      shape: panel.words.length ? "hv" : "linear",
    },
  });

  async function draw(element, panel) {
    drawn.set(element, panel);
    element.style.position = "relative";
    await Plotly.newPlot(
      element,
      panel.curves.map((curve) => traceOf(panel, curve)),
      layoutOf(panel),
      {
        responsive: true,
        displaylogo: false,
        modeBarButtonsToRemove: ["select2d", "lasso2d", "autoScale2d"],
        toImageButtonOptions: { format: "svg", filename: panel.key },
      },
    );
    element.dataset.drawn = "yes";
    element.on("plotly_relayout", (change) => follow(element, change));
    element.on("plotly_hover", (event) => point(event.xvals[0]));
    element.on("plotly_unhover", () => point(null));
  }

  // All time axes show the same stretch.
  function follow(source, change) {
    let next;
    if ("xaxis.range[0]" in change)
      next = [change["xaxis.range[0]"], change["xaxis.range[1]"]];
    else if (Array.isArray(change["xaxis.range"])) next = change["xaxis.range"];
    else if (change["xaxis.autorange"]) next = report.span;
    else return;
    if (range && next[0] === range[0] && next[1] === range[1]) return;
    showTimes(next);
  }

  function showTimes(next) {
    range = [next[0], next[1]];
    for (const element of drawn.keys())
      if (element.dataset.drawn)
        Plotly.relayout(element, { "xaxis.range": [...range] });
  }

  // The moment under the mouse, in every plot.
  function point(time) {
    for (const element of drawn.keys()) {
      if (!element.dataset.drawn) continue;
      let line = element.querySelector(".cursor");
      if (!line) {
        line = document.createElement("div");
        line.className = "cursor";
        element.append(line);
      }
      const axis = element._fullLayout.xaxis;
      const place = time === null ? -1 : axis.l2p(time);
      line.hidden = place < 0 || place > axis._length;
      line.style.left = `${axis._offset + place}px`;
    }
  }

  function restyle() {
    for (const [element, panel] of drawn)
      if (element.dataset.drawn)
        Plotly.restyle(element, { visible: panel.curves.map(isShown) });
  }

  function addSwitch(bar, text, colour, set, value) {
    const label = document.createElement("label");
    const box = document.createElement("input");
    box.type = "checkbox";
    box.checked = true;
    box.addEventListener("change", () => {
      if (box.checked) set.delete(value);
      else set.add(value);
      restyle();
    });
    label.append(box, text);
    if (colour) label.style.color = colour;
    bar.append(label);
  }

  function addSwitches() {
    const bar = document.getElementById("switches");
    if (report.runs.length > 1)
      report.runs.forEach((run, index) =>
        addSwitch(bar, run.label, run.colour, hidden.runs, index));
    const kinds = new Set(
      report.groups.flatMap((group) =>
        group.panels.flatMap((panel) => panel.curves.map((curve) => curve.kind))));
    for (const kind of ["true", "estimated", "measured", "desired"])
      if (kinds.has(kind)) addSwitch(bar, kind, "", hidden.kinds, kind);
    const whole = document.createElement("button");
    whole.textContent = "whole run";
    whole.addEventListener("click", () => showTimes(report.span));
    bar.append(whole);
  }

  // Plots are drawn when they come into view: two dozen at once would take seconds.
  function watchPlots() {
    const panels = new Map(
      report.groups.flatMap((group) =>
        group.panels.map((panel) => [panel.key, panel])));
    const watcher = new IntersectionObserver(
      (entries) => {
        for (const entry of entries) {
          if (!entry.isIntersecting) continue;
          watcher.unobserve(entry.target);
          draw(entry.target, panels.get(entry.target.dataset.panel));
        }
      },
      { rootMargin: "400px" },
    );
    const plots = document.querySelectorAll("[data-panel]");
    for (const element of plots) watcher.observe(element);
    window.addEventListener("beforeprint", () => { // paper shows all of them
      watcher.disconnect();
      for (const element of plots)
        if (!drawn.has(element)) draw(element, panels.get(element.dataset.panel));
    });
  }

  function addRestart() {
    const button = document.getElementById("restart");
    if (!button) return;
    button.addEventListener("click", () => {
      for (const frame of document.querySelectorAll("iframe")) {
        frame.loading = "eager";
        frame.src = frame.getAttribute("src");
      }
    });
  }

  addSwitches();
  addRestart();
  watchPlots();
})();
