"use strict";
for (const element of document.querySelectorAll(".part")) {
  const data = unpacked(JSON.parse(element.querySelector("script").textContent));
  kinds[element.dataset.kind](element, data);
}
document.documentElement.dataset.ready = "true";
