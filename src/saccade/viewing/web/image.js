"use strict";
/* A photograph with layers: maps, the scanpath played in time, interest points. */

const SLOWDOWN = 4; // of a scanpath that is played, against the model

/** Index of the point nearest to a position, -1 where none is within a radius. */
function nearest(xy, x, y, radius) {
  let best = -1, minDistance = radius;
  for (let i = 0; i < xy.length; i += 2) {
    const distance = Math.hypot(xy[i] - x, xy[i + 1] - y);
    if (distance < minDistance) [best, minDistance] = [i / 2, distance];
  }
  return best;
}

const LABEL = 10; // radius of the label of a fixation in pixels

/** Positions of labels: those that would hide each other are moved apart, within the canvas. */
function apart(positions, width, height) {
  const golden = 2.399963; // an angle that separates equal positions
  const placed = positions.map(([x, y], i) => [x + 0.1 * Math.cos(golden * i), y + 0.1 * Math.sin(golden * i)]);
  const inside = (value, size) => Math.min(Math.max(value, LABEL), Math.max(size - LABEL, LABEL));
  for (let round = 0; round < 200; round++) {
    const push = placed.map(() => [0, 0]);
    for (let i = 0; i < placed.length; i++) {
      for (let k = 0; k < i; k++) {
        const dx = placed[i][0] - placed[k][0], dy = placed[i][1] - placed[k][1];
        const distance = Math.max(Math.hypot(dx, dy), 1e-6);
        const share = (0.3 * Math.max(2 * LABEL - distance, 0)) / distance;
        push[i][0] += share * dx;
        push[i][1] += share * dy;
        push[k][0] -= share * dx;
        push[k][1] -= share * dy;
      }
    }
    placed.forEach((xy, i) => {
      xy[0] = inside(xy[0] + push[i][0], width);
      xy[1] = inside(xy[1] + push[i][1], height);
    });
  }
  return placed;
}

