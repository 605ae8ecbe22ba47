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

function show_pose(at, moving) {
  if (!state.active.length) return;
  state.at = Math.min(Math.max(at, 0), state.active.length - 1);
  const before = state.pose;
  state.pose = state.active[state.at];
  if (state.which !== "all") fill();
  else if (points) {
    for (const pose of new Set([before, state.pose])) for (const row of rows_of[pose]) write_point(row);
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
  box.append(joint_values(joint_row(poses.q, state.pose)));
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
    const words = `${n} ${data.at_features ? "rows" : "points"}${poses.fitted ? `, ${k ? "fitted: no proof" : "held out"}` : ""}`;
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

