// Steps through the poses of a recorded scene: places the links, fills the layers, tells the errors.
// All names come from files and are untrusted: they are only ever set as textContent.
"use strict";
(function () {
const started = performance.now();
const THREE = MeshCat.THREE;
const data = JSON.parse(document.getElementById("data").textContent);
const byId = (id) => document.getElementById(id);

function bytes(text) {
  const characters = atob(text);
  const out = new Uint8Array(characters.length);
  for (let k = 0; k < out.length; k++) out[k] = characters.charCodeAt(k);
  return out;
}
const floats = (text) => (text === null ? null : new Float32Array(bytes(text).buffer));
const integers = (text) => new Int32Array(bytes(text).buffer);

function element(tag, text, className) {
  const node = document.createElement(tag);
  if (text !== undefined) node.textContent = text;
  if (className) node.className = className;
  return node;
}

// --- the viewer ------------------------------------------------------------------------------------------
const pane = byId("pane");
const viewer = new MeshCat.Viewer(pane);
viewer.set_3d_pane_size = function () {
  viewer.camera.aspect = Math.max(pane.clientWidth, 1) / Math.max(pane.clientHeight, 1);
  viewer.camera.updateProjectionMatrix();
  viewer.renderer.setSize(pane.clientWidth, pane.clientHeight);
  viewer.set_dirty();
};
new ResizeObserver(() => viewer.set_3d_pane_size()).observe(pane);
viewer.gui.domElement.style.display = "none";
for (const text of data.commands) viewer.handle_command_bytearray(bytes(text));
viewer.set_property(["Lights", "AmbientLight", "<object>"], "intensity", 0.4);
viewer.set_property(["Lights", "FillLight", "<object>"], "intensity", 0.12);
for (const light of ["PointLightNegativeX", "PointLightPositiveX"]) viewer.set_property(["Lights", light], "visible", false);
const lamp = new THREE.DirectionalLight(0xffffff, 0.47); // from over the watcher's shoulder: see look()
viewer.set_object(["Lights", "lamp"], lamp);
viewer.set_object(["Lights", "sky"], new THREE.HemisphereLight(0xffffff, 0x9aa4ad, 0.26));
const grid = new THREE.GridHelper(8, 16, 0xa9b4be, 0xc3ccd4);
grid.rotateX(Math.PI / 2);
viewer.set_object(["irbcal", "floor"], grid);
byId("labels").parentNode.appendChild(byId("labels")); // above the canvas

const matrix = (values) => new THREE.Matrix4().fromArray(values);
const point = (values, k) => new THREE.Vector3(values[3 * k], values[3 * k + 1], values[3 * k + 2]);
const target_places = data.targets.map((t) => new THREE.Vector3(...t.place));
const world = matrix(data.world);
const tracker = new THREE.Vector3().setFromMatrixPosition(world);
const joints = data.joints.names.length;

// --- robots ----------------------------------------------------------------------------------------------
for (const robot of [data.robot, data.ghost])
  if (robot) {
    robot.root = matrix(robot.root);
    for (const link of robot.links) {
      link.origin = matrix(link.origin);
      link.axis = new THREE.Vector3(...link.axis);
    }
  }

function places(robot, q) {
  const motion = new THREE.Matrix4();
  const out = [];
  for (const link of robot.links) {
    const value = (link.joint >= 0 ? link.factor * q[link.joint] : 0) + link.offset;
    const T = (link.parent >= 0 ? out[link.parent] : robot.root).clone().multiply(link.origin);
    if (link.kind === "revolute") T.multiply(motion.makeRotationAxis(link.axis, value));
    if (link.kind === "prismatic") T.multiply(motion.makeTranslation(...link.axis.clone().multiplyScalar(value).toArray()));
    out.push(T);
  }
  return out;
}

function effective_by_terms(q) { // see irbcal.modeling.terms.term_joint_map.TermJointMap.static_parts
  const { gain, waves, levers, gravity, base, frames, offsets, turns } = data.joint_map;
  const out = q.map((value, i) => value * (1 + gain[i]));
  for (const { joint, cycles, cosine, sine } of waves)
    for (let k = 0; k < cycles.length; k++)
      out[joint] += cosine[k] * Math.cos(cycles[k] * q[joint]) + sine[k] * Math.sin(cycles[k] * q[joint]);
  const rotation = (rows) => new THREE.Matrix4().set(...rows[0], 0, ...rows[1], 0, ...rows[2], 0, 0, 0, 0, 1);
  const R = rotation(base), g = new THREE.Vector3(...gravity), axes = [], links = [];
  for (let i = 0; i < q.length; i++) {
    R.multiply(rotation(frames[i]));
    axes.push(new THREE.Vector3(0, 0, 1).applyMatrix4(R));
    R.multiply(new THREE.Matrix4().makeRotationZ(offsets[i] + (turns[i] ? q[i] : 0)));
    links.push(R.clone());
  }
  for (const { joints, link, vector } of levers) {
    const lever = new THREE.Vector3(...vector).applyMatrix4(links[link]).cross(g).dot(axes[joints[0]]);
    for (const joint of joints) out[joint] += lever;
  }
  return out;
}

function effective(q) { // the joint map: see irbcal.modeling.joint_map
  if (data.joint_map.waves) return effective_by_terms(q);
  const { gain, stiffness, phases, fourier } = data.joint_map;
  const out = q.map((value, i) => value * (1 + (gain[i] || 0)));
  if (stiffness[0] || stiffness[1]) {
    const fore = stiffness[1] * Math.sin(q[1] + q[2] + phases[1]);
    out[1] += stiffness[0] * Math.sin(q[1] + phases[0]) + fore;
    out[2] += fore;
  }
  if (fourier.some((value) => value))
    out[5] += fourier[0] * Math.cos(q[5]) + fourier[1] * Math.sin(q[5])
      + fourier[2] * Math.cos(2 * q[5]) + fourier[3] * Math.sin(2 * q[5]);
  return out;
}

const ghost_material = new THREE.MeshPhongMaterial({
  color: 0xb7c9da, transparent: true, opacity: 0.42, depthWrite: false, polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1,
});
if (data.ghost)
  for (const k of data.meshes) {
    const body = viewer.scene_tree.find(["irbcal", "robot", String(k), "<object>"]).object;
    const twin = new THREE.Mesh(body.geometry, ghost_material);
    twin.renderOrder = 2;
    viewer.set_object(["irbcal", "ghost", String(k)], twin);
  }

function set_links(name, matrices) {
  for (const k of data.meshes)
    viewer.handle_command({ type: "set_transform", path: `/irbcal/${name}/${k}`, matrix: matrices[k].toArray() });
}

function deviated(T, T_nominal, factor) { // the nominal place with its deviation magnified
  const p = new THREE.Vector3(), p_n = new THREE.Vector3(), s = new THREE.Vector3();
  const r = new THREE.Quaternion(), r_n = new THREE.Quaternion();
  T.decompose(p, r, s);
  T_nominal.decompose(p_n, r_n, s);
  const turn = r.clone().invert().multiply(r_n);
  if (turn.w < 0) turn.set(-turn.x, -turn.y, -turn.z, -turn.w);
  const half = Math.asin(Math.min(1, Math.hypot(turn.x, turn.y, turn.z)));
  const axis = new THREE.Vector3(turn.x, turn.y, turn.z).normalize();
  r.multiply(new THREE.Quaternion().setFromAxisAngle(axis, Math.min(2 * half * factor, Math.PI)));
  return new THREE.Matrix4().compose(p.lerp(p_n, factor), r, new THREE.Vector3(1, 1, 1));
}

// --- poses and points --------------------------------------------------------------------------------------
const poses = { ids: data.poses.ids, group: data.poses.group, groups: data.poses.groups,
  q: floats(data.poses.q), effective: floats(data.poses.effective), count: data.poses.ids.length };
const points = data.points && { count: data.points.count, pose: integers(data.points.pose),
  target: integers(data.points.target), measured: floats(data.points.measured),
  at: { calibrated: floats(data.points.calibrated), nominal: floats(data.points.nominal) },
  error: { calibrated: floats(data.points.error_calibrated), nominal: floats(data.points.error_nominal) },
  turn: { calibrated: floats(data.points.turn_calibrated), nominal: floats(data.points.turn_nominal) },
  u95: data.points.u95 && floats(data.points.u95) };
const U95 = "95 % of a coordinate's errors are expected within this";
const within = (row) => element("td", `± ${number(1e3 * points.u95[row], 3)}`);
const measured = data.mode === "measured";
const size = {}; // error of each point, mm
if (measured)
  for (const model of ["nominal", "calibrated"]) {
    const e = points.error[model];
    size[model] = Float32Array.from({ length: points.count }, (_, k) => 1e3 * Math.hypot(e[3 * k], e[3 * k + 1], e[3 * k + 2]));
  }
const rows_of = Array.from({ length: poses.count }, () => []);
if (points) points.pose.forEach((pose, row) => rows_of[pose].push(row));

const state = { pose: 0, at: 0, active: [], playing: false, speed: 1, model: "calibrated", magnification: data.magnification,
  only: false, ghost: "magnified", q: new Array(joints).fill(0), layers: {}, groups: poses.groups.map(() => true), travel: null };

// --- layers ------------------------------------------------------------------------------------------------
const radius = Math.min(Math.max(0.0034 * data.reach, 0.0015), 0.008);
const colours = data.scale.colours.map((text) => new THREE.Color(text));
function colour_of(mm) {
  const x = Math.min(Math.max(mm / data.scale.top_mm, 0), 1) * (colours.length - 1);
  const k = Math.min(Math.floor(x), colours.length - 2);
  return colours[k].clone().lerp(colours[k + 1], x - k);
}

function instanced(name, geometry, look, most) {
  const mesh = new THREE.InstancedMesh(geometry, new THREE.MeshLambertMaterial(look), Math.max(most, 1));
  mesh.frustumCulled = false;
  mesh.count = 0;
  viewer.set_object(["irbcal", ...name], mesh);
  return mesh;
}
const upward = (geometry) => geometry.translate(0, 0.5, 0);
const total = points ? points.count : 0;
const most_at_once = rows_of.reduce((most, rows) => Math.max(most, rows.length), data.targets.length);
const body = {};
if (points) {
  if (measured) {
    body.measured = instanced(["measured"], new THREE.IcosahedronGeometry(1.1 * radius, 0), { color: 0x17324d }, total);
    body.shaft = instanced(["vectors", "shaft"], upward(new THREE.CylinderGeometry(0.55 * radius, 0.55 * radius, 1, 6, 1, true)), {}, total);
    body.head = instanced(["vectors", "head"], upward(new THREE.ConeGeometry(1.5 * radius, 1, 8, 1)), {}, total);
  }
  body.modelled = instanced(["modelled"], new THREE.BoxGeometry(1.62 * radius, 1.62 * radius, 1.62 * radius), measured ? { color: 0xffffff, emissive: 0x555555 } : { color: 0x17324d }, total);
}
body.shown = instanced(["shown"], new THREE.SphereGeometry(2.1 * radius, 20, 14),
  { color: 0xffd23f, transparent: true, opacity: 0.5, depthWrite: false }, most_at_once);
body.sight = instanced(["sight"], upward(new THREE.CylinderGeometry(0.4 * radius, 0.4 * radius, 1, 6, 1, true)),
  { color: 0xd6002f, emissive: 0xb00020, transparent: true, opacity: 0.75, depthWrite: false }, most_at_once);
for (const mesh of [body.shown, body.sight]) mesh.renderOrder = 3;

const UP = new THREE.Vector3(0, 1, 0), STILL = new THREE.Quaternion(), ONE = new THREE.Vector3(1, 1, 1);
const scratch = new THREE.Matrix4(), way = new THREE.Vector3(), turn = new THREE.Quaternion(), scale = new THREE.Vector3();
function rod(mesh, slot, from, direction, length, width) {
  turn.setFromUnitVectors(UP, direction);
  mesh.setMatrixAt(slot, scratch.compose(from, turn, scale.set(width, Math.max(length, 1e-9), width)));
}

let slots = new Int32Array(total).fill(-1);
function write_point(row) {
  const slot = slots[row];
  if (slot < 0) return;
  const shown = points.pose[row] === state.pose;
  const from = point(points.at[state.model], row);
  scale.setScalar(shown ? 1.5 : 1);
  body.modelled.setMatrixAt(slot, scratch.compose(from, STILL, scale));
  if (!measured) return;
  body.measured.setMatrixAt(slot, scratch.compose(point(points.measured, row), STILL, scale));
  way.copy(point(points.error[state.model], row)).multiplyScalar(state.magnification);
  const length = way.length();
  if (length > 0) way.divideScalar(length);
  else way.copy(UP);
  const head = Math.min(0.5 * length, 6 * radius);
  const width = Math.max(Math.min(1, length / (12 * radius)), 0.4) * (shown ? 1.8 : 1);
  rod(body.shaft, slot, from, way, length - head, width);
  rod(body.head, slot, from.addScaledVector(way, length - head), way, head, width);
  const colour = colour_of(size[state.model][row]);
  body.shaft.setColorAt(slot, colour);
  body.head.setColorAt(slot, colour);
}
const layer_meshes = () => [body.measured, body.modelled, body.shaft, body.head].filter(Boolean);
function touch() {
  for (const mesh of layer_meshes()) {
    mesh.instanceMatrix.needsUpdate = true;
    if (mesh.instanceColor) mesh.instanceColor.needsUpdate = true;
  }
  viewer.set_dirty();
}
const group_on = (pose) => state.groups[poses.group[pose]];
function fill() {
  if (!points) return;
  let count = 0;
  for (let row = 0; row < total; row++) {
    const pose = points.pose[row];
    slots[row] = group_on(pose) && (!state.only || pose === state.pose) ? count++ : -1;
    write_point(row);
  }
  for (const mesh of layer_meshes()) mesh.count = count;
  touch();
}

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
    if (state.ghost === "magnified") ghost = ghost.map((T, k) => deviated(matrices[k], T, state.magnification));
    if (state.ghost === "beside") {
      const side = new THREE.Matrix4().makeTranslation(beside.x, beside.y, beside.z);
      ghost = ghost.map((T) => side.clone().multiply(T));
    }
    set_links("ghost", ghost);
  }
  state.tip = matrices[data.robot.tip];
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
  body.shown.instanceMatrix.needsUpdate = body.sight.instanceMatrix.needsUpdate = true;
  viewer.set_dirty();
}

