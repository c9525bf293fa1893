"use strict";
/* The SLAM playground: a simulated robot is driven, and the server's filters estimate its map. */

const TICK_MS = 110; // between the steps of a key or button that is held
const FORWARD = 0.4, TURN = 0.2, LAP = [0.5, 0.05]; // meters and radians of a step; on a circle of 10 m
const LAP_STEPS = 3; // per tick of the autopilot
const DIRECTIONS = { ArrowUp: [FORWARD, 0], ArrowDown: [-FORWARD, 0], ArrowLeft: [0, TURN], ArrowRight: [0, -TURN] };
const WORLD_BOX = [-14, -14, 14, 14];
const DEGREES = 180 / Math.PI;

/** The playground in its element; it begins with `open()`. */
function playground(element, data) {
  const noise = { ...data.values }, shown = { truth: true, ellipses: true };
  const held = new Set(); // directions of keys and buttons
  let filter = "standard", session = null, seed = 0, numStarted = 0, wasWrong = false;
  let history = null, state = null;
  let pending = emptyRequest(), isRunning = false, timer = null;

  const canvas = make("canvas", {
    class: "ground", tabindex: 0, role: "application", "aria-label": "The robot and its map. Arrow keys drive, the space bar "
      + "observes without moving, plus and minus zoom, 0 shows all; a click adds or removes a landmark.",
  });
  const alarm = make("p", { class: "alarm", role: "alert", hidden: true });
  const status = make("p", { class: "status", role: "status" });
  const counter = make("p", { class: "status steps" });
  const table = scoreTable();
  const correlation = make("canvas", { class: "correlation", role: "img" });
  const correlationText = make("figcaption");
  const none = { time: [0], values: [NaN], band: [[NaN], [NaN]] }; // before the first step
  const curves = [
    { title: "Error of the heading", unit: "°", name: "error", band_name: "3 sigma", ...none },
    { title: "NEES of the pose", unit: "", name: "NEES", band_name: "95 % of a consistent filter", logarithmic: true,
      ...none },
  ];
  const charts = linkedCharts(curves);

  function emptyRequest() {
    return { commands: [], add: [], remove: [] };
  }
  const drives = (key) => [key, () => hold(key)];
  const ground = plane(canvas, WORLD_BOX, draw, (x, y, radius) => place(x, y, radius), {
    ...Object.fromEntries(Object.keys(DIRECTIONS).map(drives)), " ": () => ask({ commands: [null] }),
  });

  /** Send what is pending, one request at a time; what comes meanwhile goes with the next. */
  async function run() {
    isRunning = true;
    while (session !== null && (pending.commands.length || pending.add.length || pending.remove.length || pending.show)) {
      const { commands, add, remove } = pending, of = session;
      pending = emptyRequest();
      try {
        const next = await post("slam/step", JSON.stringify({ session, commands, add, remove, noise, filter }));
        if (session !== of) continue; // started again meanwhile
        receive(next);
        fail(null);
      } catch (error) {
        stop();
        if (error.status === 404) await start();
        else fail(error);
      }
    }
    isRunning = false;
  }
  function ask({ commands = [], add = [], remove = [] }) {
    pending.commands = [...pending.commands, ...commands].slice(-2 * LAP_STEPS); // or a slow server would lag behind
    pending.add.push(...add);
    pending.remove.push(...remove);
    pending.show = true;
    if (!isRunning) run();
  }
  function fail(error) {
    alarm.textContent = error ? error.message : "";
    alarm.hidden = !error;
  }
  async function start(landmarks) {
    const number = ++numStarted;
    session = null;
    pending = emptyRequest();
    history = { truth: [], filters: Object.fromEntries(data.filters.map((each) => [each, { poses: [], error: [], limit: [], nees: [] }])) };
    wasWrong = false;
    try {
      const started = await post("slam/start", JSON.stringify({ seed: seed++, noise, filter, ...(landmarks ? { landmarks } : {}) }));
      if (number !== numStarted) return;
      session = started.session;
      receive(started);
      fail(null);
    } catch (error) {
      fail(error);
    }
  }

  function receive(next) {
    for (const step of next.steps) {
      history.truth.push(step.truth);
      for (const [name, { pose, error, sigma, nees }] of Object.entries(step.filters)) {
        const of = history.filters[name];
        of.poses.push(pose);
        of.error.push(error[2] * DEGREES);
        of.limit.push(3 * sigma[2] * DEGREES);
        of.nees.push(nees === null ? NaN : Math.max(1e-3, nees));
      }
    }
    const observed = next.steps.length ? next.steps.at(-1).observed : [...state.observed];
    state = { ...next, observed: new Set(observed) };
    show();
  }
  function show() {
    const of = history.filters[filter], time = history.truth.map((_, i) => i);
    const [low, high] = data.nees_band;
    Object.assign(curves[0], { time, values: of.error, band: [of.limit.map((each) => -each), of.limit] });
    Object.assign(curves[1], { time, values: of.nees, band: [time.map(() => low), time.map(() => high)] });
    charts.refresh();
    table.show(state.summary, filter);
    counter.textContent = `${time.length - 1} steps, ${state.labels.length} landmarks, ${state.map.labels.length} in the map of the filter`;
    element.dataset.steps = time.length - 1;
    element.dataset.filter = state.filter;
    const isWrong = state.summary[filter].wrong === true;
    if (isWrong !== wasWrong) {
      status.textContent = isWrong ? `The filter ${filter} is sure and wrong: the true pose is far outside of what it says is possible.`
        : `The filter ${filter} is no longer sure and wrong.`;
    }
    wasWrong = isWrong;
    ground.redraw();
    drawState();
  }
  function draw(context, view) {
    if (!state) return;
    const scene = {
      history: { truth: history.truth, poses: history.filters[state.filter].poses }, world: state, map: state.map,
      range: noise.max_range, ellipseScale: data.ellipse_scale,
    };
    drawScene(context, view, scene, shown, palette());
  }
  function drawState() {
    if (!state || !correlation.clientWidth) return;
    drawCorrelations(correlation, state.map.correlation, palette());
    const mean = meanCorrelation(state.map.correlation);
    const text = Number.isNaN(mean) ? "" : ` Between landmarks ${short(mean)} in the mean.`;
    correlationText.textContent = `Correlations of the state: the pose, then the landmarks; blue 1, orange −1.${text}`;
    correlation.setAttribute("aria-label", correlationText.textContent);
  }

  /** Add a landmark, or remove the one at this place. */
  function place(x, y, radius) {
    const near = state.landmarks.findIndex(([a, b]) => Math.hypot(a - x, b - y) < radius);
    ask(near < 0 ? { add: [[x, y]] } : { remove: [state.labels[near]] });
  }
  function tick() {
    if (autopilot.isOn) ask({ commands: Array(LAP_STEPS).fill(LAP) });
    else if (held.size) {
      const moves = [...held].map((each) => DIRECTIONS[each]);
      const sum = (i) => moves.reduce((total, move) => total + move[i], 0);
      ask({ commands: [[sum(0), sum(1)]] });
    } else stop();
  }
  function drive() {
    if (timer === null) timer = setInterval(tick, TICK_MS);
  }
  function stop() {
    clearInterval(timer);
    timer = null;
    held.clear();
    autopilot.set(false);
  }
  function hold(direction) {
    if (held.has(direction)) return;
    autopilot.set(false);
    held.add(direction);
    ask({ commands: [DIRECTIONS[direction]] });
    drive();
  }
  const release = (direction) => held.delete(direction);
  addEventListener("keyup", (event) => release(event.key));
  addEventListener("blur", () => held.clear());

  /** A button that drives while it is held, and one step by key. */
  function padButton(sign, label, key) {
    const button = make("button", {
      type: "button", "aria-label": label, title: label,
      onpointerdown: (event) => { button.setPointerCapture(event.pointerId); hold(key); },
      onpointerup: () => release(key), onpointercancel: () => release(key),
      onclick: (event) => { if (event.detail === 0) ask({ commands: [DIRECTIONS[key]] }); },
    }, sign);
    return button;
  }
  function switchButton(label, changed) {
    const button = make("button", { type: "button", "aria-pressed": "false", onclick: () => { set(!self.isOn); changed(self.isOn); } }, label);
    const self = { element: button, isOn: false, set };
    function set(on) {
      self.isOn = on;
      button.setAttribute("aria-pressed", on);
    }
    return self;
  }
  const autopilot = switchButton("Drive in circles", (on) => { if (on) drive(); });
  const pad = make("div", { class: "pad", role: "group", "aria-label": "Drive" },
    padButton("↑", "Forward", "ArrowUp"), padButton("←", "Turn left", "ArrowLeft"),
    make("button", { type: "button", "aria-label": "Stand still and observe", title: "Stand still and observe",
      onclick: () => ask({ commands: [null] }) }, "◉"),
    padButton("→", "Turn right", "ArrowRight"), padButton("↓", "Back", "ArrowDown"));
  const again = (landmarks) => { stop(); start(landmarks); };
  const actions = make("div", { class: "actions" }, autopilot.element,
    make("button", { type: "button", onclick: () => again(state && state.landmarks) }, "Start again"),
    make("button", { type: "button", onclick: () => again([]) }, "No landmarks"),
    make("button", { type: "button", onclick: () => again() }, "Two rings of landmarks"));
  for (const each of [pad, actions]) {
    each.addEventListener("keydown", (event) => {
      if (!(event.key in DIRECTIONS)) return;
      event.preventDefault();
      hold(event.key);
    });
  }
  const filters = segments("Filter", data.filters, filter, (name) => {
    filter = name;
    status.textContent = "";
    wasWrong = false;
    ask({});
  });
  const sliders = data.noise.map((field) => {
    const each = setting(field, (value) => { noise[field.name] = value; ground.redraw(); });
    each.show(noise[field.name]);
    return each.element;
  });
  const layers = make("div", { class: "layers" },
    toggle("true robot and landmarks", "green", true, (on) => { shown.truth = on; ground.redraw(); }, "thick"),
    toggle(data.ellipse_label, "orange", true, (on) => { shown.ellipses = on; ground.redraw(); }, "ring"),
    make("span", { class: "key" }, make("span", { class: "swatch line blue", "aria-hidden": "true" }), "estimate"));
  element.append(
    make("p", { class: "hint" }, "Every filter gets the same odometry and observations. An estimate is consistent while the truth "
      + "(green) is where its ellipses say it could be. Drive some rounds and compare."),
    alarm,
    make("div", { class: "field" },
      make("div", { class: "plane" }, canvas, layers, counter, status),
      make("div", { class: "drive" }, filters, pad, actions),
      make("div", { class: "plane" }, table.element, charts.element),
      make("div", { class: "tune" },
        make("details", { class: "group", open: true }, make("summary", {}, "Noise"), ...sliders),
        make("figure", {}, correlation, correlationText))));
  new ResizeObserver(drawState).observe(correlation);
  onTheme(drawState);
  return {
    open() {
      if (session === null) start();
      canvas.focus({ preventScroll: true });
    },
    close: stop,
  };
}
