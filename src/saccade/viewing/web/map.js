"use strict";
/* A map over time: trajectories and landmarks, camera images, one landmark, and charts. */

const TRAJECTORIES = {
  estimate: ["blue", 2, [], "line"], odometry: ["gray", 1.25, [5, 4], "dashed"],
  truth: ["green", 4, [], "thick"], smoothed: ["ink", 1.25, [], "thin"],
  lost: ["red", 2.5, [], "line"],
};
const KINDS = [["new", "orange"], ["tracked", "green"], ["re-identified", "red"]];
const MAX_BUTTONS = 40;

/** First row of each part of a table, from the number of rows of each. */
function firstRows(counts) {
  const sums = [0];
  for (const count of counts) sums.push(sums[sums.length - 1] + count);
  return sums;
}

/** Snapshots of the map: the rows of their landmarks in one table. */
class Snapshots {
  constructor(data, loaded) {
    this.data = data;
    this.loaded = loaded; // landmarks with a smaller id are of a map that was loaded
    this.first = firstRows(data.count);
    this.firstObserved = firstRows(data.observed_count);
    this.length = data.step.length;
  }
  landmark(row) {
    const from = 5 * row;
    return this.data.landmark.subarray(from, from + 5);
  }
  rowOf(id, number) {
    const from = this.first[number], to = this.first[number + 1];
    const row = from + lowerBound(this.data.id.subarray(from, to), id);
    return row < to && this.data.id[row] === id ? row : -1;
  }
  observed(number) {
    const from = this.firstObserved[number];
    return Array.from(this.data.observed.subarray(from, this.firstObserved[number + 1]),
      (row) => row + this.first[number]);
  }
  at(time) {
    return Math.min(this.length - 1, lowerBound(this.data.time, time - 1e-4));
  }
}

/** Bounds of the fitted map: the trajectories but dead reckoning, and the final landmarks with their ellipses. */
function boundsOf(data, snapshots) {
  const box = [Infinity, Infinity, -Infinity, -Infinity];
  const add = (x, y) => {
    box[0] = Math.min(box[0], x); box[1] = Math.min(box[1], y);
    box[2] = Math.max(box[2], x); box[3] = Math.max(box[3], y);
  };
  const end = data.snapshots.time[snapshots.length - 1] + 1e-4; // the truth may be longer
  for (const trajectory of data.trajectories.filter((each) => each.name !== "odometry")) {
    for (let i = 0; i < trajectory.time.length && trajectory.time[i] <= end; i++) add(trajectory.xy[2 * i], trajectory.xy[2 * i + 1]);
  }
  const last = snapshots.length - 1;
  const rows = Array.from({ length: snapshots.first[last + 1] - snapshots.first[last] }, (_, i) => snapshots.first[last] + i);
  const landmarks = rows.map((row) => snapshots.landmark(row));
  for (const [x, y] of landmarks) add(x, y);
  const limit = 0.1 * Math.max(box[2] - box[0], box[3] - box[1]); // or uncertain landmarks would shrink the map
  for (const [x, y, xx, , yy] of landmarks) {
    const [across, up] = [xx, yy].map((variance) => Math.min(limit, data.ellipse_scale * Math.sqrt(variance)));
    add(x - across, y - up); add(x + across, y + up);
  }
  return box;
}

/** The part of the estimate between two times, for which the robot was lost. */
function lostPart(estimate, [begin, end]) {
  const from = lowerBound(estimate.time, begin - 1e-4), to = lowerBound(estimate.time, end + 1e-4);
  return {
    name: "lost", time: estimate.time.slice(from, to), xy: estimate.xy.slice(2 * from, 2 * to),
  };
}

function drawTrajectory(context, view, trajectory, time, colors) {
  const [color, width, dash] = TRAJECTORIES[trajectory.name];
  const end = lowerBound(trajectory.time, time + 1e-4);
  context.strokeStyle = colors[color];
  context.lineWidth = width;
  context.lineJoin = "round";
  context.setLineDash(dash);
  for (const [from, to, alpha] of [[0, trajectory.time.length, 0.22], [0, end, trajectory.name === "truth" ? 0.55 : 1]]) {
    context.globalAlpha = alpha;
    context.beginPath();
    for (let i = from; i < to; i++) {
      context.lineTo(view.x(trajectory.xy[2 * i]), view.y(trajectory.xy[2 * i + 1]));
    }
    context.stroke();
  }
  context.globalAlpha = 1;
  context.setLineDash([]);
}

