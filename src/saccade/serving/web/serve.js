"use strict";
/* A photograph is dropped, and what is found in it is shown and set. */

const PATIENCE = 700; // milliseconds after which an answer that is out of date is not waited for
const EMPTY = { xy: new Float32Array(0), time: new Float32Array(0), saliency: new Float32Array(0) };
const NO_POINTS = {
  xy: new Float32Array(0), size: new Float32Array(0), angle: new Float32Array(0),
  response: new Float32Array(0), octave: new Int32Array(0),
};

/** What the server answers; its one line is the error's message. */
async function asked(path, body, signal) {
  let answer;
  try {
    answer = await fetch(path, { method: "POST", body, signal });
  } catch (error) {
    if (error.name === "AbortError") throw error;
    throw new Error("The server does not answer. Is it still running?");
  }
  if (!answer.ok) throw Object.assign(new Error((await answer.text()).trim()), { status: answer.status });
  return unpacked(await answer.json());
}

/** Asks for one thing at a time: of wishes that come meanwhile only the last is asked for. */
function lane(path, wish, shown, failed, busy) {
  let running = null, began = 0, waiting = false;
  async function go() {
    busy(true);
    while (waiting) {
      waiting = false;
      running = new AbortController();
      began = performance.now();
      try {
        const found = await asked(path, JSON.stringify(wish()), running.signal);
        shown(found);
        failed(null);
      } catch (error) {
        if (error.name !== "AbortError") failed(error);
      }
    }
    running = null;
    busy(false);
  }
  return (anew = false) => {
    waiting = true;
    if (!running) go();
    else if (anew || performance.now() - began > PATIENCE) running.abort();
  };
}

/** Text to be copied. */
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
    set(words) { text.textContent = words; },
  };
}

/** A choice that is seen as a whole: one of some words. */
function segments(legend, names, chosen, heard) {
  const group = `choice-${legend}`;
  return make("fieldset", { class: "segments" }, make("legend", {}, legend), ...names.map((name) => {
    const radio = make("input", { type: "radio", name: group, value: name, onchange: () => heard(name) });
    radio.checked = name === chosen;
    return make("label", {}, radio, make("span", {}, name));
  }));
}

