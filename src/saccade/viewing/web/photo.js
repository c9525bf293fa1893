"use strict";
/* What a photograph and a pair of them share: lines over them, and one thing that is chosen. */

const FOUND = 18; // pixels within which a point is found
const ON_PHOTO = { path: "#e69f00", point: "#ffd166", chosen: "#56d4ff" };

/** A line that is seen on any photograph. */
function outlined(context, color, width, draw) {
  for (const [stroke, wide] of [["#000", width + 2], [color, width]]) {
    context.strokeStyle = stroke;
    context.lineWidth = wide;
    context.beginPath();
    draw();
    context.stroke();
  }
}

/** Names and values as a list. */
function factsOf(rows) {
  return make("dl", {}, ...rows.flatMap(([name, value]) => [make("dt", {}, name), make("dd", {}, value)]));
}

/**
 * One of `count` things is chosen by its number, or by `choose`; -1 is none.
 * `told(index)` gives what is said of it, `redraw()` shows it; the element's data have its number.
 */
function selection(element, word, count, hint, told, redraw) {
  let chosen = -1;
  const field = make("input", {
    type: "number", min: 1, max: count, placeholder: "none",
    oninput: () => choose(field.value === "" ? -1 : Math.min(count, Math.max(1, field.value)) - 1),
  });
  const total = make("span", {}, ` of ${count}`);
  const detail = make("div", { class: "detail", "aria-live": "polite" });
  function tell() {
    detail.replaceChildren(...(chosen < 0 ? [make("p", { class: "hint" }, hint)] : told(chosen)));
    for (const canvas of detail.querySelectorAll("canvas")) canvas.draw();
  }
  function choose(index) {
    chosen = index;
    field.value = index < 0 ? "" : index + 1;
    element.dataset[word.toLowerCase()] = index;
    tell();
    redraw();
  }
  onTheme(tell);
  tell();
  return {
    nodes: [make("label", { class: "choose" }, `${word} `, field, total), detail],
    get chosen() { return chosen; },
    choose,
    /** There are others to choose from. */
    renew(next) {
      count = next;
      chosen = -1;
      field.value = "";
      field.max = count;
      total.textContent = ` of ${count}`;
      tell();
    },
  };
}
