"use strict";
/* What the SLAM playground draws: the world with one filter's estimate, and its correlations. */

const TRUE_RADIUS = 6; // pixels of the ring around a true landmark

/** `scene` has the truth and the estimate of the chosen filter; `shown` says what of them is drawn. */
function drawScene(context, view, scene, shown, colors) {
  const { history, world, map } = scene;
  const last = history.truth.length - 1, [x, y, heading] = history.truth[last];
  if (shown.truth) {
    drawRange(context, view, x, y, scene.range, colors);
    drawPath(context, view, history.truth, colors.green, 4, 0.5);
    drawTrueLandmarks(context, view, [x, y], world, colors);
  }
  drawPath(context, view, history.poses, colors.blue, 2, 1);
  if (shown.ellipses) {
    context.beginPath();
    for (let i = 0; i < map.landmarks.length; i += 5) {
      addEllipse(context, view, ...map.landmarks.subarray(i, i + 5), scene.ellipseScale);
    }
    context.fillStyle = `${colors.orange}2e`;
    context.fill();
    context.strokeStyle = colors.orange;
    context.lineWidth = 1;
    context.stroke();
  }
  context.fillStyle = colors.ink;
  for (let i = 0; i < map.landmarks.length; i += 5) {
    context.beginPath();
    context.arc(view.x(map.landmarks[i]), view.y(map.landmarks[i + 1]), 2.5, 0, 2 * Math.PI);
    context.fill();
  }
  if (shown.truth) drawArrow(context, view, x, y, heading, colors.green, colors.paper);
  drawRobot(context, view, [...history.poses[last], ...map.covariance], scene.ellipseScale, colors);
  drawScale(context, view, colors);
}

function drawPath(context, view, poses, color, width, alpha) {
  context.strokeStyle = color;
  context.lineWidth = width;
  context.lineJoin = "round";
  context.globalAlpha = alpha;
  context.beginPath();
  for (const [x, y] of poses) context.lineTo(view.x(x), view.y(y));
  context.stroke();
  context.globalAlpha = 1;
}

function drawRange(context, view, x, y, range, colors) {
  context.strokeStyle = colors.line;
  context.lineWidth = 1.5;
  context.setLineDash([5, 4]);
  context.beginPath();
  context.arc(view.x(x), view.y(y), range * view.scale, 0, 2 * Math.PI);
  context.stroke();
  context.setLineDash([]);
}

/** Rings around the true landmarks, and lines to those that were just observed. */
function drawTrueLandmarks(context, view, [robotX, robotY], world, colors) {
  context.strokeStyle = colors.green;
  context.lineWidth = 1.5;
  context.beginPath();
  world.landmarks.forEach(([x, y], i) => {
    context.moveTo(view.x(x) + TRUE_RADIUS, view.y(y));
    context.arc(view.x(x), view.y(y), TRUE_RADIUS, 0, 2 * Math.PI);
    if (!world.observed.has(world.labels[i])) return;
    context.moveTo(view.x(robotX), view.y(robotY));
    context.lineTo(view.x(x), view.y(y));
  });
  context.stroke();
}

/** The correlations of a state as a square: blue for positive ones, orange for negative ones. */
function drawCorrelations(canvas, values, colors) {
  const context = sized(canvas), n = Math.round(Math.sqrt(values.length));
  const side = canvas.clientWidth / n;
  for (let row = 0; row < n; row++) {
    for (let column = 0; column < n; column++) {
      const value = values[row * n + column];
      context.globalAlpha = Math.min(1, Math.abs(value));
      context.fillStyle = value > 0 ? colors.blue : colors.orange;
      context.fillRect(column * side, row * side, Math.ceil(side), Math.ceil(side));
    }
  }
  context.globalAlpha = 1;
  context.strokeStyle = colors.soft;
  context.lineWidth = 1;
  context.beginPath();
  for (const at of [3 * side, n * side - 0.5]) {
    context.moveTo(at, 0);
    context.lineTo(at, n * side);
    context.moveTo(0, at);
    context.lineTo(n * side, at);
  }
  context.stroke();
}

/** Mean size of the correlations between the same coordinate of different landmarks; NaN for one. */
function meanCorrelation(values) {
  const n = Math.round(Math.sqrt(values.length));
  let sum = 0, count = 0;
  for (let row = 3; row < n; row++) {
    for (let column = row + 2; column < n; column += 2) {
      sum += Math.abs(values[row * n + column]);
      count++;
    }
  }
  return sum / count;
}

/** The table of how consistent each filter is; `show(summary, chosen)` fills it. */
function scoreTable() {
  const body = make("tbody");
  const heads = ["filter", "NEES of the pose (3 is expected)", "mean NEES", "true position inside 3 sigma",
    "true landmarks inside", "now"];
  const element = make("div", { class: "scroll", tabindex: 0, role: "region", "aria-label": "Consistency of the filters" },
    make("table", {}, make("thead", {}, make("tr", {}, ...heads.map((each) => make("th", { scope: "col" }, each)))), body));
  const percent = (value) => (value === null ? "–" : `${short(value, 0)} % of the steps`);
  const verdict = (wrong) => (wrong === null ? "–" : wrong ? "sure and wrong" : "consistent"); // none before the first step
  const decimal = (value) => (value === null ? "–" : short(value, 1));
  return {
    element,
    show(summary, chosen) {
      body.replaceChildren(...Object.entries(summary).map(([name, each]) => make(
        "tr", { class: name === chosen ? "chosen" : null },
        make("th", { scope: "row" }, name), make("td", {}, decimal(each.nees)), make("td", {}, decimal(each.mean_nees)),
        make("td", {}, percent(each.inside_percent)), make("td", {}, `${each.inside_landmarks} of ${each.landmarks}`),
        make("td", { class: each.wrong ? "wrong" : null }, verdict(each.wrong)))));
    },
  };
}
