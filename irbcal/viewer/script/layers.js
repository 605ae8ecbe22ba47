// --- layers ------------------------------------------------------------------------------------------------
const radius = Math.min(Math.max(0.0034 * data.reach, 0.0015), 0.008);
const colours = data.scale.colours.map((text) => new THREE.Color(text));
function colour_of(mm) {
  const x = Math.min(Math.max(mm / top_mm(), 0), 1) * (colours.length - 1);
  const k = Math.min(Math.floor(x), colours.length - 2);
  return colours[k].clone().lerp(colours[k + 1], x - k);
}

function instanced(name, geometry, look, most, lit) { // what is not lit has the legend's colours from every side
  const material = lit ? new THREE.MeshLambertMaterial(look) : new THREE.MeshBasicMaterial(look);
  const mesh = new THREE.InstancedMesh(geometry, material, Math.max(most, 1));
  mesh.frustumCulled = false;
  mesh.count = 0;
  viewer.set_object(["irbcal", ...name], mesh);
  return mesh;
}
const upward = (geometry) => geometry.translate(0, 0.5, 0);
const rod_of = (width, sides = 6) => upward(new THREE.CylinderGeometry(width * radius, width * radius, 1, sides, 1, true));
const most_at_once = rows_of.reduce((most, rows) => Math.max(most, rows.length), data.targets.length);
const body = {};
const WAY_PIECES = 40; // of the way to the next pose
if (points) {
  if (measured) {
    body.measured = instanced(["measured"], new THREE.OctahedronGeometry(2.1 * radius, 0), {}, total);
    body.shaft = instanced(["vectors", "shaft"], rod_of(0.55, 4), {}, total);
    body.head = instanced(["vectors", "head"], upward(new THREE.ConeGeometry(1.5 * radius, 1, 6, 1)), {}, total);
  }
  body.modelled = instanced(["modelled"], new THREE.BoxGeometry(1.62 * radius, 1.62 * radius, 1.62 * radius),
    measured ? { color: 0xffffff, emissive: 0x555555 } : {}, total, measured);
  if (in_plan) body.way = instanced(["next", "way"], rod_of(0.5), { color: 0x1f72bd }, WAY_PIECES);
  if (oriented.length) {
    body.axes = instanced(["frames", "measured"], rod_of(0.5), {}, 3 * oriented.length);
    body.modelled_axes = instanced(["frames", "modelled"], rod_of(0.3), { transparent: true, opacity: 0.55 }, 3 * oriented.length);
  }
}
body.shown = instanced(["shown"], new THREE.SphereGeometry(2.1 * radius, 20, 14),
  { color: 0xffd23f, transparent: true, opacity: 0.5, depthWrite: false }, most_at_once);
body.sight = instanced(["sight"], rod_of(0.4), { color: 0xd6002f, transparent: true, opacity: 0.75, depthWrite: false }, most_at_once);
body.tool = instanced(["tool"], rod_of(0.9), {}, data.targets.length, true);
for (const mesh of [body.shown, body.sight]) mesh.renderOrder = 3;

const UP = new THREE.Vector3(0, 1, 0), STILL = new THREE.Quaternion(), ONE = new THREE.Vector3(1, 1, 1);
const scratch = new THREE.Matrix4(), way = new THREE.Vector3(), turn = new THREE.Quaternion(), scale = new THREE.Vector3();
function rod(mesh, slot, from, direction, length, width) {
  turn.setFromUnitVectors(UP, direction);
  mesh.setMatrixAt(slot, scratch.compose(from, turn, scale.set(width, Math.max(length, 1e-9), width)));
}

const kind_colours = [], plan_colours = {};
function paint_points() { // colours that differ between light and dark
  kind_colours[0] = ink("--held-out");
  kind_colours[1] = ink("--fitted");
  body.tool.material.color.copy(ink("--tool"));
  for (const name of ["blue", "faint"]) plan_colours[name] = ink(`--${name}`);
}
paint_points();