function show_pose(at, moving) {
  if (!state.active.length) return;
  state.at = Math.min(Math.max(at, 0), state.active.length - 1);
  const before = state.pose;
  state.pose = state.active[state.at];
  if (state.only) fill();
  else if (points) {
    for (const pose of new Set([before, state.pose])) for (const row of rows_of[pose]) write_point(row);
    touch();
  }
  if (!moving) move_robot(joint_row(poses.q, state.pose), joint_row(poses.effective, state.pose));
  byId("slider").value = state.at;
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
  box.append(element("p", `Pose ${poses.ids[state.pose]}`, "name"));
  const where = `${state.at + 1} of ${state.active.length}` + (group ? ` · group ${group}` : "");
  box.append(element("p", (data.mode === "plan" ? "planned, not measured · " : "") + where, "where"));
  const rows = rows_of[state.pose];
  if (measured) {
    const table = element("table");
    const head = table.insertRow();
    head.append(element("th", "error, mm"));
    for (const model of ["nominal", "calibrated"]) head.append(element("th", model, state.model === model ? "now" : ""));
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
      line.append(element("td", "orientation, deg"));
      for (const model of ["nominal", "calibrated"]) {
        const largest = Math.max(...rows.map((row) => points.turn[model][row] || 0));
        line.append(element("td", number((largest * 180) / Math.PI, 4), state.model === model ? "now" : ""));
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

function tell_statistics() {
  if (!measured) return;
  const box = byId("statistics");
  box.replaceChildren();
  const parts = {};
  for (const model of ["nominal", "calibrated"]) {
    let n = 0, sum = 0, largest = 0;
    for (let row = 0; row < total; row++)
      if (group_on(points.pose[row])) {
        n++;
        sum += size[model][row];
        largest = Math.max(largest, size[model][row]);
      }
    parts[model] = { n, mean: sum / Math.max(n, 1), largest };
  }
  const { nominal: a, calibrated: b } = parts;
  box.append(`${a.n} points: mean ${number(a.mean, 3)} → ${number(b.mean, 3)} mm, largest ${number(a.largest, 3)} → ${number(b.largest, 3)} mm`);
}

function worst() {
  if (!measured) return;
  let best = -1, at = state.at;
  state.active.forEach((pose, k) => {
    for (const row of rows_of[pose])
      if (size[state.model][row] > best) {
        best = size[state.model][row];
        at = k;
      }
  });
  pause();
  show_pose(at);
}

function activate() { // which poses are stepped through: those of the groups that are on
  const shown = state.pose;
  state.active = [];
  for (let pose = 0; pose < poses.count; pose++) if (group_on(pose)) state.active.push(pose);
  byId("slider").max = Math.max(state.active.length - 1, 0);
  const at = state.active.findIndex((pose) => pose >= shown);
  fill();
  tell_statistics();
  if (state.active.length) show_pose(at < 0 ? state.active.length - 1 : at);
  else byId("pose").replaceChildren(element("p", "no group is shown", "where"));
}

// --- playing -----------------------------------------------------------------------------------------------
const STEP = 0.8, REST = 0.35; // seconds for a way between poses, and at a pose, at speed 1
function pause() {
  state.playing = false;
  state.travel = null;
  byId("play").textContent = "▶";
}
function play() {
  if (state.playing) {
    pause();
    show_pose(state.at);
    return;
  }
  if (state.active.length < 2) return;
  if (state.at === state.active.length - 1) show_pose(0);
  state.playing = true;
  state.travel = { time: 0, from: state.pose };
  byId("play").textContent = "❙❙";
  let last = performance.now();
  const frame = (now) => {
    if (!state.playing) return;
    const travel = state.travel;
    travel.time += (state.speed * Math.min(now - last, 200)) / 1e3;
    last = now;
    if (travel.time >= STEP + REST || travel.from === state.pose) {
      if (travel.from !== state.pose) travel.time -= STEP + REST;
      if (state.at === state.active.length - 1) {
        pause();
        show_pose(state.at);
        return;
      }
      travel.from = state.pose;
      show_pose(state.at + 1, true);
    }
    const part = Math.min(Math.max(travel.time / STEP, 0), 1);
    const between = (values) => {
      const a = joint_row(values, travel.from), b = joint_row(values, state.pose);
      return a.map((value, k) => value + part * (b[k] - value));
    };
    move_robot(between(poses.q), between(poses.effective));
    requestAnimationFrame(frame);
  };
  requestAnimationFrame(frame);
}

// --- camera ------------------------------------------------------------------------------------------------
viewer.camera.fov = 36;
viewer.camera.near = 0.02;
const AZIMUTH = data.tracker ? Math.atan2(tracker.y, tracker.x) + (58 * Math.PI) / 180 : (-50 * Math.PI) / 180;
const beside = new THREE.Vector3(-Math.sin(AZIMUTH), Math.cos(AZIMUTH), 0).multiplyScalar(0.8 * data.reach);
function extent(everything) { // the points that have to be inside the picture
  const out = [];
  const margin = 0.07 * data.reach;
  const add = (v, wide = margin) => {
    for (const sign of [-1, 1]) for (const axis of ["x", "y", "z"]) {
      const w = v.clone();
      w[axis] += sign * wide;
      out.push(w);
    }
  };
  for (const T of places(data.robot, poses.count ? joint_row(poses.effective, state.pose) : effective(state.q)))
    add(new THREE.Vector3().setFromMatrixPosition(T), 2 * margin);
  if (points) for (let row = 0; row < total; row++) out.push(point(points.at.calibrated, row));
  else {
    for (const place of tip_targets) add(place);
    if (data.cube) add(new THREE.Vector3(...data.cube.centre), data.cube.edge / 2);
  }
  if (everything) {
    if (data.tracker) {
      add(tracker, 0.4);
      add(new THREE.Vector3(tracker.x, tracker.y, tracker.z - 1.3), 0.4);
    }
    for (const item of data.references) add(new THREE.Vector3(...item.place));
    if (data.ghost && state.ghost === "beside") add(beside, 0.5 * data.reach);
  }
  return out;
}
function look(everything) {
  const seen = extent(everything);
  const elevation = (16 * Math.PI) / 180;
  const back = new THREE.Vector3(Math.cos(elevation) * Math.cos(AZIMUTH), Math.cos(elevation) * Math.sin(AZIMUTH), Math.sin(elevation));
  const right = new THREE.Vector3(-Math.sin(AZIMUTH), Math.cos(AZIMUTH), 0);
  const up = back.clone().cross(right);
  const along = (v) => new THREE.Vector3(v.dot(right), v.dot(up), v.dot(back));
  const box = new THREE.Box3().setFromPoints(seen.map(along));
  const c = box.getCenter(new THREE.Vector3());
  const slope = Math.tan((viewer.camera.fov * Math.PI) / 360);
  const aspect = Math.max(pane.clientWidth, 1) / Math.max(pane.clientHeight, 1);
  let distance = 0;
  for (const v of seen) {
    const at = along(v).sub(c);
    distance = Math.max(distance, at.z + Math.max(Math.abs(at.y) / slope, Math.abs(at.x) / (slope * aspect)));
  }
  const centre = right.clone().multiplyScalar(c.x).addScaledVector(up, c.y).addScaledVector(back, c.z);
  const eye = centre.clone().addScaledVector(back, distance);
  viewer.camera.position.set(eye.x, eye.z, -eye.y); // meshcat's camera lives in axes with y up
  viewer.controls.target.set(centre.x, centre.z, -centre.y);
  viewer.controls.update();
  lamp.position.copy(back).addScaledVector(up, 0.8).addScaledVector(right, -0.5);
  viewer.set_dirty();
}

// --- labels ------------------------------------------------------------------------------------------------
const labels = [];
function label(text, place, layer) {
  const node = element("span", text);
  byId("labels").append(node);
  labels.push({ node, place, layer });
}
if (data.tracker) label("laser tracker", tracker.clone().add(new THREE.Vector3(0, 0, 0.14)), "tracker");
for (const item of data.references) label(item.name, new THREE.Vector3(...item.place).add(new THREE.Vector3(0, 0, 0.06)), "references");
if (data.cube) {
  const edge = data.cube.edge;
  label(`ISO 9283 cube, ${number(1e3 * edge, 0)} mm`, new THREE.Vector3(...data.cube.centre).add(new THREE.Vector3(0, 0, edge / 2)), "cube");
}
const render = viewer.render.bind(viewer);
viewer.render = function () {
  render();
  const w = pane.clientWidth, h = pane.clientHeight;
  for (const { node, place, layer } of labels) {
    const at = new THREE.Vector3(place.x, place.z, -place.y).project(viewer.camera);
    const visible = state.layers.labels && state.layers[layer] && Math.abs(at.x) < 1 && Math.abs(at.y) < 1 && at.z < 1;
    node.hidden = !visible;
    if (visible) node.style.transform = `translate(${(((at.x + 1) * w) / 2).toFixed(1)}px, ${(((1 - at.y) * h) / 2).toFixed(1)}px) translate(-50%, -100%)`;
  }
};

// --- panel -------------------------------------------------------------------------------------------------
function choose(select, pairs, value, act) {
  for (const [key, text] of pairs) {
    const option = element("option", text);
    option.value = key;
    select.append(option);
  }
  select.value = value;
  select.addEventListener("change", () => act(select.value));
}
const LAYERS = [
  ["robot", data.ghost ? "calibrated robot" : "robot", true, [["robot"]], "#9aa5ae"],
  ["ghost", "nominal robot", !!data.ghost, [["ghost"]], "#b7c9da"],
  ["measured", "measured points", measured, [["measured"]], "#17324d"],
  ["modelled", measured ? "modelled points" : "expected points", !!points, [["modelled"]], measured ? "#fff" : "#17324d"],
  ["vectors", "error vectors", measured, [["vectors"]], data.scale.colours[3]],
  ["shown", measured ? "targets of this pose" : data.targets.some((t) => t.place.some((v) => v !== 0)) ? "targets" : "tip", true, [["shown"]], "#ffd23f"],
  ["path", "way of the first target", data.path, [["path"]], "#0b7a75"],
  ["tracker", "laser tracker", data.tracker, [["tracker"]], "#3a4149"],
  ["sight", "lines of sight", data.tracker, [["sight"]], "#d6002f"],
  ["references", "reference points", data.references.length > 0, [["references"]], "#0b7a75"],
  ["cube", "ISO 9283 cube", !!data.cube, [["cube"]], "#7a4fa3"],
  ["floor", "floor of the base", true, [["floor"]], "#c3ccd4"],
  ["labels", "labels", labels.length > 0, [], "transparent"],
];
function set_layer(name, on) {
  state.layers[name] = on;
  for (const path of LAYERS.find((layer) => layer[0] === name)[3])
    viewer.handle_command({ type: "set_property", path: `/irbcal/${path.join("/")}`, property: "visible", value: on });
  viewer.set_dirty();
}
for (const [name, text, present, , colour] of LAYERS) {
  if (!present) continue;
  const line = element("label");
  const box = element("input");
  box.type = "checkbox";
  box.id = `layer-${name}`;
  box.checked = name !== "ghost" || measured;
  const mark = element("span", undefined, "mark");
  mark.style.background = colour;
  if (colour === "#fff") mark.style.cssText += "border: 1px solid #8a949d; border-radius: 2px";
  line.append(box, mark, element("span", text));
  if (name === "ghost") {
    const where = element("select");
    where.id = "ghost";
    choose(where, [["place", "in place"], ["magnified", `shift × ${state.magnification}`], ["beside", "beside"]], state.ghost, (value) => {
      state.ghost = value;
      refresh_robot();
    });
    line.append(where);
  }
  byId("layers").append(line);
  box.addEventListener("change", () => set_layer(name, box.checked));
  set_layer(name, box.checked);
}
if (points) {
  const line = element("label");
  const box = element("input");
  box.type = "checkbox";
  box.id = "only";
  line.append(box, element("span", "points of this pose only"));
  byId("layers").append(line);
  box.addEventListener("change", () => {
    state.only = box.checked;
    fill();
  });
}
function refresh_robot() {
  if (data.mode === "sliders") move_robot(state.q, effective(state.q));
  else if (!state.playing && state.active.length) move_robot(joint_row(poses.q, state.pose), joint_row(poses.effective, state.pose));
}

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
if (measured) {
  byId("legend").hidden = false;
  byId("bar").style.background = `linear-gradient(to right, ${data.scale.colours.join(", ")})`;
  const top = data.scale.top_mm;
  const most = Math.max(...["nominal", "calibrated"].map((model) => size[model].reduce((a, b) => Math.max(a, b), 0)));
  const digits = top < 0.1 ? 3 : top < 1 ? 2 : top < 20 ? 1 : 0;
  for (let k = 0; k <= 4; k++) {
    const text = number((k * top) / 4, top >= 10 || k % 2 === 0 ? digits : digits + 1);
    const tick = element("span", (k === 4 && most > top * 1.0001 ? "≥ " : "") + text);
    tick.style.cssText = `left: ${25 * k}%; transform: translateX(${-25 * k}%)`;
    byId("ticks").append(tick);
  }
  const factors = new Set([1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, data.magnification]);
  choose(byId("magnification"), [...factors].sort((a, b) => a - b).map((f) => [f, `× ${f}`]), data.magnification, (value) => {
    state.magnification = Number(value);
    for (const option of document.querySelectorAll("#ghost option[value=magnified]")) option.textContent = `shift × ${value}`;
    fill();
    refresh_robot();
  });
  for (const radio of document.getElementsByName("model"))
    radio.addEventListener("change", () => set_model(radio.value));
}
function set_model(model) {
  state.model = model;
  for (const radio of document.getElementsByName("model")) radio.checked = radio.value === model;
  fill();
  tell_pose();
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
  byId("errorkeys").hidden = !measured;
  choose(byId("speed"), [0.5, 1, 2, 4, 8].map((s) => [s, `${s}×`]), 1, (value) => {
    state.speed = Number(value);
  });
}

// --- keys and buttons ----------------------------------------------------------------------------------------
const step = (at) => {
  pause();
  show_pose(at);
};
const actions = {
  ArrowLeft: () => step(state.at - 1), ArrowRight: () => step(state.at + 1),
  Home: () => step(0), End: () => step(state.active.length - 1), " ": play,
  w: worst, b: () => measured && set_model(state.model === "nominal" ? "calibrated" : "nominal"),
};
const camera_actions = { t: () => look(true), r: () => look(false) };
document.addEventListener("keydown", (event) => {
  const own = event.target.tagName + (event.target.type || "");
  if (event.ctrlKey || event.metaKey || event.altKey || /^SELECT|^INPUTradio/.test(own)) return;
  if (event.key === " " && /^BUTTON|^INPUTcheckbox/.test(own)) return; // the space bar is theirs
  const act = camera_actions[event.key] || (poses.count && actions[event.key]);
  if (!act) return;
  event.preventDefault();
  act();
});
byId("slider").addEventListener("input", (event) => step(Number(event.target.value)));
for (const [id, act] of [["first", actions.Home], ["previous", actions.ArrowLeft], ["play", play], ["next", actions.ArrowRight],
  ["last", actions.End], ["worst", worst], ["near", camera_actions.r], ["far", camera_actions.t]])
  byId(id).addEventListener("click", (event) => {
    event.currentTarget.blur(); // the space bar plays, and does not press this button again
    act();
  });
byId("gui").addEventListener("click", () => {
  const style = viewer.gui.domElement.style;
  style.display = style.display === "none" ? "" : "none";
  if (style.display === "") viewer.gui.open();
});

// --- begin ---------------------------------------------------------------------------------------------------
viewer.set_3d_pane_size();
if (data.mode === "sliders") {
  move_robot(state.q, effective(state.q));
  tell_pose();
} else activate();
function go_to_address() { // view.html#pose=NAME, as the report links to it
  const wanted = new URLSearchParams(location.hash.slice(1)).get("pose");
  const at = wanted === null ? -1 : state.active.findIndex((pose) => String(poses.ids[pose]) === wanted);
  if (at >= 0) step(at);
}
addEventListener("hashchange", go_to_address);
go_to_address();
look(false);
viewer.render();
byId("waiting").remove();
window.irbcalView = { viewer, state, poses, points, body, slots: () => slots, seconds: (performance.now() - started) / 1e3 };
})();
