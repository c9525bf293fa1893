"use strict";
/* What every part of a report needs. */

const ARRAYS = {
  float32: Float32Array, int32: Int32Array, int16: Int16Array, uint16: Uint16Array,
  uint8: Uint8Array,
};

/** What shows each kind of part: a function of its element and its data. */
const kinds = {};

/** Data as the page holds it, its arrays as typed arrays. */
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

/** The colors of the page, as light or dark as its reader likes. */
function palette() {
  const style = getComputedStyle(document.documentElement);
  const of = (name) => style.getPropertyValue(`--${name}`).trim();
  return Object.fromEntries(
    ["ink", "paper", "soft", "line", "blue", "orange", "green", "red", "grey"].map((name) => [
      name, of(name)]));
}

/** Hear of a change between light and dark. */
function onTheme(heard) {
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", heard);
}

/** Let a canvas have as many pixels as the screen shows of it; returns its context, in CSS pixels. */
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

/** Where on an element an event was, in CSS pixels. */
function placeIn(element, event) {
  const edge = element.getBoundingClientRect();
  return [event.clientX - edge.left, event.clientY - edge.top];
}

/** A switch with a swatch of the color that it stands for. */
function toggle(word, color, on, heard, shape = "line") {
  const box = make("input", { type: "checkbox", onchange: () => heard(box.checked) });
  box.checked = on;
  const swatch = make("span", { class: `swatch ${shape} ${color}`, "aria-hidden": "true" });
  return make("label", { class: "toggle" }, box, swatch, word);
}

/** A slider through steps and a button that plays them. */
function player(name, count, period, shown) {
  let timer = null;
  const slider = make("input", {
    type: "range", min: 0, max: count - 1, step: 1, "aria-label": name,
    oninput: () => { stop(); shown(Number(slider.value)); },
  });
  const button = make("button", { type: "button", class: "play", onclick: () => (timer ? stop() : play()) });
  const words = make("output", { class: "now" });
  function label() {
    button.textContent = timer ? "❚❚" : "▶";
    button.setAttribute("aria-label", timer ? "Pause" : "Play");
  }
  function stop() {
    clearTimeout(timer);
    timer = null;
    label();
  }
  function go() {
    const next = Number(slider.value) + 1;
    if (next >= count) return stop();
    slider.value = next;
    shown(next);
    timer = setTimeout(go, period(next));
  }
  function play() {
    if (Number(slider.value) >= count - 1) {
      slider.value = 0;
      shown(0);
    }
    timer = setTimeout(go, period(Number(slider.value)));
    label();
  }
  label();
  return {
    element: make("div", { class: "player" }, button, slider, words),
    set(step, text) {
      slider.value = step;
      slider.setAttribute("aria-valuetext", text);
      words.textContent = text;
    },
    stop,
    /** There are as many steps as this. */
    renew(next) {
      stop();
      count = next;
      slider.max = count - 1;
    },
  };
}

/** A number as short as it may be. */
function short(value, digits = 2) {
  return Number.isFinite(value) ? value.toFixed(digits) : "–";
}
