"use strict";
/* Charts over time that share one time axis: range, cursor and marked time are those of all. */

const CHART_HEIGHT = 190;
const MARGIN = { left: 54, right: 8, top: 8, bottom: 24 }; // of the plotted area, as in report.css
const MIN_DRAG = 4; // pixels; a shorter drag is a click
const MIN_RANGE = 1e-4; // of the whole time
const CHART_HELP = "Left and right move the cursor, plus and minus zoom, 0 shows all.";

/**
 * Charts of `all` data; `clicked(time)` is called where one is clicked, or at its cursor by Enter.
 * `mark` shows a time in each; `refresh` draws data that have changed.
 */
function linkedCharts(all, clicked = () => {}) {
  const wholeOf = () => extentOf(all.map((each) => each.time));
  let whole = wholeOf();
  const shared = { range: whole, cursor: null, marked: null };
  const reset = make("button", { type: "button", class: "whole", hidden: true, onclick: showAll }, "Show all of the time");
  const charts = all.map((data) => chart(data, shared, { show, showAll, zoom, point, clicked }));

  /** Show a part of the time, within the whole and not too short. */
  function show([low, high]) {
    const length = Math.min(whole[1] - whole[0], Math.max(high - low, MIN_RANGE * (whole[1] - whole[0])));
    const begin = Math.min(Math.max(low, whole[0]), whole[1] - length);
    shared.range = [begin, begin + length];
    reset.hidden = length === whole[1] - whole[0];
    for (const each of charts) each.draw();
  }
  function showAll() {
    show(whole);
  }
  function zoom(factor, time) {
    show(shared.range.map((end) => time + (end - time) / factor));
  }
  function point(time) {
    shared.cursor = time;
    for (const each of charts) each.place();
  }
  return {
    element: make("div", {}, make("div", { class: "charts" }, ...charts.map((each) => each.figure)), reset),
    mark(time) {
      shared.marked = Math.min(Math.max(time, whole[0]), whole[1]);
      for (const each of charts) each.place();
    },
    refresh() {
      const isPart = !reset.hidden;
      whole = wholeOf();
      show(isPart ? shared.range : whole);
    },
  };
}

/** A chart in its figure, over the time axis of `shared`; `act` changes that of all charts. */
function chart(data, shared, act) {
  const canvas = make("canvas", { "aria-hidden": "true" });
  const [cursor, mark, selected] = ["cursor", "mark", "selected"].map((name) => make("div", { class: name, hidden: true }));
  const area = make("div", { class: "plotted", tabindex: 0, role: "slider", "aria-label": `${data.title}. ${CHART_HELP}` },
    selected, mark, cursor);
  const reading = make("span", { class: "reading", "aria-hidden": "true" });
  const figure = make("figure", { class: "chart" },
    make("figcaption", {}, data.unit ? `${data.title} [${data.unit}]` : data.title,
      make("span", { class: "keys" }, ...legendOf(data))),
    make("div", { class: "plot" }, canvas, area, reading));
  let dragged = null; // where a drag began, in pixels

  const ofTime = (time) => ((time - shared.range[0]) / (shared.range[1] - shared.range[0])) * area.clientWidth;
  const timeAt = (x) => {
    const fraction = Math.min(1, Math.max(0, x / area.clientWidth));
    return shared.range[0] + fraction * (shared.range[1] - shared.range[0]);
  };
  function placeLine(line, time) {
    line.hidden = time === null || time < shared.range[0] || time > shared.range[1];
    if (!line.hidden) line.style.left = `${ofTime(time)}px`;
  }
  function place() {
    placeLine(cursor, shared.cursor);
    placeLine(mark, shared.marked);
    const time = shared.cursor ?? shared.marked ?? shared.range[0];
    reading.textContent = shared.cursor === null ? "" : readingAt(data, time);
    area.setAttribute("aria-valuemin", shared.range[0]);
    area.setAttribute("aria-valuemax", shared.range[1]);
    area.setAttribute("aria-valuenow", time);
    area.setAttribute("aria-valuetext", readingAt(data, time));
  }
  function draw() {
    if (!canvas.clientWidth) return;
    drawChart(sized(canvas), data, shared.range, canvas.clientWidth);
    place();
  }
  function drag(x) {
    selected.hidden = dragged === null || Math.abs(x - dragged) < MIN_DRAG;
    if (selected.hidden) return;
    selected.style.left = `${Math.min(x, dragged)}px`;
    selected.style.width = `${Math.abs(x - dragged)}px`;
  }

  area.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    area.setPointerCapture(event.pointerId);
    [dragged] = positionIn(area, event);
  });
  area.addEventListener("pointermove", (event) => {
    const [x] = positionIn(area, event);
    act.point(timeAt(x));
    drag(x);
  });
  area.addEventListener("pointerup", (event) => {
    if (dragged === null) return;
    const [x] = positionIn(area, event), from = dragged;
    dragged = null;
    selected.hidden = true;
    if (Math.abs(x - from) < MIN_DRAG) act.clicked(timeAt(x));
    else act.show([timeAt(Math.min(x, from)), timeAt(Math.max(x, from))]);
  });
  area.addEventListener("pointercancel", () => { dragged = null; selected.hidden = true; });
  area.addEventListener("pointerleave", () => act.point(null));
  area.addEventListener("blur", () => act.point(null));
  area.addEventListener("wheel", (event) => {
    if (!event.ctrlKey && !event.metaKey && document.activeElement !== area) return;
    event.preventDefault();
    act.zoom(Math.exp(-event.deltaY / 400), timeAt(positionIn(area, event)[0]));
  }, { passive: false });
  area.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const [low, high] = shared.range, time = shared.cursor ?? shared.marked ?? low;
    const move = (steps) => {
      const next = time + steps * ((high - low) / 100);
      if (next < low || next > high) act.show([low + next - time, high + next - time]);
      act.point(Math.min(shared.range[1], Math.max(shared.range[0], next)));
    };
    const keys = {
      ArrowLeft: () => move(-1), ArrowRight: () => move(1), PageDown: () => move(-10), PageUp: () => move(10),
      Home: () => act.point(low), End: () => act.point(high), Enter: () => act.clicked(time),
      "+": () => act.zoom(1.5, time), "=": () => act.zoom(1.5, time), "-": () => act.zoom(1 / 1.5, time),
      0: act.showAll,
    };
    if (!(event.key in keys)) return;
    event.preventDefault();
    keys[event.key]();
  });
  new ResizeObserver(draw).observe(canvas);
  onTheme(draw);
  return { figure, draw, place };
}

