"use strict";
/* A map while it grows: the ground, what the camera saw, one landmark, and charts over time. */

const DRIVES = {
  estimate: ["blue", 2, [], "line"], odometry: ["grey", 1.25, [5, 4], "dashed"],
  truth: ["green", 4, [], "thick"], smoothed: ["ink", 1.25, [], "thin"],
};
const KINDS_SEEN = [["new", "orange"], ["followed", "green"], ["recognized", "red"]];
const MOST_BUTTONS = 40;

/** First index in ascending numbers that is not below a value. */
function lowerBound(values, value) {
  let low = 0, high = values.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (values[middle] < value) low = middle + 1;
    else high = middle;
  }
  return low;
}

/** Where the parts of a table begin, from how many rows each has. */
function starts(counts) {
  const sums = [0];
  for (const count of counts) sums.push(sums[sums.length - 1] + count);
  return sums;
}

/** The landmarks of a snapshot: their rows in the table, found by name. */
class Snapshots {
  constructor(data) {
    this.data = data;
    this.first = starts(data.count);
    this.firstSeen = starts(data.observed_count);
    this.length = data.step.length;
  }
  landmark(row) {
    const from = 5 * row;
    return this.data.landmark.subarray(from, from + 5);
  }
  rowOf(name, number) {
    const from = this.first[number], to = this.first[number + 1];
    const row = from + lowerBound(this.data.id.subarray(from, to), name);
    return row < to && this.data.id[row] === name ? row : -1;
  }
  seen(number) {
    const from = this.firstSeen[number];
    return Array.from(this.data.observed.subarray(from, this.firstSeen[number + 1]),
      (row) => row + this.first[number]);
  }
  at(time) {
    return Math.min(this.length - 1, lowerBound(this.data.time, time - 1e-4));
  }
}

/** What the map shows when it is fitted: the estimate, and the landmarks as they end. */
function boxOf(data, snapshots) {
  const box = [Infinity, Infinity, -Infinity, -Infinity];
  const add = (x, y) => {
    box[0] = Math.min(box[0], x); box[1] = Math.min(box[1], y);
    box[2] = Math.max(box[2], x); box[3] = Math.max(box[3], y);
  };
  const end = data.snapshots.time[snapshots.length - 1] + 1e-4; // the truth may go on
  for (const drive of data.trajectories.filter((each) => each.name !== "odometry")) {
    for (let i = 0; i < drive.time.length && drive.time[i] <= end; i++) add(drive.xy[2 * i], drive.xy[2 * i + 1]);
  }
  const last = snapshots.length - 1;
  for (let row = snapshots.first[last]; row < snapshots.first[last + 1]; row++) {
    const [x, y] = snapshots.landmark(row);
    add(x, y);
  }
  return box;
}

function drawDrive(context, view, drive, time, colors) {
  const [color, width, dash] = DRIVES[drive.name];
  const end = lowerBound(drive.time, time + 1e-4);
  context.strokeStyle = colors[color];
  context.lineWidth = width;
  context.lineJoin = "round";
  context.setLineDash(dash);
  for (const [from, to, alpha] of [[0, drive.time.length, 0.22], [0, end, drive.name === "truth" ? 0.55 : 1]]) {
    context.globalAlpha = alpha;
    context.beginPath();
    for (let i = from; i < to; i++) {
      context.lineTo(view.x(drive.xy[2 * i]), view.y(drive.xy[2 * i + 1]));
    }
    context.stroke();
  }
  context.globalAlpha = 1;
  context.setLineDash([]);
}

function drawRobot(context, view, pose, sigmas, colors) {
  const [x, y, heading, xx, xy, yy] = pose;
  context.strokeStyle = colors.blue;
  context.lineWidth = 1.5;
  context.beginPath();
  addEllipse(context, view, x, y, xx, xy, yy, sigmas);
  context.stroke();
  context.save();
  context.translate(view.x(x), view.y(y));
  context.rotate(-heading);
  context.beginPath();
  for (const [a, b] of [[12, 0], [-8, 7], [-4, 0], [-8, -7]]) context.lineTo(a, b);
  context.closePath();
  context.fillStyle = colors.red;
  context.strokeStyle = colors.paper;
  context.lineWidth = 1.5;
  context.fill();
  context.stroke();
  context.restore();
}

