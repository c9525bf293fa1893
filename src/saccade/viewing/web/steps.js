"use strict";
/* The menus that choose the step of a filter whose matrices are shown. */

for (const chooser of document.querySelectorAll(".chooser")) {
  const label = chooser.querySelector("label"), menu = chooser.querySelector("select");
  const show = () => {
    for (const each of chooser.querySelectorAll(".values")) each.hidden = each.dataset.step !== menu.value;
  };
  label.hidden = false;
  chooser.classList.add("chosen");
  menu.addEventListener("change", show);
  show();
}
