"use strict";
/* Pyramids and feature maps of the contrast model, in a box that opens. */

/**
 * The box; while it is open, `settings()` gives the request of `update()`, and `chosen(map)` is
 * called for a picture that is clicked. Errors are passed to `failed(error)`.
 */
function featureMaps(settings, chosen, failed) {
  const body = make("div", { class: "channels", "aria-busy": "false" });
  const element = make("details", { class: "group features", ontoggle: () => update() },
    make("summary", {}, "Feature maps and pyramids of the contrast model"),
    make("p", { class: "hint" }, "Each picture is scaled from its smallest value to its largest; levels halve the image. "
      + "A click shows one over the photograph."), body);
  const request = requester("features", settings, show, failed, (on) => body.setAttribute("aria-busy", on));

  function show({ channels }) {
    body.replaceChildren(...channels.map(({ name, rows }) => make("section", { class: "channel" },
      make("h3", {}, name), ...rows.map((row) => make("div", { class: "row" },
        make("p", { class: "label" }, row.name), make("div", { class: "thumbs" },
          ...row.maps.map((map) => thumb(map, `${name}, ${row.name}, ${map.name}`))))))));
  }
  function thumb(map, title) {
    return make("button", {
      type: "button", class: "thumb", title, onclick: () => chosen({ name: title, address: map.address }),
    }, make("img", { src: map.address, alt: title }), map.name);
  }
  function update() {
    if (element.open && !element.hidden) request(true);
  }
  return { element, update };
}