let slots = new Int32Array(total).fill(-1);
function write_point(row) {
  const slot = slots[row];
  if (slot < 0) return;
  const shown = points.pose[row] === state.pose;
  const from = point(points.at[state.model], row);
  const next = points.pose[row] === state.next;
  scale.setScalar(shown || next ? 1.5 : measured || state.whole ? 1 : 0.8);
  body.modelled.setMatrixAt(slot, scratch.compose(from, STILL, scale));
  if (!measured) {
    body.modelled.setColorAt(slot, next ? plan_colours.blue : shown || state.whole ? kind_colours[0] : plan_colours.faint);
    return;
  }
  const kind = kind_of(points.pose[row]);
  scale.setScalar((shown ? 1.5 : 1) * (kind ? 0.8 : 1));
  body.measured.setMatrixAt(slot, scratch.compose(point(points.measured, row), STILL, scale));
  body.measured.setColorAt(slot, kind_colours[kind]);
  way.copy(point(points.error[state.model], row)).multiplyScalar(magnification());
  const length = way.length();
  if (length > 0) way.divideScalar(length);
  else way.copy(UP);
  const head = Math.min(0.5 * length, 6 * radius);
  const width = Math.max(Math.min(1, length / (12 * radius)), 0.4) * (shown ? 1.8 : kind ? 0.7 : 1);
  rod(body.shaft, slot, from, way, length - head, width);
  rod(body.head, slot, from.addScaledVector(way, length - head), way, head, width);
  const colour = colour_of(size[state.model][row]);
  body.shaft.setColorAt(slot, colour);
  body.head.setColorAt(slot, colour);
}
const AXES = [["#d62728", [1, 0, 0]], ["#2ca02c", [0, 1, 0]], ["#1f5fd6", [0, 0, 1]]]
  .map(([colour, axis]) => [new THREE.Color(colour), new THREE.Vector3(...axis)]);
function turned(values, k, factor) { // a rotation vector as a quaternion, at most a half turn
  way.set(values[k], values[k + 1], values[k + 2]);
  const angle = way.length();
  return new THREE.Quaternion().setFromAxisAngle(angle ? way.divideScalar(angle) : UP, Math.min(factor * angle, Math.PI));
}
function write_frames() { // at each measured point the modelled frame, thin, and the measured one, its turn magnified
  if (!oriented.length) return;
  let slot = 0;
  for (const row of oriented) {
    if (slots[row] < 0) continue;
    const at = point(points.measured, row), length = (points.pose[row] === state.pose ? 24 : 14) * radius;
    const modelled = turned(points.attitude[state.model], 6 * row, 1);
    const magnified = turned(points.attitude[state.model], 6 * row + 3, state.turning[state.model]).multiply(modelled);
    for (const [colour, axis] of AXES) {
      rod(body.axes, slot, at, axis.clone().applyQuaternion(magnified), length, 1);
      rod(body.modelled_axes, slot, at, axis.clone().applyQuaternion(modelled), 1.25 * length, 1);
      body.axes.setColorAt(slot, colour);
      body.modelled_axes.setColorAt(slot, colour);
      slot++;
    }
  }
  body.axes.count = body.modelled_axes.count = slot;
}
const layer_meshes = () => [body.measured, body.modelled, body.shaft, body.head].filter(Boolean);
function touch() {
  for (const mesh of [...layer_meshes(), body.axes, body.modelled_axes].filter(Boolean)) {
    mesh.instanceMatrix.needsUpdate = true;
    if (mesh.instanceColor) mesh.instanceColor.needsUpdate = true;
  }
  viewer.set_dirty();
}
function fill() {
  if (!points) return;
  let count = 0;
  for (let row = 0; row < total; row++) {
    slots[row] = is_drawn(points.pose[row]) ? count++ : -1;
    write_point(row);
  }
  write_frames();
  for (const mesh of layer_meshes()) mesh.count = count;
  touch();
}
