"use strict";
/* Shared by all parts of a report. */

const ARRAYS = {
  float32: Float32Array, int32: Int32Array, int16: Int16Array, uint16: Uint16Array,
  uint8: Uint8Array,
};

/** The function that shows each kind of part in its element, from its data. */
const kinds = {};

/** The data of a page, its packed arrays as typed arrays. */
function unpacked(value) {
  if (Array.isArray(value)) return value.map(unpacked);
  if (value === null || typeof value !== "object") return value;
  if ("base64" in value) {
    const bytes = Uint8Array.from(atob(value.base64), (letter) => letter.charCodeAt(0));
    return new ARRAYS[value.type](bytes.buffer);
  }
  return Object.fromEntries(Object.entries(value).map(([name, each]) => [name, unpacked(each)]));
}

/** An element with attributes, listeners (on...) and children; text is never read as HTML. */
function make(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (value === true) element.setAttribute(name, "");
    else if (value !== false && value !== null) element.setAttribute(name, value);
  }
  element.append(...children);
  return element;
}

/** The colors of the page, in light or dark mode. */
function palette() {
  const style = getComputedStyle(document.documentElement);
  const of = (name) => style.getPropertyValue(`--${name}`).trim();
  return Object.fromEntries(
    ["ink", "paper", "soft", "line", "blue", "orange", "green", "red", "gray"].map((name) => [
      name, of(name)]));
}

/** Call a function when light and dark mode change. */
function onTheme(changed) {
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", changed);
}

/** Clear a canvas at the resolution of the screen; returns its context, in CSS pixels. */
function sized(canvas) {
  const ratio = window.devicePixelRatio || 1;
  const width = Math.max(1, Math.round(canvas.clientWidth * ratio));
  const height = Math.max(1, Math.round(canvas.clientHeight * ratio));
  if (canvas.width !== width || canvas.height !== height) {
    canvas.width = width;
    canvas.height = height;
  }
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, canvas.clientWidth, canvas.clientHeight);
  return context;
}

/** Position of an event on an element, in CSS pixels. */
function positionIn(element, event) {
  const edge = element.getBoundingClientRect();
  return [event.clientX - edge.left, event.clientY - edge.top];
}

/** A checkbox with a swatch of its color. */
function toggle(label, color, on, changed, shape = "line") {
  const box = make("input", { type: "checkbox", onchange: () => changed(box.checked) });
  box.checked = on;
  const swatch = make("span", { class: `swatch ${shape} ${color}`, "aria-hidden": "true" });
  return make("label", { class: "toggle" }, box, swatch, label);
}

/** A slider through steps and a button that plays them; `period(step)` is in milliseconds. */
function player(name, count, period, show) {
  let timer = null;
  const slider = make("input", {
    type: "range", min: 0, max: count - 1, step: 1, "aria-label": name,
    oninput: () => { stop(); show(Number(slider.value)); },
  });
  const button = make("button", { type: "button", class: "play", onclick: () => (timer ? stop() : play()) });
  const status = make("output", { class: "now" });
  function label() {
    button.textContent = timer ? "❚❚" : "▶";
    button.setAttribute("aria-label", timer ? "Pause" : "Play");
  }
  function stop() {
    clearTimeout(timer);
    timer = null;
    label();
  }
  function advance() {
    const next = Number(slider.value) + 1;
    if (next >= count) return stop();
    slider.value = next;
    show(next);
    timer = setTimeout(advance, period(next));
  }
  function play() {
    if (Number(slider.value) >= count - 1) {
      slider.value = 0;
      show(0);
    }
    timer = setTimeout(advance, period(Number(slider.value)));
    label();
  }
  label();
  return {
    element: make("div", { class: "player" }, button, slider, status),
    set(step, text) {
      slider.value = step;
      slider.setAttribute("aria-valuetext", text);
      status.textContent = text;
    },
    stop,
    /** Change the number of steps. */
    setCount(next) {
      stop();
      count = next;
      slider.max = count - 1;
    },
  };
}

/** A number with few digits. */
function short(value, digits = 2) {
  return Number.isFinite(value) ? value.toFixed(digits) : "–";
}