function serve(element, data) {
  const wishes = { photo: null, model: "both", detector: "sift", fixations: 10 };
  const said = { look: {}, points: {}, python: "" };
  const errors = { photo: null, look: null, points: null };
  const working = { photo: false, look: false, points: false };
  let looked = false;
  let last = null; // the photograph as it was dropped, for a server that has forgotten it

  const alarm = make("p", { class: "alarm", role: "alert", hidden: true });
  const status = make("p", { class: "status", role: "status" });
  const notice = make("p", { class: "notice", role: "status", hidden: true },
    "Compiling for this machine. Only the first run does, and it takes up to a minute.");
  const python = snippet("The same in Python"), command = snippet("The same as a command");

  const { all, elements } = settingsOf(data.groups, (kind) => (data.detectors.includes(kind) ? find() : look()));
  const groupOf = (kind) => elements.find((each) => each.dataset.kind === kind);
  const own = (kinds) => Object.fromEntries(kinds.map((kind) => [kind, all[kind]]));

  const look = lane("look", () => ({
    photo: wishes.photo, model: wishes.model, fixations: wishes.fixations,
    ...own([...data.models[wishes.model], "scanpath"]),
  }), (found) => {
    said.look = found;
    view.change({ maps: found.maps, scanpath: found.scanpath, map: looked ? undefined : "saliency" });
    looked = true;
    tell();
  }, failure("look"), busy("look"));
  const find = lane("points", () => ({
    photo: wishes.photo, detector: wishes.detector, ...own([wishes.detector]),
  }), (found) => {
    said.points = found;
    view.change({ points: found.points });
    tell();
  }, failure("points"), busy("points"));

  function failure(name) {
    return (error) => {
      if (error && error.status === 404 && last) return void open(...last);
      errors[name] = error && error.message;
      const words = [...new Set(Object.values(errors).filter(Boolean))];
      alarm.textContent = words.join(" · ");
      alarm.hidden = words.length === 0;
      tell();
    };
  }
  function busy(name) {
    return (on) => {
      working[name] = on;
      element.dataset.busy = Object.values(working).some(Boolean);
      tell();
    };
  }
  function tell() {
    element.dataset.fixations = said.look.scanpath ? said.look.scanpath.time.length : "";
    element.dataset.found = said.points.found ?? "";
    const parts = [];
    if (said.look.ms !== undefined) parts.push(`${said.look.scanpath.time.length} fixations in ${short(said.look.ms, 0)} ms`);
    if (said.points.ms !== undefined) {
      const { found, points } = said.points, drawn = points.size.length;
      const all_of = found === drawn ? "" : `, the strongest ${drawn} drawn`;
      parts.push(`${found} points in ${short(said.points.ms, 0)} ms${all_of}`);
    }
    status.textContent = parts.join(" · ");
    const joined = (key) => [said.look[key], said.points[key]].filter(Boolean);
    python.set([said.python, ...joined("python")].join("\n"));
    command.set(joined("command").join("\n"));
  }

  let openings = 0;
  async function open(file, name) {
    const own_turn = ++openings;
    last = [file, name];
    busy("photo")(true);
    try {
      if (file.size > data.most) {
        throw new Error(`${name}: expected at most ${data.most / 1e6} MB, found ${short(file.size / 1e6, 1)} MB`);
      }
      const found = await asked(`photo?name=${encodeURIComponent(name)}`, file);
      if (own_turn !== openings) return;
      wishes.photo = found.photo;
      said.python = found.python;
      said.look = said.points = {};
      title.textContent = `${found.name} · ${found.size[0]} x ${found.size[1]} px`;
      stage.hidden = false;
      view.change({ image: found.image, scanpath: EMPTY, points: NO_POINTS });
      failure("photo")(null);
      look(true);
      find(true);
    } catch (error) {
      if (own_turn === openings) failure("photo")(Object.assign(error, { status: 0 }));
    } finally {
      if (own_turn === openings) busy("photo")(false);
    }
  }
  async function sample(name) {
    const answer = await fetch(`samples/${encodeURIComponent(name)}`);
    open(await answer.blob(), name);
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
    (value) => { wishes.fixations = value; look(); });
  fixations.show(wishes.fixations);
  element.append(drop, notice, alarm, stage);
  const view = kinds.image(part, {
    image: { address: "data:,", width: 4, height: 3 }, maps: [], scanpath: EMPTY, points: NO_POINTS,
  });
  view.layers.after(status, make("div", { class: "snippets" }, python.element, command.element));

  const models = segments("Model", Object.keys(data.models), wishes.model, (name) => {
    wishes.model = name;
    sift_out();
    look();
  });
  const detectors = segments("Interest points", data.detectors, wishes.detector, (name) => {
    wishes.detector = name;
    sift_out();
    find();
  });
  /** Show the settings that count. */
  function sift_out() {
    for (const each of elements) {
      const { kind } = each.dataset;
      each.hidden = kind !== "scanpath" && kind !== wishes.detector && !data.models[wishes.model].includes(kind);
    }
  }
  const panel = make("section", { class: "controls", "aria-label": "Settings" }, models,
    ...["attention", "contrast", "symmetry", "scanpath"].map(groupOf), detectors, ...data.detectors.map(groupOf));
  groupOf("scanpath").querySelector(".presets").after(fixations.element);
  view.side.append(panel);
  sift_out();
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
  async function waitWarm(asked_before) {
    let warm = false;
    try {
      ({ warm } = await (await fetch("state")).json());
    } catch { /* it is asked again */ }
    element.dataset.warm = warm;
    notice.hidden = warm || !asked_before;
    if (!warm) setTimeout(waitWarm, 700, true);
  }
  waitWarm(false);
  sample(data.samples.includes("rocket.jpg") ? "rocket.jpg" : data.samples[0]);
  document.documentElement.dataset.ready = "true";
}

{
  const element = document.getElementById("serve");
  serve(element, JSON.parse(element.querySelector("script").textContent));
}
