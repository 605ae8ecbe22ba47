// --- panel -------------------------------------------------------------------------------------------------
function choose(select, pairs, value, act) {
  for (const [key, text] of pairs) {
    const option = element("option", text);
    option.value = key;
    select.append(option);
  }
  select.value = value;
  if (act) select.addEventListener("change", () => act(select.value));
}
const has_tool = data.targets.some((t) => t.place.some((v) => v !== 0));
function robot_colour() { // the mean of its largest link
  const attributes = bodies.map((one) => one.geometry.attributes.color).filter(Boolean);
  if (!attributes.length) return "var(--soft)";
  const colour = attributes.reduce((a, b) => (b.count > a.count ? b : a));
  const sum = [0, 0, 0];
  for (let k = 0; k < colour.count; k++) for (let c = 0; c < 3; c++) sum[c] += colour.array[3 * k + c] / colour.count;
  return `rgb(${sum.map(Math.round).join(" ")})`;
}
// name, words, whether there is one, its nodes, its mark (as it is drawn), whether it is seen at first
const LAYERS = [
  ["robot", data.ghost ? "calibrated robot" : "robot", true, [["robot"]], robot_colour(), true],
  ["ghost", "nominal robot", !!data.ghost, [["ghost"]], "#b7c9da", false],
  ["measured", data.at_features ? "places on features" : in_program ? "wanted targets" : "measured points", measured, [["measured"]], both_kinds ? "linear-gradient(90deg, var(--held-out) 50%, var(--fitted) 50%)" : "var(--held-out)", true],
  ["modelled", in_program ? "reached places" : measured ? "modelled points" : "expected points", !!points, [["modelled"]], measured ? "#fff" : "var(--held-out)", true],
  ["vectors", data.at_features ? "distances from features" : "error vectors", measured, [["vectors"]], `linear-gradient(90deg, ${data.scale.colours.join(", ")})`, true],
  ["frames", "orientation errors", oriented.length > 0, [["frames"]], "linear-gradient(90deg, #d62728 33%, #2ca02c 33% 66%, #1f5fd6 66%)", true],
  ["next", "next pose and the way to it", in_plan, [["next"]], "#3f8fd8", true],
  ["shown", measured ? "targets of this pose" : has_tool ? "targets" : "tip", true, [["shown"]], "#ffd23f", true],
  ["tool", "flange to targets", has_tool, [["tool"]], "var(--soft)", true],
  ["path", in_program ? "targets in their order" : "whole way of the first target", data.path, [["path"]], "#0b7a75", in_program],
  ["tracker", "laser tracker", data.tracker, [["tracker"]], "#3a4149", true],
  ["sight", "lines of sight", data.tracker, [["sight"]], "#d6002f", !measured],
  ["references", "reference points", data.references.length > 0, [["references"]], "#0b7a75", true],
  ["features", "features", data.features.length > 0, [["features"]], "#c98a1b", true],
  ["cell", "tools and work objects", data.cell.length > 0, [["cell"]], "linear-gradient(90deg, #d62728 33%, #2ca02c 33% 66%, #1f5fd6 66%)", true],
  ["cube", "ISO 9283 cube", !!data.cube, [["cube"]], "#7a4fa3", !measured],
  ["floor", "floor of the base", true, [["floor"]], "var(--grid)", true],
  ["labels", "labels", labels.length > 0, [], "transparent", true],
];
function set_layer(name, on) {
  state.layers[name] = on;
  for (const path of LAYERS.find((layer) => layer[0] === name)[3])
    viewer.handle_command({ type: "set_property", path: `/irbcal/${path.join("/")}`, property: "visible", value: on });
  viewer.set_dirty();
}
for (const [name, text, present, , colour, at_first] of LAYERS) {
  if (!present) continue;
  const line = element("label");
  const box = element("input");
  box.type = "checkbox";
  box.id = `layer-${name}`;
  box.checked = at_first;
  const mark = element("span", undefined, "mark");
  mark.style.background = colour;
  if (colour === "#fff") mark.style.cssText += "border: 1px solid #8a949d; border-radius: 2px";
  line.append(box, mark, element("span", text));
  if (name === "ghost") {
    const where = element("select");
    where.id = "ghost";
    choose(where, [["place", "in place"], ["magnified", `shift × ${ghost_factor()}`], ["beside", "beside"]], state.ghost, (value) => {
      state.ghost = value;
      refresh_robot();
    });
    line.append(where);
  }
  byId("layers").append(line);
  box.addEventListener("change", () => set_layer(name, box.checked));
  set_layer(name, box.checked);
}
function refresh_robot() {
  if (data.mode === "sliders") move_robot(state.q, effective(state.q));
  else if (!state.playing && state.active.length) move_robot(joint_row(poses.q, state.pose), joint_row(poses.effective, state.pose));
}

