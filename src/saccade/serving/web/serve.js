"use strict";
/* The page of `saccade serve`: a photograph, its maps, scanpath and interest points, and their settings; SLAM. */

const MAX_OUTDATED_MS = 700; // a request that is out of date is aborted after this time
const EMPTY = { xy: new Float32Array(0), time: new Float32Array(0), saliency: new Float32Array(0) };
const NO_POINTS = {
  xy: new Float32Array(0), size: new Float32Array(0), angle: new Float32Array(0),
  response: new Float32Array(0), octave: new Int32Array(0),
};

/** Post a request; the message of an error is the one line of the server. */
async function post(path, body, signal) {
  let response;
  try {
    response = await fetch(path, { method: "POST", body, signal });
  } catch (error) {
    if (error.name === "AbortError") throw error;
    throw new Error("The server does not answer. Is it still running?");
  }
  if (!response.ok) throw Object.assign(new Error((await response.text()).trim()), { status: response.status });
  return unpacked(await response.json());
}

/**
 * Requests one result at a time; of requests made meanwhile only the last is sent. `settings()` gives
 * the body, `received(result)`, `failed(error)` and `busy(on)` are called. Returns the function that
 * requests; `immediately` aborts the running request.
 */
function requester(path, settings, received, failed, busy) {
  let running = null, start = 0, pending = false;
  async function run() {
    busy(true);
    while (pending) {
      pending = false;
      running = new AbortController();
      start = performance.now();
      try {
        received(await post(path, JSON.stringify(settings()), running.signal));
        failed(null);
      } catch (error) {
        if (error.name !== "AbortError") failed(error);
      }
    }
    running = null;
    busy(false);
  }
  return (immediately = false) => {
    pending = true;
    if (!running) run();
    else if (immediately || performance.now() - start > MAX_OUTDATED_MS) running.abort();
  };
}

/** Text with a button that copies it. */
function snippet(title) {
  const text = make("pre", { tabindex: 0, "aria-label": title });
  const button = make("button", { type: "button", onclick: async () => {
    try {
      await navigator.clipboard.writeText(text.textContent);
      button.textContent = "Copied";
    } catch {
      getSelection().selectAllChildren(text);
      button.textContent = "Selected";
    }
    setTimeout(() => { button.textContent = "Copy"; }, 1500);
  } }, "Copy");
  return {
    element: make("figure", { class: "snippet" }, make("figcaption", {}, title, button), text),
    set(value) { text.textContent = value; },
  };
}

/** A choice of one of some names, all of them visible. */
function segments(legend, names, chosen, changed) {
  const group = `choice-${legend}`;
  return make("fieldset", { class: "segments" }, make("legend", {}, legend), ...names.map((name) => {
    const radio = make("input", { type: "radio", name: group, value: name, onchange: () => changed(name) });
    radio.checked = name === chosen;
    return make("label", {}, radio, make("span", {}, name));
  }));
}

/** Links to elements of which one is shown: the one whose id is in the address, else the first. */
function pages(elements, changed) {
  const links = Object.entries(elements).map(([name, { id }]) => make("a", { href: `#${id}` }, name));
  const all = Object.values(elements);
  function show() {
    const shown = all.find(({ id }) => `#${id}` === location.hash) || all[0];
    all.forEach((each, i) => {
      each.hidden = each !== shown;
      if (each === shown) links[i].setAttribute("aria-current", "page");
      else links[i].removeAttribute("aria-current");
    });
    changed(shown);
  }
  addEventListener("hashchange", show);
  return { element: make("nav", { class: "pages", "aria-label": "Pages" }, ...links), show };
}

