// --- the shown pose ----------------------------------------------------------------------------------------
const joint_row = (values, pose) => Array.from(values.subarray(pose * joints, (pose + 1) * joints));
let tip_targets = [];
function move_robot(q, theta) {
  state.q = q;
  const matrices = places(data.robot, theta);
  set_links("robot", matrices);
  if (data.ghost) {
    let ghost = places(data.ghost, q);
    // in place it is a veil over the robot; elsewhere it hides where both surfaces are one
    ghost_material.polygonOffsetFactor = ghost_material.polygonOffsetUnits = state.ghost === "place" ? -1 : 1;
    if (state.ghost === "magnified") ghost = ghost.map((T, k) => deviated(matrices[k], T, ghost_factor()));
    if (state.ghost === "beside") {
      const side = new THREE.Matrix4().makeTranslation(beside.x, beside.y, beside.z);
      ghost = ghost.map((T) => side.clone().multiply(T));
    }
    set_links("ghost", ghost);
  }
  state.tip = matrices[data.robot.tip];
  for (const one of labels) if (one.in_tip) one.place.copy(one.in_tip).applyMatrix4(state.tip);
  if (data.cell.length) viewer.handle_command({ type: "set_transform", path: "/irbcal/cell/tools", matrix: state.tip.toArray() });
  tip_targets = target_places.map((place) => place.clone().applyMatrix4(state.tip));
  const seen = points && poses.count ? rows_of[state.pose].map((row) => points.target[row]) : data.targets.map((_, k) => k);
  body.shown.count = seen.length;
  body.sight.count = data.tracker ? seen.length : 0;
  seen.forEach((k, slot) => {
    body.shown.setMatrixAt(slot, scratch.compose(tip_targets[k], STILL, ONE));
    way.copy(tip_targets[k]).sub(tracker);
    const length = way.length();
    rod(body.sight, slot, tracker, way.divideScalar(length), length, 1);
  });
  const flange = new THREE.Vector3().setFromMatrixPosition(state.tip);
  let rods = 0;
  for (const place of tip_targets) { // from the flange to the reflectors: what is known of the tool
    way.copy(place).sub(flange);
    const length = way.length();
    if (length > radius) rod(body.tool, rods++, flange, way.divideScalar(length), length, 1);
  }
  body.tool.count = rods;
  body.tool.instanceMatrix.needsUpdate = true;
  body.shown.instanceMatrix.needsUpdate = body.sight.instanceMatrix.needsUpdate = true;
  viewer.set_dirty();
}

const home = data.home && { ...data.home, effective: effective(data.home.q) };
function on_way(from, to, part) { // commanded and effective joints between two poses; over home where the plan goes there
  return [poses.q, poses.effective].map((values, k) => {
    const stops = [joint_row(values, from), joint_row(values, to)];
    if (home && home.before.includes(to)) stops.splice(1, 0, k ? home.effective : home.q);
    const at = part * (stops.length - 1);
    const first = Math.min(Math.floor(at), stops.length - 2);
    return stops[first].map((value, joint) => value + (at - first) * (stops[first + 1][joint] - value));
  });
}
function show_next(from, to) { // the robot in the next pose, as a ghost, and the way of the first target to it
  const place = (theta) => places(data.robot, theta);
  const tip = (matrices) => target_places[0].clone().applyMatrix4(matrices[data.robot.tip]);
  next_material.visible = to >= 0;
  body.way.count = to >= 0 ? WAY_PIECES : 0;
  set_label(now_label, `pose ${poses.ids[from]}`, tip(place(joint_row(poses.effective, from))));
  set_label(next_label, to >= 0 ? `next: pose ${poses.ids[to]}` : "", now_label.place);
  if (to < 0) return;
  const matrices = place(joint_row(poses.effective, to));
  set_links("next", matrices);
  next_label.place.copy(tip(matrices));
  let before = now_label.place.clone();
  for (let k = 0; k < WAY_PIECES; k++) {
    const after = tip(place(on_way(from, to, (k + 1) / WAY_PIECES)[1]));
    way.copy(after).sub(before);
    const length = way.length();
    rod(body.way, k, before, length ? way.divideScalar(length) : UP, length, 1);
    before = after;
  }
  body.way.instanceMatrix.needsUpdate = true;
}

function show_pose(at, moving) {
  if (!state.active.length) return;
  state.at = Math.min(Math.max(at, 0), state.active.length - 1);
  const before = [state.pose, state.next];
  state.pose = state.active[state.at];
  if (in_plan) {
    state.next = moving || state.at + 1 === state.active.length ? -1 : state.active[state.at + 1];
    if (moving) show_next(state.travel.from, state.pose);
    else show_next(state.pose, state.next);
  }
  if (state.which !== "all") fill();
  else if (points) {
    for (const pose of new Set([...before, state.pose, state.next])) for (const row of rows_of[pose] || []) write_point(row);
    write_frames();
    touch();
  }
  if (!moving) move_robot(joint_row(poses.q, state.pose), joint_row(poses.effective, state.pose));
  byId("slider").value = state.at;
  mark_in_list();
  tell_pose();
}

