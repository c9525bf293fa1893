"use strict";
/* Controls of settings in groups with presets: sliders, fields, choices, checkboxes and lists. */

const equal = (a, b) => JSON.stringify(a) === JSON.stringify(b);

/** A number in at most four digits. */
function formatNumber(value) {
  return String(Number(value.toPrecision(4)));
}

/**
 * The control of one setting, in a labeled element; `changed(value)` is called on input.
 * That of an optional setting can be switched off: its value is then null.
 */
function setting(field, changed) {
  const makeControl = {
    range: slider, number: numberField, choice: choices, check: checkbox, list: listField,
  }[field.input];
  const { input, output, show, read } = makeControl(field, changed);
  const classes = `setting ${field.input}`, title = field.help || null;
  const outputs = output ? [output] : [];
  if (!field.optional) {
    const name = make("span", { class: "name" }, field.label ?? field.name);
    const children = field.input === "check" ? [input, name] : [name, ...outputs, input];
    return { element: make("label", { class: classes, title }, ...children), show };
  }
  input.setAttribute("aria-label", field.name);
  const none = make("span", { class: "value" }, "none");
  const enabled = make("input", {
    type: "checkbox", onchange: () => {
      const value = enabled.checked ? read() : null;
      showOptional(value);
      changed(value);
    },
  });
  function showOptional(value) {
    enabled.checked = value !== null;
    input.disabled = value === null;
    none.hidden = value !== null;
    for (const each of outputs) each.hidden = value === null;
    if (value !== null) show(value);
  }
  const name = make("label", { class: "name" }, enabled, field.name);
  return {
    element: make("div", { class: classes, title }, name, ...outputs, none, input),
    show: showOptional,
  };
}

function slider(field, changed) {
  const { low, high, step } = field, steps = 100;
  const logarithmic = step === 0; // the slider then counts equal factors
  const read = () => {
    const position = Number(input.value);
    return Number((logarithmic ? low * (high / low) ** (position / steps) : position).toPrecision(3));
  };
  const unit = field.unit ? ` ${field.unit}` : "";
  const input = make("input", {
    type: "range", min: logarithmic ? 0 : low, max: logarithmic ? steps : high,
    step: logarithmic ? 1 : step, oninput: () => { write(read()); changed(read()); },
  });
  const output = make("span", { class: "value" });
  function write(value) {
    output.textContent = formatNumber(value) + unit;
    input.setAttribute("aria-valuetext", output.textContent);
  }
  return {
    input, output, read,
    show(value) {
      input.value = logarithmic ? (steps * Math.log(value / low)) / Math.log(high / low) : value;
      write(value);
    },
  };
}

function numberField(field, changed) {
  const input = make("input", {
    type: "number", step: "any", onchange: () => {
      const valid = !Number.isNaN(input.valueAsNumber);
      input.setAttribute("aria-invalid", !valid);
      if (valid) changed(input.valueAsNumber);
    },
  });
  return {
    input,
    read: () => input.valueAsNumber || 1,
    show(value) {
      input.removeAttribute("aria-invalid");
      input.value = value;
    },
  };
}

function choices(field, changed) {
  const read = () => field.choices[input.selectedIndex];
  const input = make("select", { onchange: () => changed(read()) },
    ...field.choices.map((each) => make("option", {}, String(each))));
  return { input, read, show(value) { input.selectedIndex = field.choices.indexOf(value); } };
}

function checkbox(field, changed) {
  const read = () => input.checked;
  const input = make("input", { type: "checkbox", onchange: () => changed(read()) });
  return { input, read, show(value) { input.checked = value; } };
}

/** Numbers with commas, also in pairs: 1, 2 or [1, 2], [1, 3]. */
function listField(field, changed) {
  const parse = () => {
    try {
      return JSON.parse(`[${input.value}]`);
    } catch {
      return null;
    }
  };
  const input = make("input", {
    type: "text", spellcheck: "false", autocomplete: "off", onchange: () => {
      const value = parse();
      input.setAttribute("aria-invalid", value === null);
      if (value !== null) changed(value);
    },
  });
  return {
    input,
    read: () => parse() ?? [],
    show(value) {
      input.removeAttribute("aria-invalid");
      input.value = JSON.stringify(value).slice(1, -1).replaceAll(",", ", ");
    },
  };
}

/**
 * The settings of one kind in a box that opens; `values` holds those of every kind. `changed()` is
 * called on input, `presetChosen()` after a preset, which may set other kinds too.
 */
function settingsGroup(group, values, changed, presetChosen) {
  const { kind, presets, initial } = group;
  const inputs = new Map(group.fields.map((field) => [field.name, setting(field, (value) => {
    values[kind][field.name] = value;
    showPreset();
    changed();
  })]));
  const preset = make("select", { onchange: () => choose(preset.value) },
    ...Object.keys(presets).map((name) => make("option", { value: name }, name)),
    make("option", { value: "", hidden: true }, "changed"));
  const reset = make("button", { type: "button", onclick: () => choose(initial) }, "Reset");
  const state = make("span", { class: "state" });

  function choose(name) {
    for (const [each, table] of Object.entries(presets[name])) Object.assign(values[each], table);
    presetChosen();
    changed();
  }
  function showPreset() {
    const matches = ([, tables]) => Object.entries(tables).every(([each, table]) => equal(table, values[each]));
    const match = Object.entries(presets).find(matches);
    preset.value = match ? match[0] : "";
    reset.disabled = match !== undefined && match[0] === initial;
    state.textContent = preset.value === initial ? "" : preset.value || "changed";
  }
  const first = group.fields.slice(0, group.first), rest = group.fields.slice(group.first);
  const elements = (fields) => fields.map((field) => inputs.get(field.name).element);
  const element = make("details", { class: "group", "data-kind": kind },
    make("summary", {}, make("span", {}, group.title), state),
    make("div", { class: "presets" }, make("label", {}, "Preset ", preset), reset),
    ...elements(first),
    ...(rest.length ? [make("details", { class: "more" },
      make("summary", {}, `${rest.length} more`), ...elements(rest))] : []));
  return {
    element, showPreset,
    show() {
      for (const [name, input] of inputs) input.show(values[kind][name]);
      showPreset();
    },
  };
}

/** Every group with the values of its settings; `changed(kind)` is called on input. */
function settingsGroups(groups, changed) {
  const values = Object.fromEntries(groups.map(({ kind }) => [kind, {}]));
  for (const { presets, initial } of groups) {
    for (const [kind, table] of Object.entries(presets[initial])) Object.assign(values[kind], table);
  }
  const byKind = new Map(groups.map((group) => [group.kind, settingsGroup(group, values, () => {
    for (const each of byKind.values()) each.showPreset();
    changed(group.kind);
  }, showAll)]));
  function showAll() {
    for (const each of byKind.values()) each.show();
  }
  showAll();
  return { values, elements: [...byKind.values()].map((each) => each.element) };
}
