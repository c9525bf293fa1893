"use strict";
/* A plane seen from above that is panned and zoomed by mouse, finger or key. */

const CLICK_RADIUS = 14; // pixels within which a click selects

/**
 * A canvas that shows a plane, x to the right and y up.
 * `box` is [left, bottom, right, top] in meters; `draw(context, view)` draws it;
 * `clicked(x, y, radius)` is called on clicks, in meters; `ownKeys` are functions by key.
 */
function plane(canvas, box, draw, clicked, ownKeys = {}) {
  let scale = 1;
  let center = [0, 0];
  let requested = false;
  const pointers = new Map();
  let moved = 0;

  const view = {
    x: (x) => (x - center[0]) * scale + canvas.clientWidth / 2,
    y: (y) => canvas.clientHeight / 2 - (y - center[1]) * scale,
    get scale() { return scale; },
    get width() { return canvas.clientWidth; },
    get height() { return canvas.clientHeight; },
  };
  const meters = (x, y) => [
    center[0] + (x - canvas.clientWidth / 2) / scale,
    center[1] - (y - canvas.clientHeight / 2) / scale,
  ];

  function redraw() {
    if (requested) return;
    requested = true;
    requestAnimationFrame(() => {
      requested = false;
      draw(sized(canvas), view);
    });
  }
  function fit() {
    const boxWidth = Math.max(box[2] - box[0], 1), boxHeight = Math.max(box[3] - box[1], 1);
    scale = 0.92 * Math.min(canvas.clientWidth / boxWidth, canvas.clientHeight / boxHeight);
    center = [(box[0] + box[2]) / 2, (box[1] + box[3]) / 2];
    redraw();
  }
  function zoom(factor, x = canvas.clientWidth / 2, y = canvas.clientHeight / 2) {
    const before = meters(x, y);
    scale *= factor;
    const after = meters(x, y);
    center = [center[0] + before[0] - after[0], center[1] + before[1] - after[1]];
    redraw();
  }
  function pan(x, y) {
    center = [center[0] - x / scale, center[1] + y / scale];
    redraw();
  }
  const position = (event) => positionIn(canvas, event);

  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    if (pointers.size === 0) moved = 0;
    pointers.set(event.pointerId, position(event));
  });
  canvas.addEventListener("pointermove", (event) => {
    const before = pointers.get(event.pointerId);
    if (!before) return;
    const current = position(event);
    const other = [...pointers].find(([id]) => id !== event.pointerId);
    if (other) {
      const distance = (a) => Math.max(1, Math.hypot(a[0] - other[1][0], a[1] - other[1][1]));
      zoom(distance(current) / distance(before), (current[0] + other[1][0]) / 2, (current[1] + other[1][1]) / 2);
      pan((current[0] - before[0]) / 2, (current[1] - before[1]) / 2);
      moved = CLICK_RADIUS;
    } else {
      moved += Math.hypot(current[0] - before[0], current[1] - before[1]);
      if (moved > 3) pan(current[0] - before[0], current[1] - before[1]);
    }
    pointers.set(event.pointerId, current);
  });
  canvas.addEventListener("pointerup", (event) => {
    if (pointers.delete(event.pointerId) && moved <= 3) clicked(...meters(...position(event)), CLICK_RADIUS / scale);
  });
  canvas.addEventListener("pointercancel", (event) => pointers.delete(event.pointerId));
  canvas.addEventListener("wheel", (event) => {
    if (!event.ctrlKey && !event.metaKey && document.activeElement !== canvas) return;
    event.preventDefault();
    zoom(Math.exp(-event.deltaY / 400), ...position(event));
  }, { passive: false });
  canvas.addEventListener("keydown", (event) => {
    const keys = {
      ArrowLeft: () => pan(40, 0), ArrowRight: () => pan(-40, 0),
      ArrowUp: () => pan(0, 40), ArrowDown: () => pan(0, -40),
      "+": () => zoom(1.25), "=": () => zoom(1.25), "-": () => zoom(0.8), 0: fit, ...ownKeys,
    };
    if (!(event.key in keys) || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    keys[event.key]();
  });
  let width = 0;
  new ResizeObserver(() => {
    if (width === 0) fit();
    else scale *= canvas.clientWidth / width;
    width = canvas.clientWidth;
    redraw();
  }).observe(canvas);
  onTheme(redraw);
  return { redraw, fit, zoom, get scale() { return scale; } };
}

/** Add the ellipse of a covariance to the path, its axes `ellipseScale` standard deviations. */
function addEllipse(context, view, x, y, xx, xy, yy, ellipseScale) {
  const mean = (xx + yy) / 2;
  const deviation = Math.hypot((xx - yy) / 2, xy); // of the eigenvalues from their mean
  const a = ellipseScale * Math.sqrt(Math.max(0, mean + deviation)) * view.scale;
  const b = ellipseScale * Math.sqrt(Math.max(0, mean - deviation)) * view.scale;
  const angle = Math.atan2(2 * xy, xx - yy) / 2;
  const left = view.x(x), top = view.y(y);
  context.moveTo(left + a * Math.cos(angle), top - a * Math.sin(angle));
  context.ellipse(left, top, a, b, -angle, 0, 2 * Math.PI);
}

/** A robot at [x, y, heading, xx, xy, yy], the last three its covariance. */
function drawRobot(context, view, pose, ellipseScale, colors) {
  const [x, y, heading, xx, xy, yy] = pose;
  context.strokeStyle = colors.blue;
  context.lineWidth = 1.5;
  context.beginPath();
  addEllipse(context, view, x, y, xx, xy, yy, ellipseScale);
  context.stroke();
  drawArrow(context, view, x, y, heading, colors.red, colors.paper);
}

/** An arrow in the direction of a heading. */
function drawArrow(context, view, x, y, heading, fill, stroke) {
  context.save();
  context.translate(view.x(x), view.y(y));
  context.rotate(-heading);
  context.beginPath();
  for (const [a, b] of [[12, 0], [-8, 7], [-4, 0], [-8, -7]]) context.lineTo(a, b);
  context.closePath();
  context.fillStyle = fill;
  context.strokeStyle = stroke;
  context.lineWidth = 1.5;
  context.fill();
  context.stroke();
  context.restore();
}

/** A scale bar. */
function drawScale(context, view, colors) {
  const maxLength = 110 / view.scale;
  const power = 10 ** Math.floor(Math.log10(maxLength));
  const length = [5, 2, 1].find((each) => each * power <= maxLength) * power;
  const width = length * view.scale, x = 16, y = view.height - 16;
  context.strokeStyle = context.fillStyle = colors.soft;
  context.lineWidth = 1.5;
  context.beginPath();
  context.moveTo(x, y - 5);
  context.lineTo(x, y);
  context.lineTo(x + width, y);
  context.lineTo(x + width, y - 5);
  context.stroke();
  context.font = "12px system-ui, sans-serif";
  context.fillText(`${Number(length.toPrecision(1))} m`, x + 6, y - 6);
}
