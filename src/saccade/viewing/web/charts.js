"use strict";
/* Charts over time, drawn by uPlot. */

const CHART_HEIGHT = 190;

/** A chart in its figure; `clicked(time)` is called on clicks, `mark` shows a time. */
function chart(data, clicked) {
  const container = make("div", { class: "plot" });
  const caption = make("figcaption", {}, data.unit ? `${data.title} [${data.unit}]` : data.title);
  const legend = make("span", { class: "keys" });
  caption.append(legend);
  const figure = make("figure", { class: "chart" }, caption, container);
  let plot = null;
  let marked = null;

  function drawMark(drawn) {
    if (marked === null) return;
    const x = Math.round(drawn.valToPos(marked, "x", true));
    const { left, top, width, height } = drawn.bbox;
    if (x < left || x > left + width) return;
    drawn.ctx.save();
    drawn.ctx.fillStyle = palette().red;
    drawn.ctx.fillRect(x, top, Math.max(1, window.devicePixelRatio), height);
    drawn.ctx.restore();
  }

  function build() {
    const colors = palette();
    const { columns, series, bands } = plotData(data, colors);
    const axis = {
      stroke: colors.soft, grid: { stroke: colors.line, width: 1 }, ticks: { show: false },
      font: "12px system-ui, sans-serif",
    };
    const decades = (_, ticks) => (data.logarithmic ? ticks.map(decade) : ticks);
    if (plot) plot.destroy();
    plot = new uPlot({
      width: Math.max(200, container.clientWidth), height: CHART_HEIGHT, series, bands,
      scales: { x: { time: false }, y: { distr: data.logarithmic ? 3 : 1 } },
      axes: [
        { ...axis, size: 28, values: (_, ticks) => ticks.map((each) => `${tick(each)} s`) },
        { ...axis, size: 54, values: (_, ticks) => ticks.map(tick), filter: decades,
          grid: { ...axis.grid, filter: decades } },
      ],
      legend: { show: false }, cursor: { y: false, points: { show: false }, drag: { x: true, y: false } },
      hooks: { draw: [drawMark] },
    }, columns, container);
    plot.over.addEventListener("click", () => {
      const { left } = plot.cursor;
      if (left >= 0 && plot.select.width < 3) clicked(plot.posToVal(left, "x"));
    });
    legend.replaceChildren(...legendOf(data));
  }

  new ResizeObserver(() => {
    if (!plot) build();
    else if (plot.width !== container.clientWidth) {
      plot.setSize({ width: Math.max(200, container.clientWidth), height: CHART_HEIGHT });
    }
  }).observe(container);
  onTheme(build);
  return {
    figure,
    mark(time) {
      marked = time;
      if (plot) plot.redraw(false);
    },
  };
}

/** The columns and series of a chart for uPlot. */
function plotData(data, colors) {
  const column = (values) => Array.from(values, (value) => (Number.isNaN(value) ? null : value));
  const columns = [column(data.time)];
  const series = [{}];
  const bands = [];
  if (data.band) {
    for (const side of data.band) {
      columns.push(column(side));
      series.push({ stroke: colors.green, width: 1, points: { show: false } });
    }
    bands.push({ series: [2, 1], fill: `${colors.green}33` });
  }
  columns.push(column(data.values));
  series.push(data.dots
    ? { stroke: colors.gray, paths: () => null,
        points: { show: true, size: 3, width: 0, fill: `${colors.gray}99` } }
    : { stroke: colors.blue, width: 1.5, points: { show: false } });
  if (data.mean) {
    columns.push(column(data.mean));
    series.push({ stroke: colors.blue, width: 2, points: { show: false } });
  }
  return { columns, series, bands };
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

/** A power of ten; null for other values. */
function decade(value) {
  return Math.abs(Math.log10(value) % 1) < 1e-6 ? value : null;
}

function tick(value) {
  if (value === null) return "";
  return Math.abs(value) >= 1e4 || (value !== 0 && Math.abs(value) < 1e-3)
    ? value.toExponential(0) : String(Number(value.toPrecision(4)));
}
