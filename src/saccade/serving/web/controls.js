"use strict";
/* Settings by group: sliders, choices, switches and lists, with presets. */

const same = (a, b) => JSON.stringify(a) === JSON.stringify(b);

/** A number as a person writes it. */
function plain(value) {
  return String(Number(value.toPrecision(4)));
}

/** What changes one setting; `heard(value)` hears of it. Returns its element and what shows a value. */
function setting(field, heard) {
  const make_of = { range: slider, choice: choices, check: tick_box, list: listed };
  const { input, show, words } = make_of[field.input](field, heard);
  const name = make("span", { class: "name" }, field.name);
  const element = make("label", { class: `setting ${field.input}`, title: field.help || null },
    ...(field.input === "check" ? [input, name] : [name, ...(words ? [words] : []), input]));
  return { element, show };
}

function slider(field, heard) {
  const { low, high, step } = field, steps = 100;
  const factor = step === 0; // the slider then counts equal factors
  const input = make("input", {
    type: "range", min: factor ? 0 : low, max: factor ? steps : high, step: factor ? 1 : step,
    oninput: () => {
      const at = Number(input.value);
      const value = Number((factor ? low * (high / low) ** (at / steps) : at).toPrecision(3));
      tell(value);
      heard(value);
    },
  });
  const words = make("span", { class: "value" });
  function tell(value) {
    words.textContent = plain(value);
    input.setAttribute("aria-valuetext", plain(value));
  }
  return {
    input, words,
    show(value) {
      input.value = factor ? (steps * Math.log(value / low)) / Math.log(high / low) : value;
      tell(value);
    },
  };
}

function choices(field, heard) {
  const input = make("select", { onchange: () => heard(field.choices[input.selectedIndex]) },
    ...field.choices.map((each) => make("option", {}, String(each))));
  return { input, show(value) { input.selectedIndex = field.choices.indexOf(value); } };
}

function tick_box(field, heard) {
  const input = make("input", { type: "checkbox", onchange: () => heard(input.checked) });
  return { input, show(value) { input.checked = value; } };
}

/** Numbers with commas, also in pairs: 1, 2 or [1, 2], [1, 3]. */
function listed(field, heard) {
  const input = make("input", {
    type: "text", spellcheck: "false", autocomplete: "off", onchange: () => {
      let value = null;
      try {
        value = JSON.parse(`[${input.value}]`);
      } catch { /* told below */ }
      input.setAttribute("aria-invalid", value === null);
      if (value !== null) heard(value);
    },
  });
  return {
    input,
    show(value) {
      input.removeAttribute("aria-invalid");
      input.value = JSON.stringify(value).slice(1, -1).replaceAll(",", ", ");
    },
  };
}

/**
 * The settings of one kind in a box that opens; `all` holds the values of every kind, and
 * `heard()` is told of changes. A preset may set what belongs to other kinds too: `shown()` is told.
 */
function settingsGroup(group, all, heard, shown) {
  const { kind, presets } = group;
  const inputs = new Map(group.fields.map((field) => [field.name, setting(field, (value) => {
    all[kind][field.name] = value;
    mark();
    heard();
  })]));
  const preset = make("select", { onchange: () => take(preset.value) },
    ...Object.keys(presets).map((name) => make("option", { value: name }, name)),
    make("option", { value: "", hidden: true }, "changed"));
  const reset = make("button", { type: "button", onclick: () => take("default") }, "Reset");
  const state = make("span", { class: "state" });

  function take(name) {
    for (const [each, values] of Object.entries(presets[name])) Object.assign(all[each], values);
    shown();
    heard();
  }
  function mark() {
    const fits = ([, values]) => Object.entries(values).every(([each, own]) => same(own, all[each]));
    const found = Object.entries(presets).find(fits);
    preset.value = found ? found[0] : "";
    reset.disabled = found !== undefined && found[0] === "default";
    state.textContent = preset.value === "default" ? "" : preset.value || "changed";
  }
  const first = group.fields.slice(0, group.first), rest = group.fields.slice(group.first);
  const of = (fields) => fields.map((field) => inputs.get(field.name).element);
  const element = make("details", { class: "group", "data-kind": kind },
    make("summary", {}, make("span", {}, group.title), state),
    make("div", { class: "presets" }, make("label", {}, "Preset ", preset), reset),
    ...of(first),
    ...(rest.length ? [make("details", { class: "more" },
      make("summary", {}, `${rest.length} more`), ...of(rest))] : []));
  return {
    element, mark,
    show() {
      for (const [name, input] of inputs) input.show(all[kind][name]);
      mark();
    },
  };
}

/** Every group; `heard(kind)` is told which settings were changed. */
function settingsOf(groups, heard) {
  const all = Object.fromEntries(groups.map(({ kind, presets }) => [kind, {}]));
  for (const { presets } of groups) {
    for (const [kind, values] of Object.entries(presets.default)) Object.assign(all[kind], values);
  }
  const made = new Map(groups.map((group) => [group.kind, settingsGroup(group, all, () => {
    for (const each of made.values()) each.mark();
    heard(group.kind);
  }, showAll)]));
  function showAll() {
    for (const each of made.values()) each.show();
  }
  showAll();
  return { all, elements: [...made.values()].map((each) => each.element) };
}