function number(value, digits) {
  const text = value.toFixed(digits);
  return Number(text) === 0 ? text.replace("-", "") : text.replace("-", "\u2212");
}
function joint_values(q) {
  const grid = element("div", undefined, "values");
  q.forEach((value, k) =>
    grid.append(element("span", `q${k + 1} ${number(value / data.joints.factors[k], 2)}${data.joints.units[k] === "deg" ? "°" : " mm"}`)));
  return grid;
}
function tell_pose() {
  const box = byId("pose");
  box.replaceChildren();
  if (data.mode === "sliders") {
    const tip = new THREE.Vector3().setFromMatrixPosition(state.tip);
    box.append(element("p", "Tip in the base link", "where"));
    box.append(element("p", ["x", "y", "z"].map((axis) => `${axis} ${number(1e3 * tip[axis], 2)}`).join("   ") + " mm", "tip"));
    return;
  }
  const group = poses.groups[poses.group[state.pose]];
  box.append(element("p", `${in_program ? "Target" : "Pose"} ${poses.ids[state.pose]}`, "name"));
  const kind = poses.fitted ? ` · ${KINDS[kind_of(state.pose)]}` : "";
  const where = `${state.at + 1} of ${state.active.length}${kind}` + (group ? ` · group ${group}` : "");
  box.append(element("p", (data.mode === "plan" ? "planned, not measured · " : "") + where, "where"));
  const rows = rows_of[state.pose];
  if (measured) {
    const table = element("table");
    const head = table.insertRow();
    head.append(element("th", data.at_features ? "distance, mm" : "error, mm"));
    for (const model of ["nominal", "calibrated"]) head.append(element("th", model_words(model), state.model === model ? "now" : ""));
    if (points.u95) head.append(element("th", "95 %")), (head.lastChild.title = U95);
    for (const row of rows) {
      const line = table.insertRow();
      line.append(element("td", data.targets[points.target[row]].name));
      for (const model of ["nominal", "calibrated"]) {
        const cell = element("td", undefined, state.model === model ? "now" : "");
        const chip = element("span", undefined, "chip");
        chip.style.background = colour_of(size[model][row]).getStyle();
        cell.append(chip, number(size[model][row], 3));
        line.append(cell);
      }
      if (points.u95) line.append(within(row));
    }
    if (points.turn.nominal && rows.some((row) => !Number.isNaN(points.turn.nominal[row]))) {
      const line = table.insertRow();
      line.append(element("td", "angle, deg"));
      for (const model of ["nominal", "calibrated"]) {
        const most = Math.max(...rows.map((row) => points.turn[model][row] || 0));
        line.append(element("td", number((most * 180) / Math.PI, 4), state.model === model ? "now" : ""));
      }
    }
    box.append(table);
  } else {
    const table = element("table");
    const head = table.insertRow();
    for (const text of ["expected, mm", "x", "y", "z"]) head.append(element("th", text));
    if (points.u95) head.append(element("th", "95 %")), (head.lastChild.title = U95);
    const inverse = world.clone().invert();
    for (const row of rows) {
      const line = table.insertRow();
      line.append(element("td", data.targets[points.target[row]].name));
      const at = point(points.at.calibrated, row).applyMatrix4(inverse);
      for (const value of [at.x, at.y, at.z]) line.append(element("td", number(1e3 * value, 1)));
      if (points.u95) line.append(within(row));
    }
    box.append(table);
  }
  box.append(in_plan ? next_move() : joint_values(joint_row(poses.q, state.pose)));
}
function next_move() { // joints of the shown pose of a plan, of the next, and between them
  const now = joint_row(poses.q, state.pose), next = state.next < 0 ? null : joint_row(poses.q, state.next);
  const table = element("table", undefined, "move");
  const head = table.insertRow();
  for (const text of ["joint", "now", ...(next ? [`next: ${poses.ids[state.next]}`, "move"] : [])]) head.append(element("th", text));
  now.forEach((value, k) => {
    const line = table.insertRow();
    const values = [value, ...(next ? [next[k], next[k] - value] : [])].map((one) => number(one / data.joints.factors[k], 2));
    line.append(element("td", `q${k + 1}, ${data.joints.units[k].replace("deg", "°")}`), ...values.map((text) => element("td", text)));
    if (next && Number(values[2].replace("\u2212", "-"))) line.className = "moves";
  });
  const box = element("div");
  box.append(table);
  if (home && home.before.includes(state.next)) box.append(element("p", "over home: the direct way is not free", "where"));
  return box;
}

function tell_statistics() { // held-out and fitted poses apart
  if (!measured) return;
  const box = byId("statistics");
  box.replaceChildren();
  const table = element("table");
  const head = table.insertRow();
  for (const text of ["mm", ...MODELS.map(model_words)]) head.append(element("th", text));
  KINDS.forEach((kind, k) => {
    const found = MODELS.map((model) => {
      let n = 0, sum = 0, most = 0;
      for (let row = 0; row < total; row++)
        if (kind_of(points.pose[row]) === k && group_on(points.pose[row])) {
          n++;
          sum += size[model][row];
          most = Math.max(most, size[model][row]);
        }
      return { n, mean: sum / n, most };
    });
    const n = found[0].n;
    if (!n) return;
    const title = table.insertRow();
    const words = `${n} ${data.at_features ? "row" : "point"}${n === 1 ? "" : "s"}${poses.fitted ? `, ${k ? "fitted: no proof" : "held out"}` : ""}`;
    title.append(element("td", words, "kind"));
    title.lastChild.colSpan = 3;
    for (const [word, key] of [["mean", "mean"], ["largest", "most"]]) {
      const line = table.insertRow();
      line.append(element("td", word), ...found.map((one) => element("td", number(one[key], 3))));
    }
  });
  box.append(table);
}

function activate() { // which poses are stepped through: those of the groups that are on
  const shown = state.pose;
  state.active = [];
  for (let pose = 0; pose < poses.count; pose++) if (group_on(pose)) state.active.push(pose);
  byId("slider").max = Math.max(state.active.length - 1, 0);
  rank();
  list_poses();
  const at = state.active.findIndex((pose) => pose >= shown);
  fill();
  tell_statistics();
  if (state.active.length) show_pose(at < 0 ? state.active.length - 1 : at);
  else byId("pose").replaceChildren(element("p", "no pose is chosen", "where"));
}