function serve(element, data) {
  const request = { photo: null, model: "attention", detector: data.detectors[0], fixations: 10, path: Object.keys(data.scanpaths)[0] };
  const results = { look: {}, points: {} };
  const errors = { photo: null, look: null, points: null };
  const running = { photo: false, look: false, points: false };
  let firstLook = true;
  let resent = false; // the server no longer had the photograph
  let last = null; // the photograph as it was dropped, for a server that has been restarted

  const alarm = make("p", { class: "alarm", role: "alert", hidden: true });
  const status = make("p", { class: "status", role: "status" });
  const notice = make("p", { class: "notice", role: "status", hidden: true },
    "Compiling for this machine. Only the first run does, and it takes up to a minute.");
  const files = { look: snippet("Settings of the model"), points: snippet("Settings of the points") };

  const { values, elements } = settingsGroups(data.groups, (kind) => (data.detectors.includes(kind) ? detect() : look()));
  const groupOf = (kind) => elements.find((each) => each.dataset.kind === kind);
  const valuesOf = (kinds) => Object.fromEntries(kinds.map((kind) => [kind, values[kind]]));

  const look = requester("look", () => ({
    photo: request.photo, model: request.model, fixations: request.fixations, path: request.path,
    ...valuesOf([...data.models[request.model], data.scanpaths[request.path]]),
  }), (result) => {
    results.look = result;
    view.change({ maps: result.maps, scanpath: result.scanpath, map: firstLook ? "saliency" : undefined });
    firstLook = false;
    showStatus();
  }, failure("look"), busy("look"));
  const detect = requester("points", () => ({
    photo: request.photo, detector: request.detector, ...valuesOf([request.detector]),
  }), (result) => {
    results.points = result;
    view.change({ points: result.points });
    showStatus();
  }, failure("points"), busy("points"));

  function failure(name) {
    return (error) => {
      if (error && error.status === 404 && last) {
        resent = true;
        return void open(...last);
      }
      errors[name] = error && error.message;
      const messages = [...new Set(Object.values(errors).filter(Boolean))];
      alarm.textContent = messages.join(" · ");
      alarm.hidden = messages.length === 0;
      showStatus();
    };
  }
  function busy(name) {
    return (on) => {
      running[name] = on;
      element.dataset.busy = Object.values(running).some(Boolean);
      showStatus();
    };
  }
  function showStatus() {
    element.dataset.fixations = results.look.scanpath ? results.look.scanpath.time.length : "";
    element.dataset.points = results.points.count ?? "";
    const parts = [];
    if (results.look.ms !== undefined) parts.push(`${results.look.scanpath.time.length} fixations in ${short(results.look.ms, 0)} ms`);
    if (results.points.ms !== undefined) {
      const { count, points } = results.points, drawn = points.size.length;
      const limited = count === drawn ? "" : `, the strongest ${drawn} drawn`;
      parts.push(`${count} points in ${short(results.points.ms, 0)} ms${limited}`);
    }
    if (resent) parts.push("sent again: the server no longer had the photograph");
    status.textContent = parts.join(" · ");
    for (const [name, each] of Object.entries(files)) each.set(results[name].file ?? "");
  }

  let numOpened = 0, sent = null;
  async function open(file, name) {
    const number = ++numOpened;
    last = [file, name];
    busy("photo")(true);
    try {
      if (file.size > data.max_bytes) {
        throw new Error(`${name}: expected at most ${data.max_bytes / 1e6} MB, found ${short(file.size / 1e6, 1)} MB`);
      }
      const opened = await post(`photo?name=${encodeURIComponent(name)}`, file);
      if (number !== numOpened) return;
      request.photo = opened.photo;
      results.look = results.points = {};
      resent = resent && file === sent;
      sent = file;
      title.textContent = `${opened.name} · ${opened.size[0]} x ${opened.size[1]} px`;
      stage.hidden = false;
      view.change({ image: opened.image, scanpath: EMPTY, points: NO_POINTS });
      failure("photo")(null);
      look(true);
      detect(true);
    } catch (error) {
      if (number === numOpened) failure("photo")(Object.assign(error, { status: 0 }));
    } finally {
      if (number === numOpened) busy("photo")(false);
    }
  }
  async function sample(name) {
    const response = await fetch(`samples/${encodeURIComponent(name)}`);
    open(await response.blob(), name);
  }

  const input = make("input", {
    type: "file", accept: "image/*", class: "unseen", onchange: () => {
      if (input.files.length) open(input.files[0], input.files[0].name);
      input.value = "";
    },
  });
  const drop = make("div", { class: "drop" },
    make("label", { class: "pick" }, input, make("span", {}, "Choose a photograph")),
    make("span", { class: "hint" }, "or drop it anywhere, or paste it"),
    make("div", { class: "samples" }, ...data.samples.map((name) => make("button", {
      type: "button", class: "sample", title: name, onclick: () => sample(name),
    }, make("img", { src: `samples/${encodeURIComponent(name)}`, alt: name.replace(/\.jpg$/, ""), loading: "lazy" })))));
  const title = make("h2", { class: "title" });
  const part = make("div", { class: "part" });
  const stage = make("section", { hidden: true }, title, part);
  const fixations = setting({ input: "range", name: "fixations", help: "Length of the scanpath.", low: 1, high: 40, step: 1 },
    (value) => { request.fixations = value; look(); });
  fixations.show(request.fixations);
  const photograph = make("div", { id: "photograph" }, drop, alarm, stage);
  const slam = make("div", { id: "slam", hidden: true });
  const robot = playground(slam, data.playground);
  const choice = pages({ Photograph: photograph, SLAM: slam }, (shown) => (shown === slam ? robot.open() : robot.close()));
  element.append(choice.element, notice, photograph, slam);
  const view = kinds.image(part, {
    image: { address: "data:,", width: 4, height: 3 }, maps: [], scanpath: EMPTY, points: NO_POINTS,
  });
  view.layers.after(status, make("div", { class: "snippets" }, files.look.element, files.points.element));

  const models = segments("Model", Object.keys(data.models), request.model, (name) => {
    request.model = name;
    showGroups();
    look();
  });
  const detectors = segments("Interest points", data.detectors, request.detector, (name) => {
    request.detector = name;
    showGroups();
    detect();
  });
  const paths = segments("Scanpath", Object.keys(data.scanpaths), request.path, (name) => {
    request.path = name;
    showGroups();
    look();
  });
  /** Show the settings of the chosen model, scanpath and detector. */
  function showGroups() {
    const shown = [...data.models[request.model], data.scanpaths[request.path], request.detector];
    for (const each of elements) each.hidden = !shown.includes(each.dataset.kind);
  }
  const kindsOfPaths = Object.values(data.scanpaths), others = [...kindsOfPaths, ...data.detectors];
  const panel = make("section", { class: "controls", "aria-label": "Settings" }, models,
    ...elements.filter((each) => !others.includes(each.dataset.kind)), paths, fixations.element,
    ...kindsOfPaths.map(groupOf), detectors, ...data.detectors.map(groupOf));
  view.side.append(panel);
  showGroups();
  groupOf("attention").open = groupOf("sift").open = true;
  view.showPoints();

  addEventListener("dragover", (event) => { event.preventDefault(); element.dataset.over = "true"; });
  addEventListener("dragleave", (event) => { if (!event.relatedTarget) delete element.dataset.over; });
  addEventListener("drop", (event) => {
    event.preventDefault();
    delete element.dataset.over;
    const [file] = event.dataTransfer.files;
    if (file) open(file, file.name);
  });
  addEventListener("paste", (event) => {
    const [file] = event.clipboardData.files;
    if (file) open(file, file.name || "pasted.png");
  });
  async function waitUntilWarm(again) {
    let warm = false;
    try {
      ({ warm } = await (await fetch("state")).json());
    } catch { /* the next request may succeed */ }
    element.dataset.warm = warm;
    notice.hidden = warm || !again;
    if (!warm) setTimeout(waitUntilWarm, 700, true);
  }
  waitUntilWarm(false);
  choice.show();
  sample(data.samples.includes("chelsea.jpg") ? "chelsea.jpg" : data.samples[0]);
  document.documentElement.dataset.ready = "true";
}

{
  const element = document.getElementById("serve");
  serve(element, JSON.parse(element.querySelector("script").textContent));
}
