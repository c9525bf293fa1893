"use strict";
/* A plane seen from above that is panned and zoomed by mouse, finger or key. */

const REACH = 14; // pixels within which a click finds something

/**
 * Let a canvas show a plane, x to the right and y up.
 * `box` is [left, bottom, right, top] in metres; `draw(context, view)` draws it;
 * `clicked(x, y, reach)` hears of clicks, in metres.
 */
function plane(canvas, box, draw, clicked) {
  let scale = 1;
  let center = [0, 0];
  let asked = false;
  const held = new Map();
  let moved = 0;

  const view = {
    x: (x) => (x - center[0]) * scale + canvas.clientWidth / 2,
    y: (y) => canvas.clientHeight / 2 - (y - center[1]) * scale,
    get scale() { return scale; },
    get width() { return canvas.clientWidth; },
    get height() { return canvas.clientHeight; },
  };
  const metres = (x, y) => [
    center[0] + (x - canvas.clientWidth / 2) / scale,
    center[1] - (y - canvas.clientHeight / 2) / scale,
  ];

  function redraw() {
    if (asked) return;
    asked = true;
    requestAnimationFrame(() => {
      asked = false;
      draw(sized(canvas), view);
    });
  }
  function fit() {
    const wide = Math.max(box[2] - box[0], 1), high = Math.max(box[3] - box[1], 1);
    scale = 0.92 * Math.min(canvas.clientWidth / wide, canvas.clientHeight / high);
    center = [(box[0] + box[2]) / 2, (box[1] + box[3]) / 2];
    redraw();
  }
  function zoom(factor, x = canvas.clientWidth / 2, y = canvas.clientHeight / 2) {
    const there = metres(x, y);
    scale *= factor;
    const now = metres(x, y);
    center = [center[0] + there[0] - now[0], center[1] + there[1] - now[1]];
    redraw();
  }
  function pan(x, y) {
    center = [center[0] - x / scale, center[1] + y / scale];
    redraw();
  }
  const at = (event) => placeIn(canvas, event);

  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    if (held.size === 0) moved = 0;
    held.set(event.pointerId, at(event));
  });
  canvas.addEventListener("pointermove", (event) => {
    const before = held.get(event.pointerId);
    if (!before) return;
    const here = at(event);
    const other = [...held].find(([id]) => id !== event.pointerId);
    if (other) {
      const apart = (a) => Math.max(1, Math.hypot(a[0] - other[1][0], a[1] - other[1][1]));
      zoom(apart(here) / apart(before), (here[0] + other[1][0]) / 2, (here[1] + other[1][1]) / 2);
      pan((here[0] - before[0]) / 2, (here[1] - before[1]) / 2);
      moved = REACH;
    } else {
      moved += Math.hypot(here[0] - before[0], here[1] - before[1]);
      if (moved > 3) pan(here[0] - before[0], here[1] - before[1]);
    }
    held.set(event.pointerId, here);
  });
  canvas.addEventListener("pointerup", (event) => {
    if (held.delete(event.pointerId) && moved <= 3) clicked(...metres(...at(event)), REACH / scale);
  });
  canvas.addEventListener("pointercancel", (event) => held.delete(event.pointerId));
  canvas.addEventListener("wheel", (event) => {
    if (!event.ctrlKey && !event.metaKey && document.activeElement !== canvas) return;
    event.preventDefault();
    zoom(Math.exp(-event.deltaY / 400), ...at(event));
  }, { passive: false });
  canvas.addEventListener("keydown", (event) => {
    const keys = {
      ArrowLeft: () => pan(40, 0), ArrowRight: () => pan(-40, 0),
      ArrowUp: () => pan(0, 40), ArrowDown: () => pan(0, -40),
      "+": () => zoom(1.25), "=": () => zoom(1.25), "-": () => zoom(0.8), 0: fit,
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

/** Draw the ellipse of a covariance; the path is begun and stroked by who calls. */
function addEllipse(context, view, x, y, xx, xy, yy, sigmas) {
  const mean = (xx + yy) / 2;
  const apart = Math.hypot((xx - yy) / 2, xy);
  const a = sigmas * Math.sqrt(Math.max(0, mean + apart)) * view.scale;
  const b = sigmas * Math.sqrt(Math.max(0, mean - apart)) * view.scale;
  const angle = Math.atan2(2 * xy, xx - yy) / 2;
  const left = view.x(x), top = view.y(y);
  context.moveTo(left + a * Math.cos(angle), top - a * Math.sin(angle));
  context.ellipse(left, top, a, b, -angle, 0, 2 * Math.PI);
}

/** A bar that says how long some metres are. */
function drawScale(context, view, colors) {
  const rough = 110 / view.scale;
  const power = 10 ** Math.floor(Math.log10(rough));
  const length = [5, 2, 1].find((each) => each * power <= rough) * power;
  const wide = length * view.scale, x = 16, y = view.height - 16;
  context.strokeStyle = context.fillStyle = colors.soft;
  context.lineWidth = 1.5;
  context.beginPath();
  context.moveTo(x, y - 5);
  context.lineTo(x, y);
  context.lineTo(x + wide, y);
  context.lineTo(x + wide, y - 5);
  context.stroke();
  context.font = "12px system-ui, sans-serif";
  context.fillText(`${Number(length.toPrecision(1))} m`, x + 6, y - 6);
}