/** Draws the first `count` fixations; labels keep their places while the path is played. */
function drawScanpath(context, path, count, scale, size) {
  const positions = Array.from(path.time, (_, i) => [path.xy[2 * i] * scale, path.xy[2 * i + 1] * scale]);
  const labels = apart(positions, size.width * scale, size.height * scale);
  context.lineJoin = "round";
  outlined(context, ON_PHOTO.path, 2, () => {
    for (const [x, y] of positions.slice(0, count)) context.lineTo(x, y);
  });
  context.font = "600 12px system-ui, sans-serif";
  context.textAlign = "center";
  context.textBaseline = "middle";
  context.lineWidth = 1.5;
  for (let i = 0; i < count; i++) {
    const [x, y] = labels[i], [left, top] = positions[i];
    context.strokeStyle = context.fillStyle = "#000";
    if (Math.hypot(x - left, y - top) > LABEL) {
      context.beginPath();
      context.moveTo(left, top);
      context.lineTo(x, y);
      context.stroke();
      context.beginPath();
      context.arc(left, top, 2.5, 0, 2 * Math.PI);
      context.fill();
    }
    context.beginPath();
    context.arc(x, y, LABEL, 0, 2 * Math.PI);
    context.fillStyle = i === 0 ? "#fff" : ON_PHOTO.path;
    context.fill();
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

/**
 * The rays of a descriptor: x, y of both ends for each of its 128 entries. There are 4 x 4
 * cells of 8 directions, which turn from y towards x; the x axis is the angle of the point.
 */
function descriptorRays(values, cell) {
  const largest = Math.max(1, ...values);
  return Array.from(values, (value, i) => {
    const bin = i >> 3, angle = (-(i & 7) * Math.PI) / 4, length = (0.48 * cell * value) / largest;
    const x = ((bin & 3) + 0.5) * cell, y = ((bin >> 2) + 0.5) * cell;
    return [x, y, x + length * Math.cos(angle), y + length * Math.sin(angle)];
  });
}

/** A descriptor as its histograms: 4 x 4 cells of 8 directions. */
function drawDescriptor(canvas, values, colors) {
  const context = sized(canvas), cell = canvas.clientWidth / 4;
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
  for (const [x, y, endX, endY] of descriptorRays(values, cell)) {
    context.moveTo(x, y);
    context.lineTo(endX, endY);
  }
  context.stroke();
}

/** The properties of a point, and its descriptor. */
function pointFacts(points, index) {
  const facts = definitionList([
    ["position", `${short(points.xy[2 * index], 1)}, ${short(points.xy[2 * index + 1], 1)} px`],
    ["size", `${short(points.size[index], 1)} px`],
    ["angle", `${short((points.angle[index] * 180) / Math.PI, 0)}°`],
    ["octave", String(points.octave[index])],
    ["response", points.response[index].toPrecision(3)],
  ]);
  if (!points.descriptor) return [facts];
  const star = make("canvas", {
    class: "descriptor", role: "img",
    "aria-label": `Descriptor of point ${index + 1}: 16 histograms of 8 directions`,
  });
  star.draw = () => drawDescriptor(
    star, points.descriptor.subarray(128 * index, 128 * index + 128), palette());
  return [facts, star];
}

/** The choice of the map that overlays the photograph, and its opacity. */
function mapChoice(element, heat) {
  const group = `map-${Math.random().toString(36).slice(2)}`;
  const opacity = make("input", {
    type: "range", min: 10, max: 100, value: 75,
    oninput: () => { heat.style.opacity = opacity.value / 100; },
  });
  heat.style.opacity = 0.75;
  const box = make("fieldset");
  let shown = "none", maps = [];
  function show(name) {
    const map = maps.find((each) => each.name === name);
    shown = map ? name : "none";
    heat.hidden = !map;
    if (map) heat.src = map.address;
    element.dataset.map = shown;
  }
  const choice = (name) => {
    const radio = make("input", { type: "radio", name: group, value: name, onchange: () => show(name) });
    return make("label", { class: "toggle" }, radio, name);
  };
  return {
    element: box,
    /** Replace the maps; the one that is shown stays shown. */
    replace(next, name = shown) {
      const names = (all) => all.map((each) => each.name).join();
      if (!box.hasChildNodes() || names(next) !== names(maps)) {
        box.replaceChildren(make("legend", {}, "Map"), choice("none"),
          ...next.map((each) => choice(each.name)),
          make("label", { class: "toggle" }, "opacity ", opacity));
      }
      maps = next;
      show(name);
      for (const radio of box.querySelectorAll("input[type=radio]")) radio.checked = radio.value === shown;
    },
  };
}

/**
 * Shows `data.image` with its `maps`, `scanpath` and `points`, and `samples` where there are any (see
 * samples.js); `data.map`, or else the first map, is shown first. `change` of what it returns replaces any of them; `side` and `layers` take more elements.
 */
kinds.image = (element, data) => {
  let { image, scanpath: path, points } = data;
  const shown = { path: true, points: false, samples: false };
  const samples = data.samples;
  let fixation = path.time.length;
  const photo = make("img", { class: "photo", alt: "The photograph" });
  const heat = make("img", { class: "heat", alt: "", hidden: true });
  const canvas = make("canvas", { class: "over", "aria-hidden": "true" });
  const box = make("div", { class: "photograph" }, photo, heat, canvas);
  const scale = () => canvas.clientWidth / image.width;

  function draw() {
    const context = sized(canvas);
    if (samples && shown.samples) drawSamples(context, samples, scale());
    if (shown.points) drawPoints(context, points, selected.chosen, scale());
    if (shown.path) drawScanpath(context, path, fixation, scale(), image);
  }
  const play = player("Fixation", path.time.length + 1,
    (step) => 1000 * SLOWDOWN * (step < path.time.length ? path.time[step] - (path.time[step - 1] || 0) : 0.1), show);
  function show(step) {
    fixation = step;
    play.set(step, step === 0 ? "before the first fixation"
      : `fixation ${step}, ${short(1000 * path.time[step - 1], 0)} ms`);
    element.dataset.fixation = step;
    draw();
  }
  const maps = mapChoice(element, heat);
  const pointBox = toggle("interest points", "orange", false, (on) => { shown.points = on; draw(); }, "ring");
  const selected = selection(element, "Point", points.size.length,
    "Point at an interest point to see its descriptor.", (index) => pointFacts(points, index), () => {
      if (selected.chosen >= 0) showPoints();
      draw();
    });
  function showPoints() {
    if (!shown.points) pointBox.querySelector("input").click();
  }
  const chooseAt = (event) => {
    if (!shown.points) return;
    const [x, y] = positionIn(canvas, event);
    const index = nearest(points.xy, x / scale(), y / scale(), POINTER_RADIUS / scale());
    if (index >= 0 && index !== selected.chosen) selected.choose(index);
  };
  box.addEventListener("pointermove", chooseAt);
  box.addEventListener("pointerdown", chooseAt);
  const side = make("div", { class: "side" }, maps.element, ...selected.nodes);
  const layers = make("div", { class: "layers" },
    toggle("scanpath", "orange", true, (on) => { shown.path = on; draw(); }), pointBox);
  if (samples) {
    layers.append(toggle(`${samples.xy.length / 2 / samples.length} sampled scanpaths`, "blue", false,
      (on) => { shown.samples = on; draw(); }));
  }
  element.append(make("div", { class: "stage" }, make("div", { class: "main" }, box, play.element, layers), side));
  if (samples) element.append(saccadeFigures(samples, image));

  function change(next) {
    if (next.image) {
      image = next.image;
      photo.src = image.address;
      box.style.setProperty("--ratio", image.width / image.height);
    }
    if (next.maps) maps.replace(next.maps, next.map);
    if (next.points) {
      points = next.points;
      selected.replace(points.size.length);
      for (const node of [pointBox, ...selected.nodes]) node.hidden = points.size.length === 0;
    }
    if (next.scanpath) {
      const atEnd = fixation === path.time.length;
      path = next.scanpath;
      play.setCount(path.time.length + 1);
      fixation = atEnd ? path.time.length : Math.min(fixation, path.time.length);
    }
    show(fixation);
  }
  new ResizeObserver(draw).observe(canvas);
  change({ ...data, map: data.map ?? data.maps[0]?.name });
  return { side, layers, change, showPoints };
};
