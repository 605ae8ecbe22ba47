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
    body.measured = marks(["measured"], total, 4.2 * radius, 0);
    body.vectors = rods(["vectors"], total, 0.5, true);
  }
  body.modelled = marks(["modelled"], total, (measured ? 1.35 : 1.9) * radius, 2 * radius, measured);
  if (in_plan) body.way = instanced(["next", "way"], rod_of(0.5), { color: 0x1f72bd }, WAY_PIECES);
  if (oriented.length) {
    body.axes = rods(["frames", "measured"], 3 * oriented.length, 0.5, false);
    body.modelled_axes = rods(["frames", "modelled"], 3 * oriented.length, 0.3, false, 0.55);
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
  body.tool.material.color.copy(ink("--soft"));
  plan_colours.next = ink("--action");
  plan_colours.faint = ink("--faint");
}
paint_points();

let slots = new Int32Array(total).fill(-1);
const WHITE = new THREE.Color(0xffffff);
const triple = (values, row) => values.subarray(3 * row, 3 * row + 3);
function write_point(row) {
  const slot = slots[row];
  if (slot < 0) return;
  const shown = points.pose[row] === state.pose, next = points.pose[row] === state.next, kind = kind_of(points.pose[row]);
  const from = triple(points.at[state.model], row);
  const colour = measured ? WHITE : next ? plan_colours.next : shown || state.whole ? kind_colours[0] : plan_colours.faint;
  body.modelled.write(slot, { position: from, colour: bytes_of(colour), size: [shown || next ? 1.5 : measured || state.whole ? 1 : 0.8] });
  if (!measured) return;
  body.measured.write(slot,
    { position: triple(points.measured, row), colour: bytes_of(kind_colours[kind]), size: [(shown ? 1.5 : 1) * (kind ? 0.8 : 1)] });
  const vector = triple(points.error[state.model], row).map((value) => value * magnification());
  const width = Math.max(Math.min(1, Math.hypot(...vector) / (12 * radius)), 0.4) * (shown ? 1.8 : kind ? 0.7 : 1);
  body.vectors.write(slot, { position: from, way: vector, width: [width], colour: bytes_of(colour_of(size[state.model][row])) });
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
    const at = triple(points.measured, row), length = (points.pose[row] === state.pose ? 24 : 14) * radius;
    const modelled = turned(points.attitude[state.model], 6 * row, 1);
    const magnified = turned(points.attitude[state.model], 6 * row + 3, state.turning[state.model]).multiply(modelled);
    for (const [rgb, axis] of AXES) {
      const of_rod = { position: at, width: [1], colour: bytes_of(rgb) };
      body.axes.write(slot, { ...of_rod, way: axis.clone().applyQuaternion(magnified).multiplyScalar(length).toArray() });
      body.modelled_axes.write(slot++, { ...of_rod, way: axis.clone().applyQuaternion(modelled).multiplyScalar(1.25 * length).toArray() });
    }
  }
  body.axes.show(slot);
  body.modelled_axes.show(slot);
}
const point_layers = () => [body.measured, body.modelled, body.vectors].filter(Boolean);
function touch() {
  for (const mesh of [...point_layers(), body.axes, body.modelled_axes].filter(Boolean))
    for (const name in mesh.geometry.attributes) if (name !== "corner") mesh.geometry.attributes[name].needsUpdate = true;
  viewer.set_dirty();
}
let drawn = 0, hurried = false;
const AT_ONCE = 3000; // points in a picture that moves: those with the largest errors, or some of all of a plan
function show_points() {
  for (const mesh of point_layers()) mesh.show(drawn, hurried && drawn > AT_ONCE / 10, hurried ? AT_ONCE : drawn);
}
function fill() {
  if (!points) return;
  const weight = measured ? size[state.model] : Float32Array.from({ length: total }, (_, row) => (0.618034 * row) % 1);
  slots.fill(-1);
  const rows = [];
  for (let row = 0; row < total; row++) if (is_drawn(points.pose[row])) rows.push(row);
  rows.sort((a, b) => weight[b] - weight[a]).forEach((row, slot) => (slots[row] = slot));
  rows.forEach(write_point);
  drawn = rows.length;
  write_frames();
  show_points();
  touch();
}

// A picture that took long is coarser while watcher or robot move: 150 ms of rest draw everything again.
const LONG = 40; // milliseconds
let slow = false, eye = null, resting = 0;
function hurry(on) {
  if (hurried === on) return;
  hurried = on;
  for (const [whole, coarse] of looks) [whole.visible, coarse.visible] = [!on, on];
  viewer.renderer.setPixelRatio(devicePixelRatio * (on ? 0.6 : 1));
  if (points) show_points();
}
function at_its_pace(render) {
  viewer.camera.updateMatrixWorld();
  const moves = state.playing || (eye !== null && !eye.equals(viewer.camera.matrixWorld));
  eye = viewer.camera.matrixWorld.clone();
  hurry(slow && moves);
  const start = performance.now();
  render();
  clearTimeout(resting);
  if (moves) resting = setTimeout(() => viewer.set_dirty(), 150);
  else {
    const gl = viewer.renderer.getContext();
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4)); // waits for the picture
    slow = performance.now() - start > LONG;
  }
}