/** The landmarks of one snapshot, with lines from the robot to those it observes. */
function drawLandmarks(context, view, snapshots, number, shown, chosen, ellipseScale, colors) {
  const from = snapshots.first[number], to = snapshots.first[number + 1];
  const robot = snapshots.data.pose.subarray(6 * number, 6 * number + 2);
  if (shown.observed) {
    context.strokeStyle = colors.green;
    context.lineWidth = 1;
    context.globalAlpha = 0.7;
    context.beginPath();
    for (const row of snapshots.observed(number)) {
      const [x, y] = snapshots.landmark(row);
      context.moveTo(view.x(robot[0]), view.y(robot[1]));
      context.lineTo(view.x(x), view.y(y));
    }
    context.stroke();
    context.globalAlpha = 1;
  }
  if (shown.ellipses) {
    context.beginPath();
    for (let row = from; row < to; row++) addEllipse(context, view, ...snapshots.landmark(row), ellipseScale);
    context.fillStyle = `${colors.orange}2e`;
    context.fill();
    context.strokeStyle = colors.orange;
    context.lineWidth = 1;
    context.stroke();
  }
  const radius = Math.min(3, Math.max(1.4, 260 / Math.sqrt(1 + 60 * (to - from))));
  for (const loaded of [true, false]) {
    context.fillStyle = loaded ? colors.blue : colors.ink;
    context.beginPath();
    for (let row = from; row < to; row++) {
      if (snapshots.data.id[row] < snapshots.loaded !== loaded) continue;
      const [x, y] = snapshots.landmark(row);
      context.moveTo(view.x(x) + radius, view.y(y));
      context.arc(view.x(x), view.y(y), radius, 0, 2 * Math.PI);
    }
    context.fill();
  }
  if (chosen >= 0) {
    const [x, y] = snapshots.landmark(chosen);
    context.strokeStyle = colors.red;
    context.lineWidth = 2.5;
    context.beginPath();
    context.arc(view.x(x), view.y(y), 10, 0, 2 * Math.PI);
    context.stroke();
  }
}

/** A camera image with its landmarks; where `id` is not negative, only that one. */
function drawImage(canvas, entry, points, id, colors) {
  const context = sized(canvas);
  const scale = canvas.clientWidth / entry.source.width;
  context.drawImage(entry.image, 0, 0, canvas.clientWidth, canvas.clientHeight);
  if (!points) return;
  for (let i = lowerBound(points.step, entry.step); points.step[i] === entry.step; i++) {
    const chosen = points.id[i] === id;
    context.strokeStyle = colors[KINDS[points.kind[i]][1]];
    context.lineWidth = chosen ? 3 : 1.5;
    context.beginPath();
    context.arc((points.xy[2 * i] + 0.5) * scale, (points.xy[2 * i + 1] + 0.5) * scale,
      chosen ? 8 : 3.5, 0, 2 * Math.PI);
    if (chosen || id < 0) context.stroke();
  }
}

/** A canvas with the aspect ratio of a camera image. */
function imageCanvas(entry, label) {
  const canvas = make("canvas", { class: "seen", role: "img", "aria-label": label });
  canvas.style.aspectRatio = `${entry.source.width} / ${entry.source.height}`;
  return canvas;
}

/** Load the camera images; `loaded` is called for each. */
function loadImages(data, loaded) {
  return data.images.map(({ step, source }) => {
    const entry = { step, source, image: new Image() };
    entry.image.addEventListener("load", () => loaded(entry));
    entry.image.src = source.address;
    return entry;
  });
}