/** Index of the first of ascending numbers that is not below a value. */
function lowerBound(values, value) {
  let low = 0, high = values.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (values[middle] < value) low = middle + 1;
    else high = middle;
  }
  return low;
}

/** Smallest and largest of the finite values in some arrays, apart from each other. */
function extentOf(arrays, from = 0, to = Infinity) {
  let low = Infinity, high = -Infinity;
  for (const values of arrays) {
    for (let i = from; i < Math.min(to, values.length); i++) {
      if (!Number.isFinite(values[i])) continue;
      low = Math.min(low, values[i]);
      high = Math.max(high, values[i]);
    }
  }
  if (low > high) return [0, 1];
  return low < high ? [low, high] : [low, low + (Math.abs(low) || 1)];
}

/** The values of a chart by what they are: those of its band, of itself and their running mean. */
const columnsOf = (data) => [...(data.band || []), data.values, ...(data.mean ? [data.mean] : [])];

/** Range of the vertical axis for the samples from `from` to `to`: whole decades, or with a margin. */
function verticalRange(data, from, to) {
  const [low, high] = extentOf(columnsOf(data), from, to);
  if (data.logarithmic && low <= 0) return [0.1, 10];
  if (data.logarithmic) {
    const first = Math.floor(Math.log10(low)), last = Math.ceil(Math.log10(high));
    return [10 ** first, 10 ** Math.max(last, first + 1)];
  }
  const margin = 0.08 * (high - low);
  return [low === 0 ? 0 : low - margin, high + margin];
}

function drawChart(context, data, [begin, end], fullWidth) {
  const colors = palette(), { time } = data;
  const width = fullWidth - MARGIN.left - MARGIN.right, height = CHART_HEIGHT - MARGIN.top - MARGIN.bottom;
  const from = Math.max(0, lowerBound(time, begin) - 1), to = Math.min(time.length, lowerBound(time, end) + 1);
  const [low, high] = verticalRange(data, from, to);
  const place = data.logarithmic ? Math.log10 : (value) => value;
  const x = (at) => MARGIN.left + ((at - begin) / (end - begin)) * width;
  const y = (value) => MARGIN.top + height * (1 - (place(value) - place(low)) / (place(high) - place(low)));
  drawAxes(context, colors, {
    x, y, width, height, vertical: data.logarithmic ? decades(low, high) : ticks(low, high, height / 34),
    horizontal: ticks(begin, end, width / 80),
  });
  context.save();
  context.beginPath();
  context.rect(MARGIN.left, MARGIN.top, width, height);
  context.clip();
  const line = (values, color, lineWidth) => {
    context.beginPath();
    trace(context, time, values, from, to, x, y);
    context.strokeStyle = color;
    context.lineWidth = lineWidth;
    context.stroke();
  };
  if (data.band) {
    const [lower, upper] = data.band;
    context.beginPath();
    for (let i = from; i < to; i++) context.lineTo(x(time[i]), y(lower[i]));
    for (let i = to - 1; i >= from; i--) context.lineTo(x(time[i]), y(upper[i]));
    context.fillStyle = `${colors.green}33`;
    context.fill();
    for (const side of data.band) line(side, colors.green, 1);
  }
  if (data.dots) {
    context.fillStyle = `${colors.gray}99`;
    for (let i = from; i < to; i++) context.fillRect(x(time[i]) - 1.5, y(data.values[i]) - 1.5, 3, 3);
  } else line(data.values, colors.blue, 1.5);
  if (data.mean) line(data.mean, colors.blue, 2);
  context.restore();
}

