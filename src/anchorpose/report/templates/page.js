"use strict";
(() => {
  const root = document.documentElement;
  const charts = [...document.querySelectorAll(".chart")].map(figure => ({
    figure,
    slider: figure.querySelector("input[type=range]"),
    readout: figure.querySelector(".readout"),
    clock: figure.dataset.clock,
    plots: figure.querySelector(".pictures-in-time"),
    readings: JSON.parse(figure.dataset.readings),
  }));
  const places = new Map();  // by session: the places of its groups of frames on the time axis

  // The values are read from the CSV link, so that page and file agree.
  function cellsOf(chart) {
    if (!chart.cells) {
      const text = decodeURIComponent(chart.figure.querySelector(".csv").href.split(",").slice(1).join(","));
      chart.cells = text.trimEnd().split("\n").slice(1).map(line => line.split(","));
    }
    return chart.cells;
  }

  const minus = text => text.replace("-", "\u2212");

  function numbers(row, reading) {
    const low = row[reading.low], high = row[reading.high];
    if (low === "") return reading.state === undefined ? "not known" : row[reading.state];
    const sigma = reading.sigma === undefined ? "" : row[reading.sigma];
    const digits = (low.split(".")[1] || "").length;
    const spread = sigma === "" ? "" : ` \u00b1 ${(1.96 * Number(sigma)).toFixed(digits)}`;
    const state = reading.state === undefined ? "" : `, ${row[reading.state]}`;
    return `${minus(low)}${low === high ? "" : ` to ${minus(high)}`}${spread}${reading.unit}${state}`;
  }

  function inWords(row, reading) {
    const content = reading.text === undefined ? numbers(row, reading) : row[reading.text];
    return content === "" ? "" : reading.label === "" ? content : `${reading.label} ${content}`;
  }

  function sentence(chart, index) {
    const row = cellsOf(chart)[index], [first, last, from, to] = row;
    const when = first === last ? `${from} s (frame ${first})` : `${from} to ${to} s (frames ${first} to ${last})`;
    return `${when}: ${chart.readings.map(reading => inWords(row, reading)).filter(Boolean).join("; ")}`;
  }

  // By an observer: asking each chart for its place after writing to another would lay out the page each time.
  const visible = new Set();
  const watcher = new IntersectionObserver(entries => {
    for (const entry of entries) visible[entry.isIntersecting ? "add" : "delete"](entry.target);
  });
  for (const chart of charts) watcher.observe(chart.figure);

  function placesOf(chart) {
    if (!places.has(chart.clock)) places.set(chart.clock, cellsOf(chart).map(row => Number(row[4])));
    return places.get(chart.clock);
  }

  // All charts of a session move together.
  function move(index, active) {
    const place = placesOf(active)[index];
    for (const chart of charts.filter(chart => chart.clock === active.clock)) {
      chart.figure.style.setProperty("--now", place);
      chart.figure.classList.add("reading");
      chart.slider.value = index;
      if (chart === active || visible.has(chart.figure)) chart.readout.textContent = sentence(chart, index);
    }
    active.slider.setAttribute("aria-valuetext", sentence(active, index));
  }

  function nearest(chart, event) {
    const place = placesOf(chart), box = chart.plots.querySelector(".ticks").getBoundingClientRect();
    const at = (event.clientX - box.left) / box.width;
    let low = 0, high = place.length - 1;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (place[middle] > at) high = middle; else low = middle;
    }
    return at - place[low] > place[high] - at ? high : low;
  }

  for (const chart of charts) {
    const here = event => move(nearest(chart, event), chart);
    chart.plots.addEventListener("pointermove", here);
    chart.plots.addEventListener("pointerdown", event => {
      if (!event.target.closest("a")) here(event);
    });
    chart.plots.addEventListener("click", event => {
      if (!event.target.closest("a")) chart.slider.focus({preventScroll: true});
    });
    chart.slider.addEventListener("input", () => move(Number(chart.slider.value), chart));
    chart.slider.addEventListener("focus", () => move(Number(chart.slider.value), chart));
  }

  // A link into a folded part unfolds it.
  function unfold() {
    const target = location.hash && document.getElementById(decodeURIComponent(location.hash.slice(1)));
    for (let part = target; part; part = part.parentElement) if (part.tagName === "DETAILS") part.open = true;
    if (target) target.scrollIntoView();
  }
  window.addEventListener("hashchange", unfold);
  unfold();

  const opened = [];
  window.addEventListener("beforeprint", () => {
    for (const part of document.querySelectorAll("details:not([open])")) { part.open = true; opened.push(part); }
  });
  window.addEventListener("afterprint", () => { while (opened.length) opened.pop().open = false; });
  root.classList.add("scripted");
})();