/** The landmarks of one snapshot, those in sight joined with the robot. */
function drawLandmarks(context, view, snapshots, number, shown, chosen, sigmas, colors) {
  const from = snapshots.first[number], to = snapshots.first[number + 1];
  const robot = snapshots.data.pose.subarray(6 * number, 6 * number + 2);
  if (shown.sight) {
    context.strokeStyle = colors.green;
    context.lineWidth = 1;
    context.globalAlpha = 0.7;
    context.beginPath();
    for (const row of snapshots.seen(number)) {
      const [x, y] = snapshots.landmark(row);
      context.moveTo(view.x(robot[0]), view.y(robot[1]));
      context.lineTo(view.x(x), view.y(y));
    }
    context.stroke();
    context.globalAlpha = 1;
  }
  if (shown.ellipses) {
    context.beginPath();
    for (let row = from; row < to; row++) addEllipse(context, view, ...snapshots.landmark(row), sigmas);
    context.fillStyle = `${colors.orange}2e`;
    context.fill();
    context.strokeStyle = colors.orange;
    context.lineWidth = 1;
    context.stroke();
  }
  const radius = Math.min(3, Math.max(1.4, 260 / Math.sqrt(1 + 60 * (to - from))));
  context.fillStyle = colors.ink;
  context.beginPath();
  for (let row = from; row < to; row++) {
    const [x, y] = snapshots.landmark(row);
    context.moveTo(view.x(x) + radius, view.y(y));
    context.arc(view.x(x), view.y(y), radius, 0, 2 * Math.PI);
  }
  context.fill();
  if (chosen >= 0) {
    const [x, y] = snapshots.landmark(chosen);
    context.strokeStyle = colors.red;
    context.lineWidth = 2.5;
    context.beginPath();
    context.arc(view.x(x), view.y(y), 10, 0, 2 * Math.PI);
    context.stroke();
  }
}

/** A picture of the camera on a canvas with the landmarks that it shows. */
function drawPicture(canvas, entry, pixels, name, colors) {
  const context = sized(canvas);
  const scale = canvas.clientWidth / entry.source.width;
  context.drawImage(entry.image, 0, 0, canvas.clientWidth, canvas.clientHeight);
  if (!pixels) return;
  for (let i = lowerBound(pixels.step, entry.step); pixels.step[i] === entry.step; i++) {
    const chosen = pixels.id[i] === name;
    context.strokeStyle = colors[KINDS_SEEN[pixels.kind[i]][1]];
    context.lineWidth = chosen ? 3 : 1.5;
    context.beginPath();
    context.arc((pixels.xy[2 * i] + 0.5) * scale, (pixels.xy[2 * i + 1] + 0.5) * scale,
      chosen ? 8 : 3.5, 0, 2 * Math.PI);
    if (chosen || name < 0) context.stroke();
  }
}

/** A canvas for a picture that keeps its shape. */
function pictureCanvas(entry, words) {
  const canvas = make("canvas", { class: "seen", role: "img", "aria-label": words });
  canvas.style.aspectRatio = `${entry.source.width} / ${entry.source.height}`;
  return canvas;
}

/** Load the pictures; each is drawn once it is there. */
function picturesOf(data, ready) {
  return data.images.map(({ step, source }) => {
    const entry = { step, source, image: new Image() };
    entry.image.addEventListener("load", () => ready(entry));
    entry.image.src = source.address;
    return entry;
  });
}

