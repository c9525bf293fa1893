"use strict";
/* Two photographs with lines between their matches. */

kinds.match = (element, data) => {
  const count = data.xy.length / 4;
  const shown = { inliers: true, others: true };
  const canvas = make("canvas", {
    class: "pair", role: "img", "aria-label": `Two photographs with ${count} matches`,
  });
  const selected = selection(element, "Match", count,
    "Click near the end of a line to see one match alone.", describe, () => draw());
  const [left, right] = data.images.map((each) => {
    const image = new Image();
    image.addEventListener("load", draw);
    image.src = each.address;
    return { image, width: each.width, height: each.height };
  });
  const inlier = (i) => !data.inlier || data.inlier[i] === 1;

  /** Layout of the photographs: side by side, or one above the other on a narrow screen. */
  function layout() {
    const width = canvas.clientWidth, gap = 6;
    if (width < 560) {
      const scales = [width / left.width, width / right.width];
      return { scales, x: 0, y: left.height * scales[0] + gap, height: left.height * scales[0] + gap + right.height * scales[1] };
    }
    const scale = (width - gap) / (left.width + right.width);
    return { scales: [scale, scale], x: left.width * scale + gap, y: 0, height: Math.max(left.height, right.height) * scale };
  }
  const ends = (i, { scales, x, y }) => [
    data.xy[4 * i] * scales[0], data.xy[4 * i + 1] * scales[0],
    data.xy[4 * i + 2] * scales[1] + x, data.xy[4 * i + 3] * scales[1] + y,
  ];

  function draw() {
    const arrangement = layout();
    canvas.style.height = `${arrangement.height}px`;
    const context = sized(canvas);
    context.drawImage(left.image, 0, 0, left.width * arrangement.scales[0], left.height * arrangement.scales[0]);
    context.drawImage(right.image, arrangement.x, arrangement.y, right.width * arrangement.scales[1], right.height * arrangement.scales[1]);
    const lines = (inliers, color, dash) => {
      context.setLineDash(dash);
      context.strokeStyle = context.fillStyle = color;
      context.lineWidth = 1;
      context.globalAlpha = selected.chosen < 0 ? Math.max(0.3, Math.min(0.75, 100 / count)) : 0.2;
      context.beginPath();
      for (let i = 0; i < count; i++) {
        if (inlier(i) !== inliers) continue;
        const [x1, y1, x2, y2] = ends(i, arrangement);
        context.moveTo(x1, y1);
        context.lineTo(x2, y2);
      }
      context.stroke();
      context.setLineDash([]);
      context.globalAlpha = 1;
    };
    if (shown.others) lines(false, "#ff8a4c", [4, 4]);
    if (shown.inliers) lines(true, "#2ce0a8", []);
    const { chosen } = selected;
    if (chosen < 0) return;
    const [x1, y1, x2, y2] = ends(chosen, arrangement);
    outlined(context, ON_PHOTO.chosen, 3, () => {
      context.moveTo(x1, y1);
      context.lineTo(x2, y2);
      for (const [x, y] of [[x1, y1], [x2, y2]]) {
        context.moveTo(x + 8, y);
        context.arc(x, y, 8, 0, 2 * Math.PI);
      }
    });
  }

  function describe(index) {
    const position = (i) => `${short(data.xy[4 * index + i], 1)}, ${short(data.xy[4 * index + i + 1], 1)} px`;
    const rows = [["first", position(0)], ["second", position(2)],
      ["sizes", `${short(data.size[2 * index], 1)} px and ${short(data.size[2 * index + 1], 1)} px`]];
    if (data.distance) rows.push(["distance", short(data.distance[index], 0)]);
    if (data.inlier) rows.push(["agrees", inlier(index) ? "yes, an inlier" : "no"]);
    return [definitionList(rows)];
  }
  canvas.addEventListener("click", (event) => {
    const [x, y] = positionIn(canvas, event), arrangement = layout();
    let best = -1, minDistance = POINTER_RADIUS;
    for (let i = 0; i < count; i++) {
      if (!shown[inlier(i) ? "inliers" : "others"]) continue;
      const [x1, y1, x2, y2] = ends(i, arrangement);
      const distance = Math.min(Math.hypot(x1 - x, y1 - y), Math.hypot(x2 - x, y2 - y));
      if (distance < minDistance) [best, minDistance] = [i, distance];
    }
    selected.choose(best);
  });
  const redrawn = (key) => (on) => { shown[key] = on; draw(); };
  const layers = [toggle(data.inlier ? "inliers" : "matches", "green", true, redrawn("inliers"))];
  if (data.inlier) layers.push(toggle("other matches", "red", true, redrawn("others")));
  element.append(make("div", { class: "stage" },
    make("div", { class: "main" }, canvas, make("div", { class: "layers" }, ...layers)),
    make("div", { class: "side" }, ...selected.nodes)));
  new ResizeObserver(draw).observe(element);
};
