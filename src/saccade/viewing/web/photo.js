"use strict";
/* Shared by photographs and pairs of them: lines over them, and the selection of one item. */

const POINTER_RADIUS = 18; // pixels within which a pointer selects
const ON_PHOTO = { path: "#e69f00", point: "#ffd166", chosen: "#56d4ff" };

/** A line that is visible on any photograph. */
function outlined(context, color, width, draw) {
  for (const [stroke, lineWidth] of [["#000", width + 2], [color, width]]) {
    context.strokeStyle = stroke;
    context.lineWidth = lineWidth;
    context.beginPath();
    draw();
    context.stroke();
  }
}

/** Names and values as a definition list. */
function definitionList(rows) {
  return make("dl", {}, ...rows.flatMap(([name, value]) => [make("dt", {}, name), make("dd", {}, value)]));
}

/**
 * The selection of one of `count` items by its number, or by `choose`; -1 is none.
 * `describe(index)` gives its detail, `redraw()` shows it; the element's data hold its index.
 */
function selection(element, word, count, hint, describe, redraw) {
  let chosen = -1;
  const field = make("input", {
    type: "number", min: 1, max: count, placeholder: "none",
    oninput: () => choose(field.value === "" ? -1 : Math.min(count, Math.max(1, field.value)) - 1),
  });
  const total = make("span", {}, ` of ${count}`);
  const detail = make("div", { class: "detail", "aria-live": "polite" });
  function showDetail() {
    detail.replaceChildren(...(chosen < 0 ? [make("p", { class: "hint" }, hint)] : describe(chosen)));
    for (const canvas of detail.querySelectorAll("canvas")) canvas.draw();
  }
  function choose(index) {
    chosen = index;
    field.value = index < 0 ? "" : index + 1;
    element.dataset[word.toLowerCase()] = index;
    showDetail();
    redraw();
  }
  onTheme(showDetail);
  showDetail();
  return {
    nodes: [make("label", { class: "choose" }, `${word} `, field, total), detail],
    get chosen() { return chosen; },
    choose,
    /** Replace the items by `next` others. */
    replace(next) {
      count = next;
      chosen = -1;
      field.value = "";
      field.max = count;
      total.textContent = ` of ${count}`;
      showDetail();
    },
  };
}