function set_theme(name) {
  theme = name;
  paint_ground();
  paint_points();
  fill();
  byId("theme").textContent = is_dark() ? "light" : "dark";
}
dark_system.addEventListener("change", () => set_theme(theme));
byId("theme").textContent = is_dark() ? "light" : "dark";

byId("title").textContent = data.title;
byId("simulated").hidden = !data.simulated;
if (data.notes.length) {
  byId("noting").hidden = false;
  for (const text of data.notes) byId("notes").append(element("li", text));
}
if (poses.groups.length > 1 || poses.groups[0]) {
  byId("grouping").hidden = false;
  const counts = poses.groups.map(() => 0);
  for (const group of poses.group) counts[group]++;
  poses.groups.forEach((name, k) => {
    const line = element("label");
    const box = element("input");
    box.type = "checkbox";
    box.id = `group-${k}`;
    box.checked = true;
    line.append(box, element("span", name || "(no group)"), element("span", `${counts[k]}`, "count"));
    byId("groups").append(line);
    box.addEventListener("change", () => {
      pause();
      state.groups[k] = box.checked;
      activate();
    });
  });
}
function tell_scale() {
  if (!measured) return;
  const top = top_mm(), own = scale_name();
  const most = MODELS.filter((model) => own === "common" || model === own)
    .reduce((m, model) => Math.max(m, largest[model].reduce((a, b) => Math.max(a, b), 0)), 0);
  byId("ticks").replaceChildren();
  for (let k = 0; k <= 4; k++) {
    const text = String(Number(((k * top) / 4).toPrecision(3)));
    const tick = element("span", (k === 4 && most > top * 1.0001 ? "≥ " : "") + text);
    tick.style.cssText = `left: ${25 * k}%; transform: translateX(${-25 * k}%)`;
    byId("ticks").append(tick);
  }
  const select = byId("magnification");
  const factors = new Set([1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10000, magnification()]);
  select.replaceChildren();
  choose(select, [...factors].sort((a, b) => a - b).map((f) => [f, `× ${f}`]), magnification());
  for (const option of document.querySelectorAll("#ghost option[value=magnified]")) option.textContent = `shift × ${ghost_factor()}`;
  byId("turning").hidden = !oriented.length;
  byId("turning").textContent = `orientation errors (frames) magnified × ${state.turning[state.model]}`;
}
function restyle() { // another model, scale or family: everything that shows errors
  rank();
  fill();
  tell_scale();
  tell_statistics();
  list_poses();
  if (state.active.length) tell_pose();
  refresh_robot();
}
function set_model(model) {
  state.model = model;
  for (const radio of document.getElementsByName("model")) radio.checked = radio.value === model;
  restyle();
}
function set_own(own) {
  state.own = own;
  byId("own").checked = own;
  restyle();
}
function set_which(which) {
  state.which = which;
  for (const radio of document.getElementsByName("which")) radio.checked = radio.value === which;
  fill();
}
function set_whole(whole) { // all points and the whole way of a plan, or its next move
  state.whole = whole;
  byId("whole").setAttribute("aria-pressed", whole);
  if (data.path) set_layer("path", (byId("layer-path").checked = whole));
  fill();
}
if (measured) {
  byId("whiching").hidden = false;
  byId(`which-${state.which}`).checked = true;
  for (const radio of document.getElementsByName("which")) radio.addEventListener("change", () => set_which(radio.value));
}
if (both_kinds) {
  byId("kinds").hidden = false;
  KINDS.forEach((kind, k) => {
    const line = element("label");
    const box = element("input");
    box.type = "checkbox";
    box.id = k ? "kind-fitted" : "kind-held-out";
    box.checked = true;
    const mark = element("span", undefined, "mark");
    mark.style.background = k ? "var(--fitted)" : "var(--held-out)";
    line.append(box, mark, element("span", k ? "fitted" : "held out"), element("span", `${in_kind[k]} poses`, "count"));
    byId("kinds").append(line);
    box.addEventListener("change", () => {
      pause();
      state.kinds[k] = box.checked;
      activate();
    });
  });
}
const families = points ? Object.keys(points.without) : [];
if (families.length) {
  byId("terms").hidden = false;
  for (const family of families) {
    const line = element("label");
    const box = element("input");
    box.type = "checkbox";
    box.id = `term-${families.indexOf(family)}`;
    box.checked = true;
    line.append(box, element("span", family));
    byId("families").append(line);
    box.addEventListener("change", () => {
      if (box.checked) state.off.delete(family);
      else state.off.add(family);
      leave_out();
      if (state.off.size) set_model("calibrated");
      else restyle();
    });
  }
}
if (data.at_features) {
  byId("errors").textContent = "Distance of rows from their features, mm";
  byId("meaning").textContent = "vectors (model’s point to its feature)";
}
if (measured) {
  byId("legend").hidden = byId("listed").hidden = false;
  byId("bar").style.background = `linear-gradient(to right, ${data.scale.colours.join(", ")})`;
  byId("magnification").addEventListener("change", () => {
    state.factor[scale_name()] = Number(byId("magnification").value);
    fill();
    tell_scale();
    refresh_robot();
  });
  for (const radio of document.getElementsByName("model"))
    radio.addEventListener("change", () => set_model(radio.value));
  byId("own").checked = state.own;
  byId("own").addEventListener("change", () => set_own(byId("own").checked));
  choose(byId("order"), [["error", "largest error first"], ["file", "in their order"]], state.order, (value) => {
    state.order = value;
    list_poses();
  });
  tell_scale();
}
if (data.mode === "sliders") {
  byId("joints").hidden = false;
  byId("joints").append(element("h2", "Joints (commanded)"));
  data.joints.names.forEach((name, k) => {
    const line = element("div", undefined, "joint");
    const head = element("div", undefined, "row");
    const value = element("span");
    const range = element("input");
    range.type = "range";
    range.id = `joint-${k}`;
    range.min = data.joints.lower[k];
    range.max = data.joints.upper[k];
    range.step = "any";
    range.value = Math.min(Math.max(0, data.joints.lower[k]), data.joints.upper[k]);
    range.setAttribute("aria-label", name);
    const tell = () => {
      const unit = data.joints.units[k];
      value.textContent = `${number(state.q[k] / data.joints.factors[k], 1)} ${unit === "deg" ? "°" : unit}`;
    };
    range.addEventListener("input", () => {
      state.q[k] = Number(range.value);
      tell();
      move_robot(state.q, effective(state.q));
      tell_pose();
    });
    state.q[k] = Number(range.value);
    tell();
    head.append(element("span", name), value);
    line.append(head, range);
    byId("joints").append(line);
  });
  byId("keys").hidden = true;
} else {
  byId("transport").hidden = false;
  byId("worst").hidden = !measured;
  byId("whole").hidden = !in_plan;
  if (in_plan) for (const id of ["previous", "next"]) {
    byId(id).classList.add("word");
    byId(id).textContent = id === "next" ? "next ›" : "‹ previous";
  }
  byId("errorkeys").hidden = !measured;
  choose(byId("speed"), [0.5, 1, 2, 4, 8].map((s) => [s, `${s}×`]), 1, (value) => {
    state.speed = Number(value);
  });
}