/** Grid and labels. */
function drawAxes(context, colors, { x, y, width, height, vertical, horizontal }) {
  context.fillStyle = colors.line;
  for (const { value } of vertical) context.fillRect(MARGIN.left, Math.round(y(value)), width, 1);
  for (const { value } of horizontal) context.fillRect(Math.round(x(value)), MARGIN.top, 1, height);
  context.fillStyle = colors.soft;
  context.font = "12px system-ui, sans-serif";
  context.textAlign = "right";
  context.textBaseline = "middle";
  for (const { value, label } of vertical) context.fillText(label, MARGIN.left - 6, y(value));
  context.textBaseline = "alphabetic";
  for (const { value, label } of horizontal) {
    const half = context.measureText(`${label} s`).width / 2, right = MARGIN.left + width + MARGIN.right;
    context.fillText(`${label} s`, Math.min(x(value) + half, right), MARGIN.top + height + 17);
  }
}

/** Add a line through samples to the path; where a value is missing it has a gap. */
function trace(context, time, values, from, to, x, y) {
  let isGap = true;
  for (let i = from; i < to; i++) {
    const missing = Number.isNaN(values[i]);
    if (!missing) context[isGap ? "moveTo" : "lineTo"](x(time[i]), y(values[i]));
    isGap = missing;
  }
}

/** Multiples of 1, 2 or 5 times a power of ten, about `count` and at least two of them, with their labels. */
function ticks(low, high, count) {
  const rough = (high - low) / Math.max(2, count), power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].find((each) => each * power >= rough * (1 - 1e-9)) * power;
  const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  const numbers = [];
  for (let i = Math.ceil(low / step - 1e-9); i * step <= high + 1e-9 * step; i++) numbers.push(i * step);
  if (numbers.length < 2) return ticks(low, high, 2 * Math.max(2, count));
  const isPlain = digits < 5 && Math.max(...numbers.map(Math.abs)) < 1e6;
  return numbers.map((value) => ({ value, label: isPlain ? value.toFixed(digits) : value.toExponential(1) }));
}

/** Powers of ten, with their labels. */
function decades(low, high) {
  const first = Math.round(Math.log10(low)), last = Math.round(Math.log10(high));
  const every = Math.ceil((last - first) / 5), powers = [];
  for (let power = first; power <= last; power += every) powers.push(power);
  return powers.map((power) => ({ value: 10 ** power, label: threeDigits(10 ** power) }));
}

/** A number in three digits. */
function threeDigits(value) {
  if (Number.isNaN(value)) return "–";
  const isPlain = value === 0 || (Math.abs(value) < 1e4 && Math.abs(value) >= 1e-3);
  return isPlain ? String(Number(value.toPrecision(3))) : Number(value.toPrecision(3)).toExponential();
}

/** The values of a chart at the sample nearest to a time, its band in brackets. */
function readingAt(data, time) {
  const after = Math.min(data.time.length - 1, lowerBound(data.time, time)), before = Math.max(0, after - 1);
  const i = time - data.time[before] < data.time[after] - time ? before : after;
  const mean = data.mean ? `, mean ${threeDigits(data.mean[i])}` : "";
  const band = data.band && data.name !== data.band_name
    ? ` (${data.band.map((side) => threeDigits(side[i])).join(" to ")})` : "";
  return `${short(data.time[i], 1)} s: ${threeDigits(data.values[i])}${mean}${band}`;
}

function legendOf(data) {
  const key = (label, color, shape) => make("span", { class: "key" },
    make("span", { class: `swatch ${shape} ${color}`, "aria-hidden": "true" }), label);
  const keys = [];
  if (data.name && data.name !== data.band_name) {
    keys.push(key(data.name, data.dots ? "gray" : "blue", data.dots ? "dot" : "line"));
  }
  if (data.mean) keys.push(key(data.mean_name, "blue", "line"));
  if (data.band) keys.push(key(data.band_name, "green", "area"));
  return keys;
}
