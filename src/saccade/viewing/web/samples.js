"use strict";
/* Many scanpaths over a photograph, and the distributions of their saccades. */

const AMPLITUDE_BINS = 20, DIRECTION_BINS = 16;

/** Calls `visit(dx, dy)` for every saccade of paths of `length` fixations, one after another. */
function eachSaccade(xy, length, visit) {
  for (let i = 0; i + 1 < xy.length / 2; i++) {
    if ((i + 1) % length) visit(xy[2 * i + 2] - xy[2 * i], xy[2 * i + 3] - xy[2 * i + 1]);
  }
}

/** A cloud of scanpaths: thin lines through their fixations. */
function drawSamples(context, samples, scale) {
  const { xy, length } = samples, count = xy.length / 2;
  context.lineJoin = "round";
  context.globalAlpha = 0.3;
  context.strokeStyle = ON_PHOTO.chosen;
  context.lineWidth = 0.75;
  for (let start = 0; start < count; start += length) {
    context.beginPath();
    for (let i = start; i < start + length; i++) context.lineTo(xy[2 * i] * scale, xy[2 * i + 1] * scale);
    context.stroke();
  }
  context.globalAlpha = 0.8;
  context.fillStyle = ON_PHOTO.chosen;
  for (let i = 0; i < count; i++) {
    context.beginPath();
    context.arc(xy[2 * i] * scale, xy[2 * i + 1] * scale, 1.5, 0, 2 * Math.PI);
    context.fill();
  }
  context.globalAlpha = 1;
}

/** Fractions of saccades by amplitude, the last bin with all that are longer, and the mean. */
function amplitudes(samples, width) {
  const bins = new Float64Array(AMPLITUDE_BINS);
  let sum = 0, count = 0;
  eachSaccade(samples.xy, samples.length, (dx, dy) => {
    const amplitude = Math.hypot(dx, dy);
    bins[Math.min(AMPLITUDE_BINS - 1, Math.floor(amplitude / width))]++;
    sum += amplitude;
    count++;
  });
  return { bins: bins.map((each) => each / Math.max(1, count)), mean: sum / Math.max(1, count) };
}

/** Fractions of saccades by direction, from right over down. */
function directions(samples) {
  const bins = new Float64Array(DIRECTION_BINS);
  let count = 0;
  eachSaccade(samples.xy, samples.length, (dx, dy) => {
    const turn = Math.round((Math.atan2(dy, dx) / (2 * Math.PI)) * DIRECTION_BINS);
    bins[(turn + DIRECTION_BINS) % DIRECTION_BINS]++;
    count++;
  });
  return bins.map((each) => each / Math.max(1, count));
}

function drawAmplitudes(canvas, bins, width, colors) {
  const context = sized(canvas), bottom = canvas.clientHeight - 22;
  const column = canvas.clientWidth / bins.length, highest = Math.max(1e-9, ...bins);
  context.fillStyle = colors.blue;
  bins.forEach((each, i) => {
    const height = (each / highest) * (bottom - 4);
    context.fillRect(i * column + 1, bottom - height, column - 2, height);
  });
  context.fillStyle = colors.soft;
  context.font = "12px system-ui, sans-serif";
  for (let i = 0; i < bins.length; i += 5) context.fillText(`${Math.round(i * width)}`, i * column, bottom + 16);
  context.textAlign = "right";
  context.fillText("px", canvas.clientWidth, bottom + 16);
}

function drawDirections(canvas, bins, colors) {
  const context = sized(canvas), x = canvas.clientWidth / 2, y = canvas.clientHeight / 2;
  const radius = Math.min(x, y) - 4, highest = Math.max(1e-9, ...bins);
  context.strokeStyle = colors.line;
  context.beginPath();
  context.arc(x, y, radius, 0, 2 * Math.PI);
  context.stroke();
  context.fillStyle = colors.blue;
  bins.forEach((each, i) => {
    const angle = (2 * Math.PI * i) / DIRECTION_BINS, half = Math.PI / DIRECTION_BINS;
    context.beginPath();
    context.moveTo(x, y);
    context.arc(x, y, radius * Math.sqrt(each / highest), angle - half, angle + half);
    context.fill();
  });
}

/** The distributions of amplitude and direction of sampled scanpaths, as two figures. */
function saccadeFigures(samples, image) {
  const width = Math.max(image.width, image.height) / AMPLITUDE_BINS;
  const amplitude = amplitudes(samples, width), direction = directions(samples);
  const horizontal = direction.filter((_, i) => i % 8 <= 1 || i % 8 === 7).reduce((a, b) => a + b, 0);
  const figure = (name, text, draw) => {
    const canvas = make("canvas", { class: name, role: "img", "aria-label": text });
    const redraw = () => { if (canvas.clientHeight) draw(canvas); };
    new ResizeObserver(redraw).observe(canvas);
    onTheme(redraw);
    return make("figure", { class: "saccades" }, make("figcaption", {}, text), canvas);
  };
  return make("div", { class: "charts" },
    figure("amplitudes", `Amplitude of sampled saccades, mean ${short(amplitude.mean, 0)} px`,
      (canvas) => drawAmplitudes(canvas, amplitude.bins, width, palette())),
    figure("directions", `Direction of sampled saccades, ${short(100 * horizontal, 0)} % near the horizontal`,
      (canvas) => drawDirections(canvas, direction, palette())));
}
