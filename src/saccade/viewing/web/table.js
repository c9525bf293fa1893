"use strict";
/* A table that is sorted by a click on a heading. */

kinds.table = (element, data) => {
  let sorted = -1;
  let ascending = false;
  const body = make("tbody");
  const heads = data.columns.map((name, i) => make("th", { scope: "col" },
    make("button", { type: "button", onclick: () => sort(i) }, name || data.first)));
  const number = (cell) => {
    const value = parseFloat(cell);
    return Number.isNaN(value) ? null : value;
  };
  function compare(a, b) {
    const [x, y] = [number(a[sorted]), number(b[sorted])];
    if (sorted === 0 || x === null || y === null) return a[sorted].localeCompare(b[sorted]);
    return x - y;
  }
  function fill(rows) {
    body.replaceChildren(...rows.map((row) => make("tr", {},
      make("th", { scope: "row" }, row[0]), ...row.slice(1).map((cell) => make("td", {}, cell)))));
  }
  function sort(column) {
    ascending = column === sorted ? !ascending : column === 0;
    sorted = column;
    heads.forEach((head, i) => {
      if (i === sorted) head.setAttribute("aria-sort", ascending ? "ascending" : "descending");
      else head.removeAttribute("aria-sort");
    });
    const rows = [...data.rows].sort(compare);
    fill(ascending ? rows : rows.reverse());
  }
  fill(data.rows);
  element.append(make("div", { class: "scroll", tabindex: 0, role: "region", "aria-label": data.title },
    make("table", {}, make("thead", {}, make("tr", {}, ...heads)), body)));
};
