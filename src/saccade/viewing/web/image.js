"use strict";
/* A photograph with layers: maps, the scanpath played in time, interest points. */

const SLOWER = 4; // times that a scanpath is played slower than the model
const FOUND = 18; // pixels within which a point is found

/** A field to choose one of `count` things by number; `heard` is told -1 for none. */
function chooser(word, count, heard) {
  const field = make("input", {
    type: "number", min: 1, max: count, placeholder: "none",
    oninput: () => heard(field.value === "" ? -1 : Math.min(count, Math.max(1, field.value)) - 1),
  });
  return {
    element: make("label", { class: "choose" }, `${word} `, field, ` of ${count}`),
    set(index) { field.value = index < 0 ? "" : index + 1; },
  };
}

/** The point nearest to a place, -1 where none is near. */
function nearest(xy, stride, x, y, reach, offset = 0) {
  let best = -1, least = reach;
  for (let i = offset, n = 0; i < xy.length; i += stride, n++) {
    const apart = Math.hypot(xy[i] - x, xy[i + 1] - y);
    if (apart < least) [best, least] = [n, apart];
  }
  return best;
}

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

const ON_PHOTO = { path: "#e69f00", point: "#ffd166", chosen: "#56d4ff" };

function drawScanpath(context, path, upTo, scale) {
  const at = (i) => [path.xy[2 * i] * scale, path.xy[2 * i + 1] * scale];
  context.lineJoin = "round";
  outlined(context, ON_PHOTO.path, 2, () => {
    for (let i = 0; i < upTo; i++) context.lineTo(...at(i));
  });
  context.font = "600 12px system-ui, sans-serif";
  context.textAlign = "center";
  context.textBaseline = "middle";
  for (let i = 0; i < upTo; i++) {
    const [x, y] = at(i);
    context.beginPath();
    context.arc(x, y, 10, 0, 2 * Math.PI);
    context.fillStyle = i === upTo - 1 ? "#fff" : ON_PHOTO.path;
    context.fill();
    context.strokeStyle = "#000";
    context.lineWidth = 1.5;
    context.stroke();
    context.fillStyle = "#000";
    context.fillText(String(i + 1), x, y + 0.5);
  }
}

function drawPoints(context, points, chosen, scale) {
  const circle = (i) => {
    const x = points.xy[2 * i] * scale, y = points.xy[2 * i + 1] * scale;
    const radius = Math.max(2, (points.size[i] / 2) * scale);
    context.moveTo(x + radius * Math.cos(points.angle[i]), y + radius * Math.sin(points.angle[i]));
    context.arc(x, y, radius, points.angle[i], points.angle[i] + 2 * Math.PI);
    context.moveTo(x, y);
    context.lineTo(x + radius * Math.cos(points.angle[i]), y + radius * Math.sin(points.angle[i]));
  };
  context.globalAlpha = 0.85;
  outlined(context, ON_PHOTO.point, 1, () => points.size.forEach((_, i) => circle(i)));
  context.globalAlpha = 1;
  if (chosen >= 0) outlined(context, ON_PHOTO.chosen, 3, () => circle(chosen));
}

/** A descriptor as its histograms: 4 x 4 places, 8 directions in each. */
function drawDescriptor(canvas, values, colors) {
  const context = sized(canvas), cell = canvas.clientWidth / 4;
  const most = Math.max(1, ...values);
  context.strokeStyle = colors.line;
  context.strokeRect(0.5, 0.5, 4 * cell - 1, 4 * cell - 1);
  context.beginPath();
  for (let i = 1; i < 4; i++) {
    context.moveTo(i * cell, 0);
    context.lineTo(i * cell, 4 * cell);
    context.moveTo(0, i * cell);
    context.lineTo(4 * cell, i * cell);
  }
  context.stroke();
  context.strokeStyle = colors.blue;
  context.lineWidth = 2;
  context.beginPath();
  values.forEach((value, i) => {
    const bin = i >> 3, angle = ((i & 7) * Math.PI) / 4;
    const x = ((bin & 3) + 0.5) * cell, y = ((bin >> 2) + 0.5) * cell;
    const length = (0.48 * cell * value) / most;
    context.moveTo(x, y);
    context.lineTo(x + length * Math.cos(angle), y + length * Math.sin(angle));
  });
  context.stroke();
}

/** Names and values as a list. */
function factsOf(rows) {
  return make("dl", {}, ...rows.flatMap(([name, value]) => [make("dt", {}, name), make("dd", {}, value)]));
}