kinds.map = (element, data) => {
  const snapshots = new Snapshots(data.snapshots);
  const shown = { ellipses: true, sight: true, true: true };
  for (const drive of data.trajectories) shown[drive.name] = true;
  let number = snapshots.length - 1;
  let name = -1;
  const period = Math.max(20, Math.min(80, 12000 / snapshots.length));

  const canvas = make("canvas", {
    class: "ground", tabindex: 0, role: "application",
    "aria-label": "Map. Arrow keys move it, plus and minus zoom, 0 shows all; landmarks can also "
      + "be chosen from the list below.",
  });
  const ground = plane(canvas, boxOf(data, snapshots), draw, pick);
  const play = player("Time", snapshots.length, () => period, show);
  const charts = data.charts.map((each) => chart(each, (time) => showTime(time)));
  const pictures = picturesOf(data, () => drawCamera());
  const camera = pictures.length ? pictureCanvas(pictures[0], "What the camera saw") : null;
  const detail = make("div", { class: "detail", "aria-live": "polite" });
  const runs = runsByName(data.intervals);
  const list = make("select", { "aria-label": "Landmark", onchange: () => choose(Number(list.value)) },
    make("option", { value: -1 }, "none"),
    ...[...runs.keys()].sort((a, b) => a - b).map((each) => make("option", { value: each }, String(each))));

  function draw(context, view) {
    const colors = palette(), time = data.snapshots.time[number];
    for (const drive of [...data.trajectories].reverse()) {
      if (shown[drive.name]) drawDrive(context, view, drive, time, colors);
    }
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
    const chosen = name < 0 ? -1 : snapshots.rowOf(name, number);
    drawLandmarks(context, view, snapshots, number, shown, chosen, data.ellipse_scale, colors);
    drawRobot(context, view, data.snapshots.pose.subarray(6 * number, 6 * number + 6), data.ellipse_scale, colors);
    drawScale(context, view, colors);
  }

  function drawCamera() {
    if (!camera) return;
    const step = data.snapshots.step[number];
    let entry = pictures[0];
    for (const each of pictures) if (each.step <= step) entry = each;
    drawPicture(camera, entry, data.image_points, -1, palette());
    for (const each of detail.querySelectorAll("canvas")) each.draw();
  }

  function show(next) {
    number = next;
    const time = data.snapshots.time[number];
    const count = data.snapshots.count[number];
    play.set(number, `${short(time, 1)} s · ${count} landmark${count === 1 ? "" : "s"}`);
    for (const each of charts) each.mark(time);
    ground.redraw();
    drawCamera();
    element.dataset.step = data.snapshots.step[number];
  }
  function showTime(time) {
    play.stop();
    show(snapshots.at(time));
  }

  function pick(x, y, reach) {
    let best = -1, least = reach;
    for (let row = snapshots.first[number]; row < snapshots.first[number + 1]; row++) {
      const place = snapshots.landmark(row);
      const apart = Math.hypot(place[0] - x, place[1] - y);
      if (apart < least) [best, least] = [row, apart];
    }
    choose(best < 0 ? -1 : data.snapshots.id[best]);
  }
  function choose(next) {
    name = next;
    list.value = runs.has(name) ? name : -1;
    element.dataset.landmark = name;
    tell();
    ground.redraw();
  }
  function tell() {
    detail.replaceChildren();
    if (name < 0) {
      detail.append(make("p", { class: "hint" }, "Click a landmark to see when it was seen."));
      return;
    }
    const own = runs.get(name) || [];
    const count = own.reduce((sum, each) => sum + each.count, 0);
    const row = snapshots.rowOf(name, number);
    const times = count === 1 ? "once" : `${count} times`;
    detail.append(make("h3", {}, `Landmark ${name}`));
    let words = own.length ? `Seen ${times}.` : "Not in the map at the end: what was seen of it is not kept.";
    if (row >= 0) {
      const [x, y, xx, xy, yy] = snapshots.landmark(row);
      const wide = Math.sqrt((xx + yy) / 2 + Math.hypot((xx - yy) / 2, xy));
      words += ` At ${short(x)}, ${short(y)} m, ${data.ellipse_label} ${short(data.ellipse_scale * wide, 3)} m.`;
    }
    detail.append(make("p", {}, words));
    const buttons = own.slice(0, MOST_BUTTONS).map(({ first, last, time }) => make(
      "button", { type: "button", class: "run", onclick: () => showTime(time) },
      first === last ? String(first) : `${first}–${last}`));
    if (buttons.length) {
      detail.append(make("p", { class: "label" }, pictures.length ? "In the frames" : "From the poses"), make("div", { class: "runs" }, ...buttons));
    }
    if (own.length > MOST_BUTTONS) detail.append(make("p", {}, `and ${own.length - MOST_BUTTONS} times more`));
    detail.append(gallery());
  }
  function gallery() {
    const pixels = data.image_points;
    const box = make("div", { class: "gallery" });
    if (!pixels || !pictures.length) return box;
    const there = new Set();
    for (let i = 0; i < pixels.step.length; i++) if (pixels.id[i] === name) there.add(pixels.step[i]);
    const all = pictures.filter((entry) => there.has(entry.step));
    const every = Math.max(1, Math.ceil(all.length / 6));
    for (const entry of all.filter((_, i) => i % every === 0)) {
      const small = pictureCanvas(entry, `Landmark ${name} in frame ${entry.step}`);
      small.draw = () => drawPicture(small, entry, pixels, name, palette());
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
      { odometry: "odometry alone" }[each.name] || each.name, DRIVES[each.name][0], true,
      redrawn(each.name), DRIVES[each.name][3])),
    toggle(data.ellipse_label, "orange", true, redrawn("ellipses"), "ring"),
    toggle("in sight", "green", true, redrawn("sight"), "thin"),
  ];
  if (data.truth) layers.push(toggle("true landmarks", "green", true, redrawn("true"), "ring"));
  const zooms = make("div", { class: "zooms" },
    ...[["+", "Zoom in", () => ground.zoom(1.4)], ["−", "Zoom out", () => ground.zoom(1 / 1.4)],
      ["⤢", "Show all", () => ground.fit()]].map(([sign, words, act]) => make(
      "button", { type: "button", "aria-label": words, title: words, onclick: act }, sign)));
  const side = make("div", { class: "side" });
  if (camera) {
    side.append(make("figure", { class: "camera" }, camera, make("figcaption", {},
      ...KINDS_SEEN.map(([word, color]) => make("span", { class: "key" },
        make("span", { class: `swatch ring ${color}`, "aria-hidden": "true" }), word)))));
  }
  side.append(make("label", { class: "choose" }, "Landmark ", list), detail);
  element.append(
    make("div", { class: "stage" },
      make("div", { class: "main" }, canvas, play.element,
        make("div", { class: "under" }, make("div", { class: "layers" }, ...layers), zooms)),
      side),
    make("div", { class: "charts" }, ...charts.map((each) => each.figure)),
  );
  new ResizeObserver(drawCamera).observe(element);
  onTheme(() => { drawCamera(); });
  tell();
  show(number);
};

/** Of each landmark, the stretches in which it was seen. */
function runsByName(runs) {
  const found = new Map();
  runs.id.forEach((name, i) => {
    if (!found.has(name)) found.set(name, []);
    found.get(name).push({ first: runs.first[i], last: runs.last[i], count: runs.count[i], time: runs.time[i] });
  });
  return found;
}