kinds.map = (element, data) => {
  const snapshots = new Snapshots(data.snapshots, data.loaded);
  const shown = { ellipses: true, observed: true, true: true, lost: true };
  for (const trajectory of data.trajectories) shown[trajectory.name] = true;
  let number = snapshots.length - 1;
  let id = -1; // of the chosen landmark
  const named = (each) => data.names[each] ?? each;
  const period = Math.max(20, Math.min(80, 12000 / snapshots.length));

  const canvas = make("canvas", {
    class: "ground", tabindex: 0, role: "application",
    "aria-label": "Map. Arrow keys move it, plus and minus zoom, 0 shows all; landmarks can also "
      + "be chosen from the list below.",
  });
  const ground = plane(canvas, boundsOf(data, snapshots), draw, chooseAt);
  const play = player("Time", snapshots.length, () => period, show);
  const charts = linkedCharts(data.charts, showTime);
  const estimate = data.trajectories.find((each) => each.name === "estimate");
  const lost = data.lost.map((each) => lostPart(estimate, each));
  const images = loadImages(data, () => drawCamera());
  const camera = images.length ? imageCanvas(images[0], "Camera image") : null;
  const detail = make("div", { class: "detail", "aria-live": "polite" });
  const intervals = intervalsById(data.intervals);
  const list = make("select", { "aria-label": "Landmark", onchange: () => choose(Number(list.value)) },
    make("option", { value: -1 }, "none"),
    ...[...intervals.keys()].sort((a, b) => a - b).map((each) => make("option", { value: each }, String(each))));

  function draw(context, view) {
    const colors = palette(), time = data.snapshots.time[number];
    for (const trajectory of [...data.trajectories].reverse()) {
      if (shown[trajectory.name]) drawTrajectory(context, view, trajectory, time, colors);
    }
    if (shown.lost) for (const each of lost) drawTrajectory(context, view, each, time, colors);
    if (data.truth && shown.true) {
      context.strokeStyle = colors.green;
      context.lineWidth = 1.5;
      context.beginPath();
      for (let i = 0; i < data.truth.length; i += 2) {
        const x = view.x(data.truth[i]), y = view.y(data.truth[i + 1]);
        context.moveTo(x + 6, y);
        context.arc(x, y, 6, 0, 2 * Math.PI);
      }
      context.stroke();
    }
    const chosen = id < 0 ? -1 : snapshots.rowOf(id, number);
    drawLandmarks(context, view, snapshots, number, shown, chosen, data.ellipse_scale, colors);
    drawRobot(context, view, data.snapshots.pose.subarray(6 * number, 6 * number + 6), data.ellipse_scale, colors);
    drawScale(context, view, colors);
  }

  function drawCamera() {
    if (!camera) return;
    const step = data.snapshots.step[number];
    let entry = images[0];
    for (const each of images) if (each.step <= step) entry = each;
    drawImage(camera, entry, data.image_points, -1, palette());
    for (const each of detail.querySelectorAll("canvas")) each.draw();
  }

  function show(next) {
    number = next;
    const time = data.snapshots.time[number];
    const count = data.snapshots.count[number];
    const isLost = data.lost.some(([begin, end]) => begin <= time && time < end);
    play.set(number, `${short(time, 1)} s · ${count} landmark${count === 1 ? "" : "s"}${isLost ? " · lost" : ""}`);
    charts.mark(time);
    ground.redraw();
    drawCamera();
    element.dataset.step = data.snapshots.step[number];
  }
  function showTime(time) {
    play.stop();
    show(snapshots.at(time));
  }

  function chooseAt(x, y, radius) {
    let best = -1, minDistance = radius;
    for (let row = snapshots.first[number]; row < snapshots.first[number + 1]; row++) {
      const [landmarkX, landmarkY] = snapshots.landmark(row);
      const distance = Math.hypot(landmarkX - x, landmarkY - y);
      if (distance < minDistance) [best, minDistance] = [row, distance];
    }
    choose(best < 0 ? -1 : data.snapshots.id[best]);
  }
  function choose(next) {
    id = next;
    list.value = intervals.has(id) ? id : -1;
    element.dataset.landmark = id;
    showDetail();
    ground.redraw();
  }
  function showDetail() {
    detail.replaceChildren();
    if (id < 0) {
      detail.append(make("p", { class: "hint" }, "Click a landmark to see when it was observed."));
      return;
    }
    const ofLandmark = intervals.get(id) || [];
    const count = ofLandmark.reduce((sum, each) => sum + each.count, 0);
    const row = snapshots.rowOf(id, number);
    const times = count === 1 ? "once" : `${count} times`;
    const origin = id < data.loaded ? ", of the map that was loaded" : data.loaded > 0 ? ", new" : "";
    detail.append(make("h3", {}, `Landmark ${named(id)}${origin}`));
    let text = ofLandmark.length ? `Observed ${times}.` : "Not in the final map: its observations are not kept.";
    if (row >= 0) {
      const [x, y, xx, xy, yy] = snapshots.landmark(row);
      const sigma = Math.sqrt((xx + yy) / 2 + Math.hypot((xx - yy) / 2, xy));
      text += ` At ${short(x)}, ${short(y)} m; ${data.ellipse_label}: up to ${short(data.ellipse_scale * sigma, 3)} m.`;
    }
    detail.append(make("p", {}, text));
    const buttons = ofLandmark.slice(0, MAX_BUTTONS).map(({ first, last, time }) => make(
      "button", { type: "button", class: "run", onclick: () => showTime(time) },
      first === last ? String(first) : `${first}–${last}`));
    if (buttons.length) {
      detail.append(make("p", { class: "label" }, images.length ? "In the frames" : "From the poses"), make("div", { class: "runs" }, ...buttons));
    }
    if (ofLandmark.length > MAX_BUTTONS) detail.append(make("p", {}, `and ${ofLandmark.length - MAX_BUTTONS} times more`));
    detail.append(gallery());
  }
  function gallery() {
    const points = data.image_points;
    const box = make("div", { class: "gallery" });
    if (!points || !images.length) return box;
    const steps = new Set();
    for (let i = 0; i < points.step.length; i++) if (points.id[i] === id) steps.add(points.step[i]);
    const all = images.filter((entry) => steps.has(entry.step));
    const every = Math.max(1, Math.ceil(all.length / 6));
    for (const entry of all.filter((_, i) => i % every === 0)) {
      const small = imageCanvas(entry, `Landmark ${named(id)} in frame ${entry.step}`);
      small.draw = () => drawImage(small, entry, points, id, palette());
      const button = make("button", {
        type: "button", class: "thumb", onclick: () => {
          play.stop();
          show(Math.min(snapshots.length - 1, lowerBound(data.snapshots.step, entry.step)));
        },
      }, small, `frame ${entry.step}`);
      box.append(button);
      requestAnimationFrame(small.draw);
    }
    return box;
  }

  const redrawn = (key) => (on) => { shown[key] = on; ground.redraw(); };
  const layers = [
    ...data.trajectories.map((each) => toggle(
      each.name, TRAJECTORIES[each.name][0], true,
      redrawn(each.name), TRAJECTORIES[each.name][3])),
    toggle(data.ellipse_label, "orange", true, redrawn("ellipses"), "ring"),
    toggle("observed", "green", true, redrawn("observed"), "thin"),
  ];
  if (lost.length) layers.push(toggle("lost", "red", true, redrawn("lost"), "line"));
  if (data.truth) layers.push(toggle("true landmarks", "green", true, redrawn("true"), "ring"));
  const zooms = make("div", { class: "zooms" },
    ...[["+", "Zoom in", () => ground.zoom(1.4)], ["−", "Zoom out", () => ground.zoom(1 / 1.4)],
      ["⤢", "Show all", () => ground.fit()]].map(([sign, label, act]) => make(
      "button", { type: "button", "aria-label": label, title: label, onclick: act }, sign)));
  const side = make("div", { class: "side" });
  if (camera) {
    side.append(make("figure", { class: "camera" }, camera, make("figcaption", {},
      ...KINDS.map(([word, color]) => make("span", { class: "key" },
        make("span", { class: `swatch ring ${color}`, "aria-hidden": "true" }), word)))));
  }
  side.append(make("label", { class: "choose" }, "Landmark ", list), detail);
  element.append(
    make("div", { class: "stage" },
      make("div", { class: "main" }, canvas, play.element,
        make("div", { class: "under" }, make("div", { class: "layers" }, ...layers), zooms)),
      side),
    charts.element,
  );
  new ResizeObserver(drawCamera).observe(element);
  onTheme(() => { drawCamera(); });
  showDetail();
  show(number);
};

/** The intervals in which each landmark was observed. */
function intervalsById({ id, first, last, count, time }) {
  const byId = new Map();
  id.forEach((each, i) => {
    if (!byId.has(each)) byId.set(each, []);
    byId.get(each).push({ first: first[i], last: last[i], count: count[i], time: time[i] });
  });
  return byId;
}