kinds.image = (element, data) => {
  const { scanpath: path, points } = data;
  const shown = { path: true, points: false };
  let fixation = path.time.length;
  let chosen = -1;
  const photo = make("img", { class: "photo", src: data.image.address, alt: "The photograph" });
  const heat = make("img", { class: "heat", alt: "", hidden: true });
  const canvas = make("canvas", { class: "over", "aria-hidden": "true" });
  const box = make("div", { class: "photograph" }, photo, heat, canvas);
  box.style.aspectRatio = `${data.image.width} / ${data.image.height}`;
  const scale = () => canvas.clientWidth / data.image.width;

  function draw() {
    const context = sized(canvas);
    if (points && shown.points) drawPoints(context, points, chosen, scale());
    if (shown.path) drawScanpath(context, path, fixation, scale());
  }
  const play = player("Fixation", path.time.length + 1,
    (step) => 1000 * SLOWER * (step < path.time.length ? path.time[step] - (path.time[step - 1] || 0) : 0.1), show);
  function show(step) {
    fixation = step;
    play.set(step, step === 0 ? "before the first fixation"
      : `fixation ${step}, ${short(1000 * path.time[step - 1], 0)} ms`);
    element.dataset.fixation = step;
    draw();
  }

  const group = `map-${Math.random().toString(36).slice(2)}`;
  const choice = (name, address, on) => {
    const radio = make("input", { type: "radio", name: group, onchange: () => {
      heat.hidden = address === null;
      if (address !== null) heat.src = address;
      element.dataset.map = name;
    } });
    radio.checked = on;
    return make("label", { class: "toggle" }, radio, name);
  };
  const strength = make("input", {
    type: "range", min: 10, max: 100, value: 75,
    oninput: () => { heat.style.opacity = strength.value / 100; },
  });
  heat.style.opacity = 0.75;
  const maps = make("fieldset", {}, make("legend", {}, "Map"),
    choice("none", null, true), ...data.maps.map((each) => choice(each.name, each.address, false)),
    make("label", { class: "toggle" }, "strength ", strength));

  const detail = make("div", { class: "detail", "aria-live": "polite" });
  const pointField = points ? chooser("Point", points.size.length, (index) => choose(index)) : null;
  function choose(index) {
    chosen = index;
    if (index >= 0 && !shown.points) pointBox.querySelector("input").click();
    pointField.set(index);
    element.dataset.point = index;
    tell();
    draw();
  }
  function tell() {
    detail.replaceChildren();
    if (chosen < 0) {
      detail.append(make("p", { class: "hint" }, "Point at an interest point to see its descriptor."));
      return;
    }
    detail.append(factsOf([
      ["place", `${short(points.xy[2 * chosen], 1)}, ${short(points.xy[2 * chosen + 1], 1)} px`],
      ["size", `${short(points.size[chosen], 1)} px`],
      ["angle", `${short((points.angle[chosen] * 180) / Math.PI, 0)}°`],
      ["octave", String(points.octave[chosen])],
      ["response", points.response[chosen].toPrecision(3)],
    ]));
    if (points.descriptor) {
      const star = make("canvas", {
        class: "descriptor", role: "img",
        "aria-label": `Descriptor of point ${chosen + 1}: 16 histograms of 8 directions`,
      });
      detail.append(star);
      drawDescriptor(star, points.descriptor.subarray(128 * chosen, 128 * chosen + 128), palette());
    }
  }
  const pointBox = toggle("interest points", "orange", false, (on) => { shown.points = on; draw(); }, "ring");
  if (points) {
    const find = (event) => {
      if (!shown.points) return;
      const edge = canvas.getBoundingClientRect();
      const index = nearest(points.xy, 2, (event.clientX - edge.left) / scale(),
        (event.clientY - edge.top) / scale(), FOUND / scale());
      if (index >= 0 && index !== chosen) choose(index);
    };
    box.addEventListener("pointermove", find);
    box.addEventListener("pointerdown", find);
  }
  const side = make("div", { class: "side" }, maps);
  if (points) side.append(pointField.element, detail);
  const layers = make("div", { class: "layers" },
    toggle("scanpath", "orange", true, (on) => { shown.path = on; draw(); }), ...(points ? [pointBox] : []));
  element.append(make("div", { class: "stage" }, make("div", { class: "main" }, box, play.element, layers), side));
  new ResizeObserver(draw).observe(canvas);
  onTheme(tell);
  tell();
  show(fixation);
};
